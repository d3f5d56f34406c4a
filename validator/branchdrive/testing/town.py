"""Maps of towns for invented drives: a lane along every route on open ground, and elements without traffic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from branchdrive.contract.columns import table_schema
from branchdrive.testing.drive import InventedScene, on_grid
from branchdrive.testing.group import Tables, by_key, route_polyline

__all__ = ["with_map"]

_LANE_ID = "road1:-1"
"""Lane of all routes."""

_LANE_WIDTH_M = 20.0
"""Wide enough for every policy."""

_GROUND_M = np.array([[-60.0, 220.0, 220.0, -60.0], [-60.0, -60.0, 60.0, 60.0]])
"""Along and across the straight continuation of a route's first metre: open ground around everything driven."""


def with_map(tables: Tables, towns: Iterable[str], scenes: Mapping[int, InventedScene]) -> Tables:
    """Tables of a shard with the maps of its towns; evidence names the lane of the routes.

    Args:
        tables: The shard, actors and evidence included.
        towns: Where its groups drive.
        scenes: Scenes of all groups of the dataset by number, so that every shard has the same map of a town.
    """
    evidence = tables["evidence"]
    place = evidence.schema.get_field_index("lane_id")
    lanes = pa.array([_LANE_ID] * len(evidence))
    elements = [row for town in sorted(set(towns)) for row in _elements(town, scenes)]
    return {
        **tables,
        "evidence": evidence.set_column(place, evidence.schema.field(place), lanes),
        "map": by_key("map", pa.Table.from_pylist(elements, schema=table_schema("map"))),
    }


def _elements(town: str, scenes: Mapping[int, InventedScene]) -> list[dict[str, Any]]:
    """Rows of the map of a town; the lanes of its routes share one id."""
    rows: list[dict[str, Any]] = []
    for index, scene in scenes.items():
        if scene.town != town:
            continue
        x, y = route_polyline(scene.route)
        start, heading = scene.route.start, scene.route.heading_rad
        (along, across), cos, sin = _GROUND_M, np.cos(heading), np.sin(heading)
        rows += [
            {
                "element_id": f"lane-{index}", "kind": "lane", "lane_id": _LANE_ID, "x_m": x, "y_m": y,
                "z_m": np.zeros(len(x)), "width_m": np.full(len(x), _LANE_WIDTH_M), "speed_limit_mps": 13.5,
            },
            {
                "element_id": f"ground-{index}", "kind": "road_area",
                "x_m": on_grid(start[0] + cos * along - sin * across),
                "y_m": on_grid(start[1] + sin * along + cos * across),
            },
        ]  # fmt: skip
    far = {"x_m": [5000.0, 5010.0, 5020.0], "y_m": [0.0, 0.0, 1.0]}
    rows += [
        {"element_id": "far-lane", "kind": "lane", "lane_id": "far", **far, "width_m": [3.0, 3.5, 4.0]},
        {"element_id": "far-shoulder", "kind": "shoulder", "lane_id": "far", **far, "width_m": [1.0, 1.0, 1.0]},
        {"element_id": "far-border", "kind": "lane_border", "lane_id": "far", **far, "marking": "broken"},
        {"element_id": "far-wall", "kind": "wall", **far},
        {"element_id": "far-crossing", "kind": "crossing", **far},
        {"element_id": "far-signal", "kind": "signal", "x_m": [5020.0], "y_m": [0.0], "z_m": [4.0]},
    ]
    return [{"town": town, **row} for row in rows]
