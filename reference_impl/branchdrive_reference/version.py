"""Names and versions that rollouts of the reference world carry."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version

__all__ = ["COLLECTOR_NAME", "COLLECTOR_VERSION", "SIMULATOR_NAME", "SIMULATOR_VERSION", "simulator_version"]

SIMULATOR_NAME = "branchdrive-world"
SIMULATOR_VERSION = "0.2.0"
"""Changes whenever the same specification would give other bytes."""

COLLECTOR_NAME = "branchdrive-collect"
COLLECTOR_VERSION = "0.2.0"


@cache
def simulator_version() -> str:
    """Version of the simulator and of the libraries that decide its bits: a collection never mixes them."""
    libraries = (f"{name}.{version(name)}" for name in ("numba", "numpy", "pymunk"))
    return f"{SIMULATOR_VERSION}+{'.'.join(libraries)}"
