"""A straight road along x with an ego in its right lane, and the road users that a test puts around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from branchdrive_reference.rendering.patch import Town
from branchdrive_reference.rendering.snapshot import Actors, Snapshot

__all__ = ["CAR", "CONE", "PERSON", "ROAD", "moved", "snapshot", "straight_town"]

Row = tuple[str, float, float, float]
"""Class, x, y and yaw of an actor."""

CAR, PERSON, CONE = (4.6, 1.9, 1.5), (0.5, 0.6, 1.75), (0.4, 0.4, 0.8)
_EXTENTS = {"vehicle": CAR, "cycle": (1.8, 0.6, 1.7), "pedestrian": PERSON, "static": CONE}

ROAD: tuple[dict[str, Any], ...] = (
    {"element_id": "right", "kind": "lane", "lane_id": "right", "x_m": np.array([-200.0, 200.0]),
     "y_m": np.array([-1.75, -1.75]), "width_m": np.array([3.5, 3.5]), "speed_limit_mps": 13.9},
    {"element_id": "left", "kind": "lane", "lane_id": "left", "x_m": np.array([200.0, -200.0]),
     "y_m": np.array([1.75, 1.75]), "width_m": np.array([3.5, 3.5]), "speed_limit_mps": 13.9},
    {"element_id": "line", "kind": "lane_border", "lane_id": "right", "x_m": np.array([-200.0, 200.0]),
     "y_m": np.array([0.0, 0.0]), "marking": "solid"},
    {"element_id": "stop", "kind": "stop_line", "lane_id": "right", "x_m": np.array([30.0, 30.0]),
     "y_m": np.array([-3.3, -0.2]), "marking": "solid"},
    {"element_id": "signal", "kind": "signal", "lane_id": "right", "x_m": np.array([30.0]), "y_m": np.array([-5.0])},
    {"element_id": "sign", "kind": "stop_sign", "lane_id": "left", "x_m": np.array([-30.0]), "y_m": np.array([5.0])},
)  # fmt: skip


def straight_town() -> Town:
    """The road as a town."""
    return Town(ROAD)


def snapshot(
    actors: Sequence[Row] = (), *, light: str | None = None, x_m: float = 0.0, yaw_rad: float = 0.0
) -> Snapshot:
    """The ego on the right lane, with actors at world poses and of the usual extents."""
    extents = np.array([_EXTENTS[row[0]] for row in actors]).reshape(-1, 3)
    poses = np.array([row[1:] for row in actors], float).reshape(-1, 3)
    bodies = Actors(np.array([row[0] for row in actors], object), *poses.T, *extents.T)
    route = np.array([[x_m, -1.75], [200.0, -1.75]])
    return Snapshot(x_m, -1.75, yaw_rad, 4.7, 1.9, 1.5, bodies, light, "right", route)


def moved(state: Snapshot, **changes: Any) -> Snapshot:
    """The same state with other values."""
    return replace(state, **changes)
