"""Counter-based randomness: a pure function of its key, uniform, and independent between key parts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from branchdrive_reference.noise import Purpose, choice, integer, normal, uniform, uniform_between

SEED = st.integers(0, 2**63 - 1)


def oracle(*parts: int) -> float:
    """The same number in unbounded integers."""
    mask, state = 2**64 - 1, 0
    for part in parts:
        mixed = ((state ^ part) + 0x9E3779B97F4A7C15) & mask
        mixed = ((mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9) & mask
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & mask
        state = mixed ^ (mixed >> 31)
    return (state >> 11) * 2.0**-53


@given(SEED, st.sampled_from(Purpose), st.integers(0, 1000), st.integers(0, 1000))
def test_numbers_are_those_of_the_definition(seed: int, purpose: Purpose, actor: int, tick: int) -> None:
    assert uniform(seed, int(purpose), actor, tick) == oracle(seed, int(purpose), actor, tick)


def test_numbers_are_uniform_along_every_part_of_the_key() -> None:
    draws = np.array(
        [
            [uniform(i, 3, 0, 0) for i in range(4000)],
            [uniform(7, i, 0, 0) for i in range(4000)],
            [uniform(7, 3, i, 0) for i in range(4000)],
            [uniform(7, 3, 0, i) for i in range(4000)],
        ]
    )
    counts = np.stack([np.histogram(row, bins=20, range=(0, 1))[0] for row in draws])
    assert (((counts - 200) ** 2 / 200).sum(axis=1) < 50).all()  # chi-square, 19 degrees of freedom
    assert np.abs(np.corrcoef(draws) - np.eye(4)).max() < 0.07


def test_a_purpose_keeps_its_number() -> None:
    assert len({int(purpose) for purpose in Purpose}) == len(Purpose)
    assert Purpose.PLAN_SEED == 3
    assert Purpose.TRAFFIC_MOOD == 25


@given(SEED)
def test_derived_draws_stay_in_range(seed: int) -> None:
    assert -2.0 <= uniform_between(-2.0, 5.0, seed, Purpose.SITE) < 5.0
    assert 0 <= choice(7, seed, Purpose.SITE) < 7
    assert 0 <= integer(seed, Purpose.SITE) < 2**53


@pytest.mark.parametrize("count", [1, 2, 5])
def test_every_choice_occurs(count: int) -> None:
    assert {choice(count, seed, Purpose.SITE) for seed in range(100)} == set(range(count))


@given(SEED, st.integers(0, 1000), st.integers(0, 1000))
def test_normal_numbers_are_box_and_mullers(seed: int, actor: int, tick: int) -> None:
    first, second = (oracle(seed, int(Purpose.REPLAY_EGO), 2 * actor + part, tick) for part in (0, 1))
    truth = math.sqrt(-2.0 * math.log(1.0 - first)) * math.cos(2.0 * math.pi * second)
    assert normal(seed, Purpose.REPLAY_EGO, actor, tick) == pytest.approx(truth, abs=1e-12)


@pytest.mark.parametrize("part", ["seed", "actor", "tick"])
def test_normal_numbers_are_standard_along_every_part_of_the_key(part: str) -> None:
    """By Kolmogorov and Smirnov, the key being fixed."""
    key = {"seed": 7, "actor": 0, "tick": 0}
    draws = [normal(purpose=Purpose.REPLAY_CONTROL, **{**key, part: index}) for index in range(4000)]
    assert stats.kstest(draws, "norm").pvalue > 0.01
    assert np.abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 0.05


def test_normal_numbers_of_neighbouring_actors_share_nothing() -> None:
    draws = np.array([[normal(seed, Purpose.REPLAY_TRAFFIC, actor) for seed in range(2000)] for actor in range(4)])
    assert np.abs(np.corrcoef(draws) - np.eye(4)).max() < 0.08
