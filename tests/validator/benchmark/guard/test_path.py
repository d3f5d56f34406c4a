"""The selection path: its ends, its ties, violations and their envelope."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.each import each

from branchdrive.benchmark.guard.path import TOLERANCE_M, envelope, multiplier_grid, selection_path, violations

GRID = multiplier_grid(0.2)
unit = st.floats(0, 1, width=16)


def bank(values: np.ndarray) -> np.ndarray:
    """Nominal first, with nothing."""
    return np.concatenate([np.zeros((len(values), 1)), values], axis=1)


def test_the_grid_falls_about_the_dual_multiplier() -> None:
    assert len(GRID) == 100
    assert GRID[0] == pytest.approx(6)
    assert GRID[-1] == pytest.approx(0.2 / 60)
    assert (np.diff(GRID) < 0).all()
    assert multiplier_grid(0.0) == multiplier_grid(0.01)


@pytest.mark.parametrize(("multiplier", "size"), [(-1.0, 9), (np.nan, 9), (np.inf, 9), (0.1, 1)])
def test_a_grid_needs_a_multiplier(multiplier: float, size: int) -> None:
    with pytest.raises(ValueError, match="no grid of"):
        multiplier_grid(multiplier, size=size)


def test_the_path_buys_risk_as_its_multiplier_falls() -> None:
    # Candidate 1 gains little without much risk, candidate 2 gains more with more risk.
    path = selection_path(bank(np.array([[0.1, 0.3]])), bank(np.array([[0.1, 0.5]])), [2.0, 0.8, 0.4], nominal=0)
    assert path.multipliers.tolist() == [np.inf, 2.0, 0.8, 0.4, 0.0]
    assert path.selections[:, 0].tolist() == [0, 0, 1, 2, 2]


@given(arrays(np.float64, (5, 4), elements=st.floats(-1, 1, width=16)), arrays(np.float64, (5, 4), elements=unit))
def test_an_infinite_multiplier_is_nominal_and_none_is_unguarded(gains: np.ndarray, risks: np.ndarray) -> None:
    path = selection_path(bank(gains), bank(risks), GRID, nominal=0)
    assert (path.selections[0] == 0).all()
    assert (bank(gains)[np.arange(5), path.selections[-1]] >= bank(gains).max(axis=1) - 1e-9).all()


@given(arrays(np.float64, (5, 4), elements=st.floats(-1, 1, width=16)), arrays(np.float64, (5, 4), elements=unit))
def test_risk_taken_and_predicted_gain_never_fall_along_the_path(gains: np.ndarray, risks: np.ndarray) -> None:
    path = selection_path(bank(gains), bank(risks), GRID, nominal=0)
    for values in (bank(gains), bank(risks)):
        assert (np.diff(values[np.arange(5), path.selections], axis=0) >= -1e-6).all()


def test_equal_scores_stay_with_the_first_candidate() -> None:
    path = selection_path(np.zeros((1, 3)), np.zeros((1, 3)), [1.0], nominal=0)
    assert path.selections[:, 0].tolist() == [0, 0, 0]


@given(
    arrays(np.float64, (4, 3), elements=st.floats(-1, 1, width=16), unique=True),
    arrays(np.float64, (4, 3), elements=unit),
    st.permutations(range(4)),
    st.permutations(range(4)),
)
def test_orders_of_groups_and_candidates_do_not_matter(
    gains: np.ndarray, risks: np.ndarray, groups: list[int], candidates: list[int]
) -> None:
    rng = np.random.default_rng(0)
    gains, risks = bank(gains + rng.normal(size=(4, 3)) * 1e-4), bank(risks + rng.random((4, 3)) * 1e-4)
    here = selection_path(gains, risks, GRID, nominal=0).selections
    nominal = candidates.index(0)
    moved = (values[groups][:, candidates] for values in (gains, risks))
    there = selection_path(*moved, GRID, nominal=nominal).selections
    assert (np.array(candidates)[there] == here[:, groups]).all()


def test_a_violation_loses_more_than_the_tolerance() -> None:
    assert TOLERANCE_M == 0.25
    separation = np.array([[4.0, 3.75, 3.7499], [2.0, 1.0, 3.0]])
    selections = np.array([[0, 0], [1, 1], [2, 2]])
    assert violations(selections, separation, nominal=0).tolist() == [[False, False], [False, True], [True, False]]
    assert not violations(selections, separation, nominal=0, tolerance_m=1.0).any()
    assert violations(selections[1], separation, nominal=2).tolist() == [False, True]


def test_a_group_without_separation_is_refused() -> None:
    with pytest.raises(ValueError, match="leave its group out of the guard"):
        violations(np.zeros((1, 1), int), np.array([[1.0, np.nan]]), nominal=0)


@given(arrays(np.bool_, (7, 5)))
def test_the_envelope_rises_and_is_the_least_that_bounds_the_losses(losses: np.ndarray) -> None:
    found = envelope(losses)
    assert (found[1:] >= found[:-1]).all()
    assert (found >= losses).all()
    assert all(found[place].tolist() == losses[: place + 1].any(axis=0).tolist() for place in range(7))


@each(
    ("gains", "risks", "multipliers", "message"),
    [
        ([[0.0, 1]], [[0.0, 1, 1]], [1.0], "are not both"),
        ([[0.0, np.nan]], [[0.0, 1]], [1.0], "finite numbers"),
        ([[0.0, 1]], [[0.0, -1]], [1.0], "at least 0"),
        ([[0.1, 1]], [[0.0, 1]], [1.0], "candidate 0 is nominal"),
        ([[0.0, 1]], [[0.1, 1]], [1.0], "candidate 0 is nominal"),
        ([[0.0, 1]], [[0.0, 1]], [1.0, 1.0], "fall along the path"),
        ([[0.0, 1]], [[0.0, 1]], [np.inf, 1.0], "finite and positive"),
        ([[0.0, 1]], [[0.0, 1]], [1.0, 0.0], "finite and positive"),
    ],
)
def test_broken_arguments_are_refused(
    gains: list[list[float]], risks: list[list[float]], multipliers: list[float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        selection_path(np.array(gains), np.array(risks), multipliers, nominal=0)
