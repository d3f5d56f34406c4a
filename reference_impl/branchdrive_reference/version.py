"""Names and versions that rollouts of the reference world carry."""

from __future__ import annotations

__all__ = ["COLLECTOR_NAME", "COLLECTOR_VERSION", "SIMULATOR_NAME", "SIMULATOR_VERSION"]

SIMULATOR_NAME = "branchdrive-world"
SIMULATOR_VERSION = "0.2.0"
"""Changes whenever the same specification would give other bytes."""

COLLECTOR_NAME = "branchdrive-collect"
COLLECTOR_VERSION = "0.2.0"
