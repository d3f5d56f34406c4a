"""Engines of others that tests work on where they are installed."""

from __future__ import annotations

from importlib.util import find_spec

import pytest

__all__ = ["needs_ray"]

needs_ray = pytest.mark.skipif(
    find_spec("ray") is None, reason="NOT TESTED: Ray is not installed, 80 MB; `make ray` installs it and runs this"
)
