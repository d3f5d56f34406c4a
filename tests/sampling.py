"""Samples of cases that are alike: a few of them in `make test`, the others in `make thorough`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

__all__ = ["THOROUGH", "sampled"]

THOROUGH = pytest.mark.thorough


def sampled(cases: Iterable[Any], every: int) -> list[Any]:
    """Parameters of a test, of which `make test` runs the first and one of every so many after it.

    Args:
        cases: Values, or tuples of values for several names, as `pytest.mark.parametrize` takes them.
        every: Distance of two cases that `make test` runs.
    """
    values = (case if isinstance(case, tuple) else (case,) for case in cases)
    return [pytest.param(*value, marks=THOROUGH if place % every else ()) for place, value in enumerate(values)]
