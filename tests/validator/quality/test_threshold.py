"""Thresholds of replay fidelity: the order statistic, who passes at the boundary, and what is missing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.driving.discrepancy import CORE, EXTENDED
from branchdrive.quality.threshold import PEDESTRIAN_GAP, VARIABLES, fit_thresholds, passes

NAMES = [variable.name for variable in VARIABLES]


def discrepancies(num_groups: int, num_pairs: int = 12, **values: Any) -> Any:
    """Zero, but for the named variables ``[groups, pairs]``."""
    found = np.zeros((num_groups, num_pairs, len(VARIABLES)))
    for name, value in values.items():
        found[..., NAMES.index(name)] = value
    return found


def column(values: Any) -> Any:
    """One value a group, in its last pair."""
    found = np.zeros((len(values), 12))
    found[:, -1] = values
    return found


def test_variables_are_core_then_extended_with_the_pedestrian_gap() -> None:
    assert (*CORE, *EXTENDED) == VARIABLES
    assert PEDESTRIAN_GAP in EXTENDED
    assert len(VARIABLES) == 12


@pytest.mark.parametrize(("num_groups", "num_above"), [(1, 0), (99, 0), (100, 0), (101, 1), (201, 2), (442, 4)])
def test_the_threshold_is_the_higher_order_statistic(num_groups: int, num_above: int) -> None:
    values = np.random.default_rng(0).permutation(num_groups) + 1.0
    found = fit_thresholds(discrepancies(num_groups, position_m=column(values)), has_pedestrian=[False] * num_groups)
    assert found.values[0] == num_groups - num_above
    passed = passes(discrepancies(num_groups, position_m=column(values)), found)
    assert (~passed.core_bank).sum() == num_above


@given(st.lists(st.lists(st.floats(0, 100) | st.just(math.inf), min_size=3, max_size=3), min_size=1, max_size=250))
def test_the_plain_definition_agrees(rows: list[list[float]]) -> None:
    found = fit_thresholds(discrepancies(len(rows), 3, steer=rows), has_pedestrian=[True] * len(rows))
    worst = sorted(map(max, rows))
    expected = max(0.001, worst[math.ceil(0.99 * (len(rows) - 1))])
    assert found.values[NAMES.index("steer")] == expected
    passed = passes(discrepancies(len(rows), 3, steer=rows), found)
    assert passed.core.tolist() == [[value <= expected and value < math.inf for value in row] for row in rows]


@each("name", NAMES)
def test_exact_training_groups_leave_room_for_numerical_noise(name: str) -> None:
    floor = {"heading_deg": 0.01, "vehicle_gap_m": 0.002, "vehicle_rel_speed_mps": 0.002, "pedestrian_gap_m": 0.002}
    counted = ("tick_offset", "actor_count_share", "traffic_light_share")
    least = 0.0 if name in counted else floor.get(name, 0.001)
    fitted = fit_thresholds(discrepancies(100, 2), has_pedestrian=[True] * 100)
    assert fitted.values[NAMES.index(name)] == least
    off = discrepancies(1, 2, **{name: [[least, np.nextafter(least, 1.0)]]})
    assert passes(off, fitted).extended.tolist() == [[True, False]]


@given(st.integers(0, 1000))
def test_the_order_of_groups_and_pairs_decides_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.exponential(size=(50, 4, 12))
    has = rng.random(50) < 0.5
    order, pairs = rng.permutation(50), rng.permutation(4)
    a, b = (
        fit_thresholds(values, has_pedestrian=has),
        fit_thresholds(values[order][:, pairs], has_pedestrian=has[order]),
    )
    np.testing.assert_array_equal(a.values, b.values)
    assert (passes(values, a).core[order][:, pairs] == passes(values[order][:, pairs], b).core).all()


@each("name", NAMES)
def test_a_value_at_the_threshold_passes_and_the_next_one_does_not(name: str) -> None:
    limit = 0.0 if name == "tick_offset" else 3.0
    fitted = fit_thresholds(discrepancies(100, **{name: 3.0}), has_pedestrian=[True] * 100)
    assert fitted.values[NAMES.index(name)] == limit
    tried = discrepancies(1, 2, **{name: [[limit, np.nextafter(limit, 9)]]})
    passed = passes(tried, fitted)
    assert passed.extended.tolist() == [[True, False]]
    assert passed.core.tolist() == [[True, name not in NAMES[:7]]]
    assert not passed.extended.all(axis=1)[0]


def test_a_bank_passes_with_all_its_pairs() -> None:
    fitted = fit_thresholds(discrepancies(5, speed_mps=1.0), has_pedestrian=[False] * 5)
    tried = discrepancies(3, speed_mps=0.5)
    tried[1, 4, NAMES.index("speed_mps")] = 2
    tried[2, 0, NAMES.index("vehicle_gap_m")] = 1
    passed = passes(tried, fitted)
    assert passed.core_bank.tolist() == [True, False, True]
    assert passed.extended.all(axis=1).tolist() == [True, False, False]
    assert passed.extended.sum(axis=1).tolist() == [12, 11, 11]


@pytest.mark.parametrize(("num_with", "judged"), [(0, False), (99, False), (100, True), (150, True)])
def test_pedestrians_are_judged_from_a_hundred_training_groups_on(num_with: int, judged: bool) -> None:
    fitted = fit_thresholds(discrepancies(150, pedestrian_gap_m=1.0), has_pedestrian=np.arange(150) < num_with)
    assert fitted.support == num_with
    assert fitted.num_groups == 150
    assert fitted.judged.tolist() == [True] * 11 + [judged]
    assert np.isnan(fitted.values[-1]) == (not judged)
    assert passes(discrepancies(1, pedestrian_gap_m=np.inf), fitted).extended.all(axis=1)[0] == (not judged)


def test_what_is_missing_on_one_side_never_passes_even_if_much_is() -> None:
    values = discrepancies(10, vehicle_gap_m=np.inf)
    fitted = fit_thresholds(values, has_pedestrian=[False] * 10)
    assert fitted.values[NAMES.index("vehicle_gap_m")] == np.inf
    assert not passes(values, fitted).extended.any()
    assert passes(values, fitted).core.all()
    assert passes(discrepancies(1, vehicle_gap_m=50.0), fitted).extended.all(axis=1).all()


def test_an_offset_of_the_branch_never_passes() -> None:
    values = discrepancies(10, tick_offset=5)
    assert not passes(values, fit_thresholds(values, has_pedestrian=[False] * 10)).core.any()


def test_a_partition_without_groups_passes_nobody() -> None:
    fitted = fit_thresholds(discrepancies(1), has_pedestrian=[False])
    passed = passes(discrepancies(0), fitted)
    assert passed.core.shape == (0, 12)
    assert passed.core_bank.shape == (0,)


WRONG = {
    "no group": (discrepancies(0), [], "0 training groups"),
    "no pair": (discrepancies(3, 0), [True] * 3, r"not \[groups, pairs, 12\]"),
    "other variables": (np.zeros((3, 12, 11)), [True] * 3, r"shape \[3, 12, 11\], not \[groups, pairs, 12\]"),
    "no number": (discrepancies(3, steer=np.nan), [True] * 3, "negative or no number"),
    "negative": (discrepancies(3, steer=-1), [True] * 3, "negative or no number"),
    "other groups": (discrepancies(3), [True] * 2, r"`has_pedestrian` of shape \[2\]"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_fitted_is_refused(case: str) -> None:
    values, has, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        fit_thresholds(values, has_pedestrian=has)
