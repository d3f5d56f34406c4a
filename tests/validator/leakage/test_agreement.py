"""Rows that agree: exactly, within a tolerance, with what is unavailable."""

from __future__ import annotations

import numpy as np
import pytest
from tests.each import each

from branchdrive.leakage.agreement import rows_agree


def test_scores_that_differ_between_groups_alone_agree() -> None:
    scores = np.broadcast_to(np.random.default_rng(0).normal(size=(5, 1, 13)), (5, 13, 13))
    assert rows_agree(scores)


def test_one_row_of_one_group_disagrees() -> None:
    scores = np.zeros((5, 13, 13))
    scores[3, 12, 0] = 5e-324
    assert not rows_agree(scores)


def test_rounding_is_forgiven_on_request() -> None:
    scores = np.zeros((5, 13, 13))
    scores[3, 12, 0] = 1e-7
    assert not rows_agree(scores)
    assert rows_agree(scores, atol=1e-6)


@each(
    ("rows", "expected"),
    [
        ([np.nan, np.nan], True),
        ([np.nan, 0.0], False),
        ([0.0, np.nan], False),
        ([np.inf, np.inf], True),
        ([np.inf, 1.0], False),
        ([np.inf, np.nan], False),
        ([0.0, -0.0], True),
        ([1e308, -1e308], False),
    ],
)
def test_unavailable_agrees_with_unavailable_alone(rows: list[float], expected: bool) -> None:
    assert rows_agree([rows]) is expected


def test_values_need_rows() -> None:
    with pytest.raises(ValueError, match=r"shape \[3\], not \[groups, rows"):
        rows_agree([1.0, 2.0, 3.0])
