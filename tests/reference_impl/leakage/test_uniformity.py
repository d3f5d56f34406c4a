"""The gate's p-values are uniform where nothing leaks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest
from tests.each import each
from tests.validator.leakage.replays import replay_inputs

from branchdrive.leakage.inputs import gate_features
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive_reference.leakage.uniformity import GateSize, gate_size, uniformity

pytestmark = pytest.mark.thorough

PROTOCOL = GateProtocol(alpha=0.05, num_permutations=499, num_frequencies=16, offsets_sd=(), num_replicates=1)
CHOSEN = np.s_[:, :, [0, 3, 50, 90, 120, 150, 156, 157]]
"""Discrepancies, ego and controls at some ticks, and availability, which has ties."""


TIED = {"rank_max_t", "concordance", "interaction"}
"""Statistics of ranks, and of products of commands, of which there are none here."""


@pytest.fixture(scope="module")
def size() -> GateSize:
    features = gate_features(replay_inputs(25, seed=7))[0][CHOSEN]
    features[:, 2] += 3.0  # a leak, which shuffling undoes
    return gate_size(features, seeds=range(1000), protocol=PROTOCOL)


@pytest.mark.parametrize("name", STATISTICS)
def test_p_values_are_uniform_over_seeds(size: GateSize, name: str) -> None:
    assert len(size.p_values[name]) == 1000
    # Where statistics tie, equal ones count as reached: there p may be larger than uniform, never smaller.
    alternative = "greater" if name in TIED else "two-sided"
    assert kstest(size.p_values[name], "uniform", alternative=alternative).pvalue > 0.01


def test_the_gate_fails_no_more_often_than_it_says(size: GateSize) -> None:
    assert size.failed.mean() < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 1000)
    rejected = {name: (p <= 0.2).mean() for name, p in size.p_values.items()}
    assert all(share < 0.24 and (name in TIED or share > 0.16) for name, share in rejected.items())


def test_seeds_are_independent_and_repeatable() -> None:
    features = gate_features(replay_inputs(10, seed=7))[0][CHOSEN]
    first, again = (gate_size(features, seeds=[3, 4], protocol=PROTOCOL) for _ in range(2))
    for name in STATISTICS:
        np.testing.assert_array_equal(first.p_values[name], again.p_values[name])
    assert first.p_values["max_t"][0] != first.p_values["max_t"][1]


@each("num_seeds", [20, 100, 1000])
@each("power", [1.0, 1.1, 1.5])
def test_the_distance_from_uniform_is_that_of_kolmogorov_and_smirnov(num_seeds: int, power: float) -> None:
    p_values = np.random.Generator(np.random.Philox(num_seeds)).random(num_seeds) ** power
    found, wanted = uniformity(p_values), kstest(p_values, "uniform")
    assert found.distance == pytest.approx(wanted.statistic, abs=1e-12)
    assert found.p == pytest.approx(wanted.pvalue, abs=0.03)


def test_what_fits_best_is_uniform_and_what_is_constant_is_not() -> None:
    assert uniformity((np.arange(50) + 0.5) / 50) == (pytest.approx(0.01), 1.0)
    assert uniformity(np.full(50, 0.001)) == (pytest.approx(0.999), pytest.approx(0.0, abs=1e-12))
