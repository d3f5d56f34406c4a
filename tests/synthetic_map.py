"""The small valid dataset with maps of its towns."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
from tests.driving import SCENES
from tests.synthetic import SHARDS, Tables, base_tables, descriptor, route_polyline, shared

from branchdrive.contract.columns import table_schema

__all__ = ["map_descriptor", "map_tables"]

_LANE_WIDTH_M = 20.0
"""Wide enough for every policy."""

_GROUND_M = np.array([[-60.0, 220.0, 220.0, -60.0], [-60.0, -60.0, 60.0, 60.0]])
"""Along and across the straight continuation of a route's first metre: open ground around everything driven."""


@cache
def map_tables() -> dict[str, Tables]:
    """`base_tables` with maps: a lane along every route on open ground, and further elements that nobody is on."""
    lane = table_schema("evidence").get_field_index("lane_id")
    tables: dict[str, Tables] = {}
    for folder, groups in SHARDS.items():
        evidence = base_tables()[folder]["evidence"]
        named = pa.array(["road1:-1"] * len(evidence))
        evidence = evidence.set_column(lane, evidence.schema.field(lane), named)
        elements = [row for town in sorted({SCENES[index].town for index in groups}) for row in _elements(town)]
        rows = pa.Table.from_pylist(elements, schema=table_schema("map"))
        tables[folder] = {**base_tables()[folder], "evidence": evidence, "map": rows}
    return shared(tables)


def _elements(town: str) -> list[dict[str, Any]]:
    """Rows of the map of a town; the lanes of its routes share one id."""
    rows: list[dict[str, Any]] = []
    for index, scene in enumerate(SCENES):
        if scene.town != town:
            continue
        x, y = route_polyline(scene.route)
        start, heading = scene.route.start, scene.route.heading_rad
        (along, across), cos, sin = _GROUND_M, np.cos(heading), np.sin(heading)
        rows += [
            {
                "element_id": f"lane-{index}", "kind": "lane", "lane_id": "road1:-1", "x_m": x, "y_m": y,
                "z_m": np.zeros(len(x)), "width_m": np.full(len(x), _LANE_WIDTH_M), "speed_limit_mps": 13.5,
            },
            {
                "element_id": f"ground-{index}", "kind": "road_area",
                "x_m": start[0] + cos * along - sin * across, "y_m": start[1] + sin * along + cos * across,
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


def map_descriptor() -> dict[str, Any]:
    """Descriptor document of `map_tables`."""
    document = descriptor()
    return {**document, "streams": [*document["streams"], "map"]}
