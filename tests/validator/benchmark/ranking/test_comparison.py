"""Captured share, agreement of seeds, and the non-worsening gate at its boundary."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive.benchmark.ranking.measure import by_score, fixed, measures
from branchdrive.benchmark.ranking.ranking import captured_share, non_worsening, seed_agreement

UTILITIES = np.array([[0.4, 0.9, 0.1], [0.5, 0.2, 0.6]])


def test_the_oracle_captures_everything_and_nominal_nothing() -> None:
    oracle = measures(by_score(UTILITIES), UTILITIES, nominal=0)
    assert captured_share(oracle, oracle) == pytest.approx(1)
    assert captured_share(measures(fixed(0, 2, 3), UTILITIES, nominal=0), oracle) == 0
    # A gain of 0.5 in one group and a loss of 0.3 in the other, of a gap of 0.6.
    assert captured_share(measures(fixed(1, 2, 3), UTILITIES, nominal=0), oracle) == pytest.approx(0.2 / 0.6)


def test_without_a_gap_there_is_no_share() -> None:
    flat = np.full((3, 2), 0.5)
    nothing = measures(by_score(flat), flat, nominal=0)
    assert captured_share(nothing, nothing) is None


def test_seeds_agree_by_pairs() -> None:
    chosen = np.array([[0, 1, 2], [0, 1, 0], [0, 2, 1]])
    assert seed_agreement(np.eye(3)[chosen]) == pytest.approx([1, 1 / 3, 0])
    with pytest.raises(ValueError, match="at least two"):
        seed_agreement(np.eye(3)[chosen[:1]])


@pytest.mark.parametrize(("lost", "passed"), [(-0.5, True), (0.0, True), (1e-6, False)])
def test_the_gate_fails_below_zero_alone(lost: float, passed: bool) -> None:
    separation = np.array([[4.0, 5.0], [3.0, 2.0 - lost]])
    gate = non_worsening(separation, fixed(1, 2, 2).shares[None], 0)
    assert gate.difference_m == pytest.approx([1, -1 - lost])
    assert gate.mean_m == pytest.approx(-lost / 2)
    assert gate.passed is passed


def test_the_gate_does_not_fail_by_rounding() -> None:
    """Three seeds choose three candidates of the same separation as the reference: a weighted mean is off by a bit."""
    separation = np.repeat(np.random.default_rng(0).uniform(1, 9, size=(50, 1)), 4, axis=1)
    shares = np.repeat(np.eye(4)[:3, None], 50, axis=1)
    assert ((shares.mean(axis=0) * separation).sum(axis=1) < separation[:, 3]).any()
    gate = non_worsening(separation, shares, 3)
    assert (gate.difference_m == 0).all()
    assert gate.passed
    assert non_worsening(np.array([[4.0, 4.0 - 1e-10]]), np.array([[[0.0, 1.0]]]), 0).passed


def test_the_gate_means_over_seeds_and_groups() -> None:
    separation = np.array([[4.0, 5.0], [3.0, 2.0]])
    shares = np.eye(2)[[[0, 0], [1, 0], [1, 1], [1, 1]]]
    gate = non_worsening(separation, shares, 0)
    assert gate.difference_m == pytest.approx([3 / 4, -1 / 2])
    assert gate.passed


def test_the_gate_needs_separations() -> None:
    for separation in (np.array([[1.0, np.nan]]), np.empty((0, 2))):
        with pytest.raises(ValueError, match="every candidate has a separation"):
            non_worsening(separation, np.zeros((1, *separation.shape)), 0)
