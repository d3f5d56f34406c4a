"""Last bits decide nothing: results of inputs that differ by them alone agree to 1e-9, and no choice or count differs.

Inputs are perturbed by a relative noise of 1e-15 to 1e-14, equal values alike, as another processor would have rounded
what they were computed from. Most is at stake where numbers tie, so some benchmarks lie on a lattice: groups occur
twice, errors of different groups are equal but for rounding, and so are their sums.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.sampling import sampled
from tests.validator.benchmark.lattice import Inputs, changed, tied
from tests.validator.benchmark.samples import data, noise, prediction_set, risk_fit, small_protocol
from tests.validator.engine.rules.benchmark_release import BenchmarkDraft

from branchdrive.benchmark.results import results_document
from branchdrive.contract.comparison import TOLERANCE, document_mismatches
from branchdrive.statistics.rounding import slack

Array = NDArray[np.float64]


def drawn() -> Inputs:
    return small_protocol(), data(), prediction_set()


def released() -> Inputs:
    draft = BenchmarkDraft()
    return draft.protocol, draft.data, draft.predictions


INPUTS = {
    "released": released,
    "drawn": drawn,
    "tied": partial(tied, 0.05),
    "tied often": partial(tied, 0.5),
    "tied and large": partial(tied, 0.05, 1e4),
}


def perturbed(inputs: Inputs, seed: int) -> Inputs:
    rng = np.random.default_rng(seed)

    def change(values: Array) -> Array:
        distinct, place = np.unique(values, return_inverse=True)
        # Numbers that nothing but rounding tells apart, as of recorded grids, move together: ranks order them.
        kind = np.cumsum(np.diff(distinct, prepend=distinct[:1]) > slack(distinct))
        size = (rng.choice([-1.0, 1.0], len(distinct)) * rng.uniform(1e-15, 1e-14, len(distinct)))[kind]
        return np.asarray((distinct * (1 + size))[place].reshape(values.shape))

    return changed(inputs, change)


@pytest.mark.parametrize("name", sampled(INPUTS, every=4))
def test_results_of_inputs_that_differ_in_last_bits_agree(name: str) -> None:
    inputs = INPUTS[name]()
    expected = results_document(*inputs, risk_fit(), noise())
    for seed in range(2):
        found = results_document(*perturbed(inputs, seed), risk_fit(), noise())
        assert not list(document_mismatches(expected, found, tolerance=TOLERANCE))
