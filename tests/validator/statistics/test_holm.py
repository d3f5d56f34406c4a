"""Holm's adjustment against the procedure as Holm states it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.statistics.holm import holm

P = st.lists(st.sampled_from([0.0, 1e-4, 2e-4, 0.001, 0.01, 0.0125, 0.02, 0.05, 0.3, 1.0]), max_size=6)


def rejected(p_values: list[float], alpha: float) -> set[int]:
    """Tests that the step-down procedure rejects, one after the other."""
    order = sorted(range(len(p_values)), key=lambda i: p_values[i])
    out: set[int] = set()
    for step, i in enumerate(order):
        if p_values[i] * (len(p_values) - step) > alpha:
            break
        out.add(i)
    return out


@given(P, st.sampled_from([0.001, 0.01, 0.05, 0.5]))
def test_an_adjusted_p_says_whether_the_procedure_rejects(p_values: list[float], alpha: float) -> None:
    assert set(np.flatnonzero(holm(p_values) <= alpha).tolist()) == rejected(p_values, alpha)


def test_a_worked_example() -> None:
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])


@given(P)
def test_adjusting_never_lowers_nor_reorders(p_values: list[float]) -> None:
    adjusted = holm(p_values)
    assert (adjusted >= p_values).all()
    assert (adjusted <= 1).all()
    assert (np.diff(adjusted[np.argsort(p_values, kind="stable")]) >= 0).all()


@pytest.mark.parametrize("wrong", [[[0.1]], [-0.1], [1.1], [float("nan")]])
def test_what_is_no_family_of_p_values_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match="p-values are"):
        holm(wrong)
