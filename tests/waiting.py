"""Waiting for what must happen: machines are busy, so no test decides by a clock; one that hangs ends all the same."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["PATIENCE_S", "wait_for"]

PATIENCE_S = 900.0
"""After which a test hangs: a hundred times what anything here takes on an idle machine."""


def wait_for(condition: Callable[[], bool]) -> None:
    """Return when the condition holds; fail where it never does."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s, "it never happens"
        time.sleep(0.02)
