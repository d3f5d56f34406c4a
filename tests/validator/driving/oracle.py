"""A second, slow opinion on boxes and risk evidence, with shapely and plain Python."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.ops import nearest_points

from branchdrive.driving.box import Boxes

RANGE_M = 50.0
MIN_CLOSING_MPS = 0.1
CORRIDOR_MARGIN_M = 0.5


def boxes(*rows: tuple[float, float, float, float, float]) -> Boxes:
    """Boxes of rows (x, y, yaw, length, width)."""
    return Boxes(*np.array(rows, np.float64).reshape(-1, 5).T)


def polygon(x_m: float, y_m: float, yaw_rad: float, length_m: float, width_m: float) -> Polygon:
    """A box as the polygon of its corners."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    corners = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return Polygon(
        [
            (x_m + cos * a * length_m / 2 - sin * b * width_m / 2, y_m + sin * a * length_m / 2 + cos * b * width_m / 2)
            for a, b in corners
        ]
    )


def polygons(these: Boxes) -> Any:
    """Boxes as an array of polygons."""
    return np.array([polygon(*row) for row in zip(*these, strict=True)], dtype=object)


def gap_m(a: Boxes, b: Boxes) -> Any:
    """Gap of paired boxes by shapely."""
    return shapely.distance(polygons(a), polygons(b))


@dataclass(frozen=True)
class Actor:
    """One actor at one observation."""

    actor_id: int
    actor_class: str
    x_m: float
    y_m: float
    yaw_rad: float = 0.0
    length_m: float = 4.0
    width_m: float = 2.0
    vel_x_mps: float = 0.0
    vel_y_mps: float = 0.0

    @property
    def polygon(self) -> Polygon:
        return polygon(self.x_m, self.y_m, self.yaw_rad, self.length_m, self.width_m)


@dataclass(frozen=True)
class Ego:
    """The ego vehicle at one observation."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    speed_mps: float = 0.0
    length_m: float = 4.0
    width_m: float = 2.0

    @property
    def polygon(self) -> Polygon:
        return polygon(self.x_m, self.y_m, self.yaw_rad, self.length_m, self.width_m)


def closing_mps(ego: Ego, actor: Actor) -> float:
    """Closing speed along the line between the closest points, 0 on overlap."""
    own, other = nearest_points(ego.polygon, actor.polygon)
    gap = own.distance(other)
    if gap == 0:
        return 0.0
    nx, ny = (other.x - own.x) / gap, (other.y - own.y) / gap
    rel_x = actor.vel_x_mps - ego.speed_mps * math.cos(ego.yaw_rad)
    rel_y = actor.vel_y_mps - ego.speed_mps * math.sin(ego.yaw_rad)
    return -(rel_x * nx + rel_y * ny)


def evidence(ego: Ego, actors: list[Actor], route: list[tuple[float, float]]) -> dict[str, Any]:
    """Evidence of one frame as the definitions read; ``None`` where a quantity is unavailable."""
    line = LineString(route)
    separation, ttc, vehicles, pedestrians = [], [], [], []
    for actor in actors:
        gap = ego.polygon.distance(actor.polygon)
        if gap > RANGE_M:
            continue
        closing = closing_mps(ego, actor)
        if actor.actor_class in ("vehicle", "cycle"):
            vehicles.append((gap, actor.actor_id, closing))
        if actor.actor_class == "pedestrian":
            pedestrians.append((gap, actor.actor_id))
        if actor.actor_class == "static":
            corridor_m = ego.width_m / 2 + CORRIDOR_MARGIN_M
            if line.distance(actor.polygon) > corridor_m:
                continue
        separation.append((gap, actor.actor_id))
        if gap == 0:
            ttc.append((0.0, actor.actor_id))
        elif closing > MIN_CLOSING_MPS:
            ttc.append((gap / closing, actor.actor_id))
    nothing = (None, None, None)
    return {
        "num_actors": len(actors),
        "separation": min(separation, default=nothing)[:2],
        "ttc": min(ttc, default=nothing)[:2],
        "nearest_vehicle": min(vehicles, default=nothing),
        "nearest_pedestrian": min(pedestrians, default=nothing)[:1],
    }
