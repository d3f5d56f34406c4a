"""Ends of selected drives: by hand, where something was not monitored, and the oracle of clean drives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.ending import EVENTS, Endings
from branchdrive.benchmark.protocol.selection import CLEAN_ORACLE, ORACLE
from branchdrive.benchmark.ranking.ending import SelectedEndings, ending_record, selected_endings
from branchdrive.benchmark.ranking.measure import fixed, uniform
from branchdrive.benchmark.ranking.ranking import rank
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import Profile, Scale
from branchdrive.statistics.bootstrap import design

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COLLISION, OFF_ROAD, INFRACTION = range(len(EVENTS))
CLUSTERS = ("a", "a", "b", "c")


def bank(**changes: Array | Mask) -> Endings:
    """Four groups of three candidates: nominal is clean but in the last, the second collides in two, the third leaves
    the road in one of these and runs a light in another."""
    events = np.zeros((4, 3, 3), bool)
    events[[0, 2], 1, COLLISION] = True
    events[2, 2, OFF_ROAD] = events[1, 2, INFRACTION] = events[3, 0, INFRACTION] = True
    completed = ~events[..., COLLISION]
    fields: dict[str, Array | Mask] = {
        "events": events, "monitored": np.ones_like(events), "completed": completed,
        "route_fraction": np.where(completed, 1.0, 0.5), **changes,
    }  # fmt: skip
    return Endings(**fields)  # type: ignore[arg-type]


def found(shares: Array, endings: Endings | None = None, ranked: Mask | None = None) -> SelectedEndings:
    ranked = np.ones(4, bool) if ranked is None else ranked
    resampling = design(CLUSTERS, seed=1, num_resamples=200)
    (one,) = selected_endings(endings or bank(), {"it": shares}, ranked, resampling, nominal=0, seed=1).values()
    return one


def test_a_fixed_choice_has_the_ends_of_its_candidate() -> None:
    second = found(fixed(1, 4, 3).shares)
    values = {name: rate.value for name, rate in second.rates.items()}
    assert values == {"collision": 0.5, "off_road": 0.0, "infraction": 0.0, "clean": 0.5, "completed": 0.5}
    assert second.known == 1.0
    assert second.route_fraction == 0.75
    assert second.interval.cluster_low < 0.75 < second.interval.cluster_high
    assert second.to_nominal["clean"].value == -0.25  # two drives less, one more
    assert second.to_nominal["completed"].value == -0.5
    rare = second.rates["off_road"]
    assert rare.low == 0.0
    assert rare.high is not None
    assert rare.high > 0.3  # nothing in three clusters is no certainty


def test_a_random_choice_has_the_mean_of_its_candidates() -> None:
    several, alone = found(uniform(4, 3).shares), [found(fixed(a, 4, 3).shares) for a in range(3)]
    for name, rate in several.rates.items():
        assert rate.value == pytest.approx(np.mean([each.rates[name].value for each in alone]))
    assert several.route_fraction == pytest.approx(np.mean([each.route_fraction for each in alone]))
    for end, figure in several.to_nominal.items():
        assert figure.value == pytest.approx(np.mean([each.to_nominal[end].value for each in alone]))


def test_nominal_ends_as_nominal_does() -> None:
    figures = found(fixed(0, 4, 3).shares).to_nominal.values()
    assert [(one.value, one.low, one.high) for one in figures] == [(0.0, None, None)] * 2


def test_what_was_not_monitored_is_left_out_and_counted() -> None:
    monitored = np.ones((4, 3, 3), bool)
    monitored[2, 1, COLLISION] = monitored[0, 0, OFF_ROAD] = False
    events = bank().events & monitored
    second = found(fixed(1, 4, 3).shares, bank(monitored=monitored, events=events))
    assert second.rates["collision"].value == pytest.approx(1 / 3)
    assert second.rates["clean"].value == pytest.approx(2 / 3)
    assert second.known == 0.75
    assert second.to_nominal["clean"].value == 0.5  # of the second and the last group, in which both are known
    assert second.to_nominal["completed"].value == -0.5
    nobody = found(fixed(1, 4, 3).shares, bank(monitored=np.zeros_like(monitored), events=np.zeros_like(monitored)))
    nothing = {"value": None, "low": None, "high": None}
    record = ending_record(nobody)
    assert [record[name] for name in (*EVENTS, "clean")] == [nothing] * 4
    assert record["to_nominal"]["clean"] == nothing
    assert record["known"] == 0.0
    assert record["completed"]["value"] == 0.5


def test_groups_that_are_not_ranked_have_no_part() -> None:
    ranked = np.array([True, False, True, True])
    second = found(fixed(1, 3, 3).shares, ranked=ranked)
    assert second.rates["collision"].value == pytest.approx(2 / 3)
    assert second.route_fraction == pytest.approx(2 / 3)
    assert second.to_nominal["clean"].value == pytest.approx(-1 / 3)


def test_seeds_in_other_groups_of_a_cluster_move_no_interval_of_another() -> None:
    """The same groups in another order are the same population."""
    order = np.array([3, 1, 0, 2])
    resampling = design([CLUSTERS[i] for i in order], seed=1, num_resamples=200)
    there = {"it": fixed(1, 4, 3).shares}
    turned = selected_endings(bank().take(order), there, np.ones(4, bool), resampling, nominal=0, seed=1)["it"]
    straight = found(fixed(1, 4, 3).shares)
    assert turned.rates == straight.rates
    assert turned.to_nominal == straight.to_nominal


def test_the_oracle_of_clean_drives_takes_the_best_of_these_and_else_of_all() -> None:
    values = np.zeros((4, 3, len(TARGETS)))
    values[..., 1] = values[..., 2] = [[1, 3, 2], [3, 1, 2], [1, 2, 3], [2, 3, 3]]
    clean = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 0], [1, 1, 1]], bool)
    scale = Scale(np.zeros(5), np.full(5, 4.0))
    ranking = rank(
        Targets(values, np.ones(values.shape, bool)), {}, scale=scale, profile=Profile(0.5, 0.5, 0.0), nominal=0,
        action_prior=0, clean=clean,
    )  # fmt: skip
    assert list(ranking.entries)[-2:] == [ORACLE, CLEAN_ORACLE]
    taken = {name: ranking.entries[name].shares.argmax(axis=1).tolist() for name in (ORACLE, CLEAN_ORACLE)}
    assert taken == {ORACLE: [1, 0, 2, 1], CLEAN_ORACLE: [2, 2, 2, 1]}
    assert ranking.entries[CLEAN_ORACLE].measures.regret.tolist() == pytest.approx([0.5, 0.5, 0, 0])
    assert not np.isnan(ranking.entries[CLEAN_ORACLE].measures.concordance).any()
