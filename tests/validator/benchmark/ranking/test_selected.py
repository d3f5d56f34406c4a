"""Outcomes of selections: by hand, against what a choice of a candidate is, and where something is unknown."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.measure import fixed, uniform
from branchdrive.benchmark.ranking.selected import SelectedOutcomes, selected_outcomes, selected_record
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.statistics.bootstrap import Design, design

Array = NDArray[np.float64]

TTC, SEPARATION, DISPLACEMENT, JERK = range(4)
CLUSTERS = ("a", "a", "b", "c")
TOLERANCE = np.array([np.nan, 0.5, 1.0, 1.0, 1.0, 1.0])


def bank() -> Array:
    """Four groups of three candidates; separations by hand, everything else 10."""
    values = np.full((4, 3, 6), 10.0)
    values[..., SEPARATION] = [[3, 0, 5], [2, 0, 0], [0, 0, 0], [4, 3.4, 1]]
    return values


def resampling(clusters: tuple[str, ...] = CLUSTERS) -> Design:
    return design(clusters, seed=1, num_resamples=200)


def found(shares: Array, values: Array | None = None, **options: object) -> SelectedOutcomes:
    values = bank() if values is None else values
    given: dict[str, object] = {"nominal": 0, "contact_m": 0.0, "tolerance": TOLERANCE, **options}
    ranked = np.asarray(given.pop("ranked", np.ones(len(values), bool)))
    outcomes = Targets(values, np.isfinite(values))
    return selected_outcomes(outcomes, {"it": shares}, ranked, resampling(), **given)["it"]  # type: ignore[arg-type]


def test_a_fixed_choice_has_the_outcomes_of_its_candidate() -> None:
    second = found(fixed(1, 4, 3).shares)
    assert second.means[SEPARATION] == pytest.approx(3.4 / 4)
    assert second.available.tolist() == [1.0] * 6
    assert second.contact.value == 0.75
    assert second.avoidable_contact.value == 0.5  # in the third group there is nothing but contact
    worse = second.worse[SEPARATION]
    assert worse is not None
    assert worse.value == 0.75  # 3.0, 2.0 and 0.6 m less; the third group has nothing to lose
    interval = second.intervals[SEPARATION]
    assert interval.cluster_low <= second.means[SEPARATION] <= interval.cluster_high


def test_a_random_choice_has_the_mean_of_its_candidates() -> None:
    shares = uniform(4, 3).shares
    several = found(shares)
    alone = [found(fixed(a, 4, 3).shares) for a in range(3)]
    for name in ("contact", "avoidable_contact"):
        expected = np.mean([getattr(each, name).value for each in alone])
        assert getattr(several, name).value == pytest.approx(expected)
    assert several.means == pytest.approx(np.mean([each.means for each in alone], axis=0))


def test_a_contact_is_a_separation_of_at_most_so_much() -> None:
    shares = fixed(1, 4, 3).shares
    assert found(shares, contact_m=3.4).contact.value == 1.0
    assert found(shares, contact_m=3.4 - 1e-6).contact.value == 0.75
    values = bank()
    values[3, 1, SEPARATION] = 5e-10
    assert found(shares, values).contact.value == 1.0


def test_more_is_worse_where_comfort_is_lost() -> None:
    values = bank()
    values[:, 1, JERK] = [11.0, 11.1, 8.0, 20.0]
    values[:, 1, DISPLACEMENT] = [11.0, 11.1, 8.0, 20.0]
    worse = found(fixed(1, 4, 3).shares, values).worse
    rates = [None if rate is None else rate.value for rate in worse]
    assert rates == [None, 0.75, 0.25, 0.5, 0.0, 0.0]


def test_what_is_not_available_is_left_out_and_counted() -> None:
    values = bank()
    values[0, 1, TTC] = np.nan
    values[1, 1, TTC] = 4.0
    values[2, 0, JERK] = np.nan
    second = found(fixed(1, 4, 3).shares, values)
    assert second.available.tolist() == [0.75, 1, 1, 1, 1, 1]
    assert second.means[TTC] == pytest.approx((4 + 10 + 10) / 3)
    values[:, 1, TTC] = np.nan
    none = found(fixed(1, 4, 3).shares, values, tolerance=np.ones(6))
    assert selected_record(none)["targets"][TTC] == {
        "target": "min_ttc_s", "mean": None, "available": 0.0,
        "worse": {"value": None, "low": None, "high": None},
        "interval": {
            "low": None, "high": None, "bca_low": None, "bca_high": None, "num_undefined": 200,
            "cluster_low": None, "cluster_high": None, "cluster_num_undefined": 200,
        },
    }  # fmt: skip


def test_nominal_loses_nothing_against_itself_by_definition() -> None:
    itself = found(fixed(0, 4, 3).shares, settled=("it",)).worse[SEPARATION]
    another = found(fixed(0, 4, 3).shares).worse[SEPARATION]
    assert itself is not None
    assert another is not None
    assert (itself.value, itself.low, itself.high) == (0.0, None, None)
    assert (another.value, another.low) == (0.0, 0.0)
    assert another.high is not None
    assert another.high > 0.3  # nothing in three clusters is no certainty


def test_without_repeats_nobody_knows_what_is_worse() -> None:
    assert found(fixed(1, 4, 3).shares, tolerance=None).worse == (None,) * len(TARGETS)


def test_groups_that_are_not_ranked_have_no_part() -> None:
    ranked = np.array([True, False, True, True])
    values = bank()
    values[1, 0, SEPARATION] = np.nan
    second = found(fixed(1, 3, 3).shares, values, ranked=ranked)
    assert second.contact.value == pytest.approx(2 / 3)
    assert second.means[SEPARATION] == pytest.approx(3.4 / 3)


def test_shares_of_seeds_are_parts_of_events() -> None:
    """Three seeds of which one makes contact are a third of a contact, in no narrower interval than a whole one."""
    third = (2 * fixed(0, 4, 3).shares + fixed(1, 4, 3).shares) / 3
    part, whole = found(third), found(fixed(1, 4, 3).shares)
    assert part.contact.value == pytest.approx((1 + 1 + 3) / 12)
    assert part.contact.low is not None
    assert part.contact.high is not None
    assert part.contact.low < (1 + 1 + 3) / 12 < part.contact.high
    assert whole.contact.low is not None
    assert part.contact.low < whole.contact.low
