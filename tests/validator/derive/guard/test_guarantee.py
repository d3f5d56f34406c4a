"""The printed promise: its numbers are those of the protocol, and its limits are in it."""

from __future__ import annotations

import pytest

from branchdrive.derive.guard.calibration import ALPHA, DELTA
from branchdrive.derive.guard.guarantee import GLOBAL_MARGIN, GUARANTEE, LEARN_THEN_TEST
from branchdrive.derive.guard.path import TOLERANCE_M


def test_the_numbers_are_those_of_the_protocol() -> None:
    assert f"more than {TOLERANCE_M:g} m below" in GUARANTEE
    assert f"at most {ALPHA:g}." in GUARANTEE
    assert f"probability at least {1 - DELTA:g} " in LEARN_THEN_TEST
    assert f"at most {ALPHA:g}." in LEARN_THEN_TEST


@pytest.mark.parametrize(
    "limit",
    [
        "exchangeable",
        "before any calibration outcome was read",
        "on average only",
        "not given that the selector intervenes",
        "collisions",
        "outside of the bank",
        "closed-loop",
        "another simulator",
    ],
)
def test_the_limits_are_part_of_the_text(limit: str) -> None:
    assert limit in GUARANTEE


def test_the_global_margin_promises_nothing() -> None:
    assert "without a finite-sample guarantee" in GLOBAL_MARGIN
