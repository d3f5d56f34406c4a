"""Figures of a run follow from its drives, by formulas that a second program has too."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.benchmark.ranking.selected_table import percents
from branchdrive.contract.bank import load_action_bank
from branchdrive.driving.utility import Profile, Scale
from branchdrive.statistics.cluster import Clusters
from branchdrive_reference.closed_loop.arm import Condition, arms_of
from branchdrive_reference.closed_loop.correlation import correlations
from branchdrive_reference.closed_loop.course import Schedule
from branchdrive_reference.closed_loop.figure import draw_orders, drive_figures
from branchdrive_reference.closed_loop.look_ahead import decision_regrets, look_ahead_results
from branchdrive_reference.closed_loop.outcome import PENALTIES, driving_score
from branchdrive_reference.closed_loop.result import OFFLINE, _distinct, drive_results
from branchdrive_reference.closed_loop.selector import Training
from branchdrive_reference.closed_loop.table import drive_sections

BANK = load_action_bank()


@pytest.mark.parametrize(
    ("fraction", "off_road", "counts", "score"),
    [
        (1.0, 0.0, {}, 1.0),
        (0.5, 0.2, {}, 0.4),
        (1.0, 0.0, {"pedestrian_collisions": 1, "red_light_infractions": 2}, 0.5 * 0.7**2),
        (1.0, 0.0, {"vehicle_collisions": 1, "static_collisions": 1, "stop_sign_infractions": 1}, 0.6 * 0.65 * 0.8),
        (1.0, 0.0, {"red_light_infractions": None, "off_road_infractions": 3}, 1.0),
    ],
)
def test_the_score_is_that_of_its_formula(
    fraction: float, off_road: float, counts: dict[str, int | None], score: float
) -> None:
    assert driving_score(fraction, off_road, counts) == pytest.approx(score)


def test_correlations_are_those_of_means_over_groups() -> None:
    random = np.random.default_rng(3)
    offline, driven = random.random((12, 6)), random.random((12, 6))
    clusters = Clusters.of([f"c{i // 2}" for i in range(12)])
    found = correlations(offline, driven, clusters, seed=1, num_resamples=200)
    assert found is not None
    x, y = offline.mean(axis=0), driven.mean(axis=0)
    assert found["spearman"]["value"] == pytest.approx(stats.spearmanr(x, y).statistic)
    assert found["kendall"]["value"] == pytest.approx(stats.kendalltau(x, y).statistic)
    assert found["r2"]["value"] == pytest.approx(stats.linregress(x, y).rvalue ** 2)
    for figure in found.values():
        assert figure["low"] is not None and figure["high"] is not None and figure["low"] <= figure["high"]
    same = correlations(offline[::-1], driven[::-1], Clusters.of([f"c{i // 2}" for i in range(12)][::-1]), seed=1,
                        num_resamples=200)  # fmt: skip
    assert same is not None and same["kendall"] == found["kendall"]


def test_last_bits_order_no_selectors() -> None:
    # The first two means are one number, which rounding makes two.
    offline = np.array([[0.1, 0.3, 0.5, 0.7], [0.2, 0.2, 0.5, 0.7], [0.3, 0.1, 0.5, 0.7]])
    driven = np.array([[4.0, 1.0, 2.0, 3.0]] * 3)
    assert len(set(offline.mean(axis=0))) == 4
    found = correlations(offline, driven, Clusters.of(["a", "a", "a"]), seed=1, num_resamples=10)
    assert found is not None
    tied, order = [1, 1, 2, 3], [4, 1, 2, 3]
    assert found["spearman"]["value"] == pytest.approx(stats.spearmanr(tied, order).statistic, abs=1e-12)
    assert found["kendall"]["value"] == pytest.approx(stats.kendalltau(tied, order).statistic, abs=1e-12)


def test_two_selectors_or_equal_figures_have_no_correlation() -> None:
    clusters = Clusters.of(["a", "b"])
    assert correlations(np.eye(2), np.eye(2), clusters, seed=1, num_resamples=10) is None
    assert correlations(np.ones((2, 4)), np.arange(8.0).reshape(2, 4), clusters, seed=1, num_resamples=10) is None


def driven(num_collisions: int | None) -> dict[str, Any]:
    """A drive whose collisions with vehicles are counted, or not monitored."""
    counts = dict.fromkeys((*PENALTIES, "off_road_infractions"), 0) | {"vehicle_collisions": num_collisions}
    return {
        "choices": ["nominal"], "counts": counts, "completion": "completed", "score": 1.0, "route_fraction": 1.0,
        "way_km": 0.1, "mean_jerk_mps3": 1.0, "max_accel_mps2": 1.0, "max_yaw_rate_radps": 0.1, "interventions": 0,
        "collision_in_first_window": False, "collision_later": False,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("counts", "difference", "passed"),
    [
        ([(0, 0), (0, 1), (1, 0)], 0.0, True),
        ([(0, 2), (0, 1), (1, 0)], 1 / 3, False),
        ([(0, 1), (1, None), (None, 0)], 1.0, False),
        ([(None, None), (None, 1), (0, None)], None, None),
    ],
)
def test_collisions_are_compared_where_both_drives_were_monitored(
    counts: list[tuple[int | None, int | None]], difference: float | None, passed: bool | None
) -> None:
    bank = [[None] * 6 for _ in BANK.policies]
    groups = [
        {"group_id": f"g{i}", "left_out_because": None, "bank": bank, "banks": None, "drives": [*map(driven, pair)]}
        for i, pair in enumerate(counts)
    ]
    profile, nothing = default_protocol().preferences["near_range"], np.full(5, np.nan)
    training = Training(BANK, "near_range", profile, Scale(nothing, nothing), (), np.zeros((0, 13)), (), None)
    results = drive_results(
        groups, {f"g{i}": f"c{i}" for i in range(len(groups))},
        arms_of(["nominal", "brake_0.50"], [Schedule(50, 1)], [Condition("exact")]), training,
        statistics={"seed": 1, "resamples": 20, "flips": 20}, warnings=[],
    )  # fmt: skip
    (table,) = (section for section in drive_sections(results) if section.title.startswith("Against nominal"))
    assert table.rows[0][-1] == {True: "passed", False: "failed", None: "not judged"}[passed]
    found = results["arms"][1]["to_nominal"]
    assert table.rows[0][-2] == percents(found["collision"])
    assert found["gate_passed"] is passed
    assert found["collision"]["value"] == (None if difference is None else pytest.approx(difference))
    known = [pair for pair in counts if None not in pair]
    worse = sum(not hit_nominal and bool(hit) for hit_nominal, hit in known)
    assert found["worse"]["value"] == (pytest.approx(worse / len(known)) if known else None)


def test_regret_at_every_decision_is_that_of_the_bank_in_its_state() -> None:
    """Of three decisions: one that is best, one that is worst, one in a state without a utility."""
    nominal, brake = "nominal", "brake_0.50"
    separations = {(): (2.0, 0.0), (brake,): (0.5, 2.0), (brake, brake): (None, 1.0)}

    def bank(of_brake: float | None, of_others: float | None) -> list[list[float | None]]:
        return [[None, of_brake if key == brake else of_others, *[1.0] * 4] for key in BANK.keys]

    only_separation = Profile(1.0, 0.0, 0.0, near_m=2.0)
    banks = [
        {"every_ticks": 50, "num_decisions": 3, "replay_noise": 0.0, "choices": [*before], "bank": bank(*separation)}
        for before, separation in separations.items()
    ]
    made = driven(0) | {"choices": [brake, brake, nominal]}
    group = {
        "group_id": "g", "left_out_because": None, "bank": banks[0]["bank"], "banks": banks, "drives": [made, made],
    }  # fmt: skip
    arms = arms_of(["nominal", brake], [Schedule(50, 3)], [Condition("exact")])
    training = Training(
        BANK, "near_range", only_separation, Scale(np.zeros(5), np.ones(5)), (), np.zeros((0, 13)), (), None
    )
    np.testing.assert_allclose(decision_regrets(group, 1, arms[1], training), [0.0, 1.0, np.nan])
    found = look_ahead_results([group] * 2, ["a", "b"], arms, training, {"seed": 1, "resamples": 20})
    assert found[1]["first"]["value"] == 0 and found[1]["later"]["value"] == 1
    assert [one["num_ranked"] for one in found[1]["by_decision"]] == [2, 2, 0]
    assert found[1]["by_decision"][2]["value"] is None


def test_a_figure_has_a_point_for_every_selector_and_schedule() -> None:
    def arm(name: str, number: int, first: str) -> dict[str, Any]:
        score = {"value": 0.5 + 0.1 * number, "low": 0.4, "high": 0.8}
        return {
            "selector": name, "every_ticks": 50, "num_decisions": number, "condition": "exact",
            "means": {"score": score}, "first_choices": {first: 3},
        }  # fmt: skip

    names = {"nominal": "nominal", "brake_0.50": "brake_0.50", "oracle": "brake_0.30", "E-M3": "nominal"}
    offline = [{"selector": name, **{one: {"value": 0.2} for one in OFFLINE}} for name in names]
    results = {
        "arms": [arm(name, number, first) for number in (1, 4) for name, first in names.items()],
        "offline": {"num_ranked": 3, "selectors": offline}, "num_driven": 3, "profile": "near_range", "warnings": [],
    }  # fmt: skip
    figure = draw_orders(results)
    points = [[line for line in axes.lines if line.get_marker() == "o"] for axes in figure.axes]
    assert [len(own) for own in points] == [len(names)] * 2 * len(OFFLINE)
    assert [float(line.get_ydata()[0]) for line in points[-1]] == pytest.approx([0.9] * len(names))
    assert {*drive_figures(results)} == {"offline.png", "offline.svg"}
    assert drive_figures(results) == drive_figures(results)
    assert drive_figures({**results, "offline": None}) == {}


def test_selectors_that_choose_the_same_everywhere_are_one_point() -> None:
    brake, wait = ("brake_0.50",), ("nominal",)
    assert _distinct({2: [wait, wait], 3: [brake, wait], 5: [wait, wait], 6: [wait, brake]}) == [2, 3, 6]
