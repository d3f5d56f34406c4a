"""Semantic maps of the small valid dataset, drawn from the definition: what is recorded lies on each pixel's centre."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from tests.synthetic import BRANCH_TICK, to_table
from tests.validator.engine.rules.case import NOMINAL, SHARD_0
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import table_schema
from branchdrive.contract.semantic_bev import ROUTE_WIDTH_M, SemanticChannel, SemanticClass
from branchdrive.driving.route import project
from branchdrive.testing.media import png

__all__ = ["LIGHT_TICK", "MAP_AT", "Change", "Pixels", "add_map_element", "add_semantic_map"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Change = Callable[[Pixels], Pixels]

MAP_AT = {"table": "frames", "rollout_id": NOMINAL, "tick": BRANCH_TICK}
"""Where the map is."""

LIGHT_TICK = 30
"""An observation of the window of that attempt at which a signal governs its lane."""

SIDE_PX, PX_PER_M = 64, 1.0
CAMERA = {
    "name": "bev", "stream": "semantic_bev", "projection": "top_down", "width_px": SIDE_PX, "height_px": SIDE_PX,
    "px_per_m": PX_PER_M, "origin_row_px": SIDE_PX / 2, "origin_column_px": SIDE_PX / 2,
}  # fmt: skip

_LANE_WIDTH_M = 20.0
_LANE_ID = "road1:-1"
_LIGHTS = {"red": SemanticClass.RED_LIGHT, "yellow": SemanticClass.YELLOW_LIGHT, "green": SemanticClass.GREEN_LIGHT}


def _same(pixels: Pixels) -> Pixels:
    return pixels


def add_semantic_map(
    d: Draft,
    *,
    ground: Change = _same,
    signs: Change = _same,
    vehicles: Change = _same,
    people: Change = _same,
    whole: Change = _same,
    rollout_id: str = NOMINAL,
    tick: int = BRANCH_TICK,
) -> None:
    """Claim semantic maps, and draw that of the first nominal at its branch, or another one.

    Args:
        d: The draft.
        ground: Changes road and route before they are covered.
        signs: Changes lights and stop signs before that.
        vehicles: Changes vehicles and the ego before that.
        people: Changes pedestrians before that.
        whole: Changes what is seen in the end.
        rollout_id: Attempt of the first shard.
        tick: When it is taken.
    """
    moment = {"rollout_id": rollout_id, "tick": tick}
    parts = [
        change(draw(d, moment))
        for draw, change in ((_ground, ground), (_signs, signs), (_vehicles, vehicles), (_people, people))
    ]
    channels = np.bitwise_or.reduce([part & 0xF0 for part in parts])
    pixels = whole(channels | np.maximum.reduce([part & 15 for part in parts]))
    content = png(np.ascontiguousarray(pixels, np.uint8))
    d.descriptor["streams"].append("semantic_bev")
    d.descriptor["cameras"] = [*d.descriptor.get("cameras", []), CAMERA]
    for shard in d.tables.values():
        shard.setdefault("frames", table_schema("frames").empty_table())
    row = {**moment, "camera": "bev", "file": "bev.bin", "offset_bytes": 0, "size_bytes": len(content)}
    row |= {"checksum": hashlib.sha256(content).hexdigest()[:16], "encoding": "png"}
    d.append("frames", to_table("frames", {name: [value] for name, value in row.items()}), folder=SHARD_0)
    d.before_seal(lambda root: (root / SHARD_0 / "bev.bin").write_bytes(content))


def _centres(d: Draft, moment: dict[str, Any]) -> tuple[dict[str, Any], Array, Array]:
    """The ego, and the centres of all pixels in the world ``[rows, columns]``."""
    (ego,) = d.take("observations", **moment).to_pylist()
    rows, columns = np.mgrid[:SIDE_PX, :SIDE_PX] + 0.5
    ahead, left = (SIDE_PX / 2 - rows) / PX_PER_M, (SIDE_PX / 2 - columns) / PX_PER_M
    cos, sin = np.cos(ego["yaw_rad"]), np.sin(ego["yaw_rad"])
    return ego, ego["x_m"] + cos * ahead - sin * left, ego["y_m"] + sin * ahead + cos * left


def _inside(box: dict[str, Any], x: Array, y: Array) -> NDArray[np.bool_]:
    """Pixels whose centres lie in a box, which is a pixel large at least ``[rows, columns]``."""
    cos, sin = np.cos(box["yaw_rad"]), np.sin(box["yaw_rad"])
    dx, dy = x - box["x_m"], y - box["y_m"]
    inside = np.abs(cos * dx + sin * dy) <= max(box["length_m"] / 2, 0.5)
    return np.asarray(inside & (np.abs(cos * dy - sin * dx) <= max(box["width_m"] / 2, 0.5)))


def _vehicles(d: Draft, moment: dict[str, Any]) -> Pixels:
    """Recorded vehicles and the ego."""
    ego, x, y = _centres(d, moment)
    (record,) = d.take("rollouts", rollout_id=moment["rollout_id"]).to_pylist()
    own = {**ego, "length_m": record["ego_length_m"], "width_m": record["ego_width_m"]}
    others = [one for one in d.take("actors", **moment).to_pylist() if one["actor_class"] in ("vehicle", "cycle")]
    pixels = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
    for box, channel in [*((one, SemanticChannel.OTHER_VEHICLE) for one in others), (own, SemanticChannel.EGO)]:
        pixels[_inside(box, x, y)] |= np.uint8(channel | SemanticClass.VEHICLE)
    return pixels


def _people(d: Draft, moment: dict[str, Any]) -> Pixels:
    """Recorded pedestrians."""
    _, x, y = _centres(d, moment)
    pixels = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
    for one in d.take("actors", **moment).to_pylist():
        if one["actor_class"] == "pedestrian":
            pixels[_inside(one, x, y)] = SemanticClass.PEDESTRIAN
    return pixels


def add_map_element(d: Draft, kind: str, ahead_m: float, left_m: float, *, lane_id: str | None = _LANE_ID) -> None:
    """Put a signal, a sign or a stop line three metres long into the town, at a place seen by the ego at a tick.

    Args:
        d: The draft, with maps.
        kind: Kind of the element.
        ahead_m: Where it is, seen from the first nominal at `LIGHT_TICK`.
        left_m: The same, to the left; the right end of a line.
        lane_id: Lane that it is for.
    """
    (ego,) = d.take("observations", rollout_id=NOMINAL, tick=LIGHT_TICK).to_pylist()
    (record,) = d.take("rollouts", rollout_id=NOMINAL).to_pylist()
    cos, sin = np.cos(ego["yaw_rad"]), np.sin(ego["yaw_rad"])
    across = np.array([left_m, left_m + 3.0] if kind == "stop_line" else [left_m])
    element = {
        "town": record["town"], "element_id": f"{kind} {ahead_m} {left_m}", "kind": kind, "lane_id": lane_id,
        "x_m": (ego["x_m"] + cos * ahead_m - sin * across).tolist(),
        "y_m": (ego["y_m"] + sin * ahead_m + cos * across).tolist(),
    }  # fmt: skip
    row = pa.Table.from_pylist([element], schema=table_schema("map"))
    for folder, shard in d.tables.items():
        if record["town"] in shard["map"]["town"].to_pylist():
            d.append("map", row, folder=folder)


def _signs(d: Draft, moment: dict[str, Any]) -> Pixels:
    """Signals of the ego's lane in their colour, stop signs, and their stop lines."""
    _, x, y = _centres(d, moment)
    pixels = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
    if "map" not in d.tables[SHARD_0]:
        return pixels
    (record,) = d.take("rollouts", rollout_id=moment["rollout_id"]).to_pylist()
    (evidence,) = d.take("evidence", **moment).to_pylist()
    elements = [one for one in d.tables[SHARD_0]["map"].to_pylist() if one["town"] == record["town"]]
    shown = {"signal": _LIGHTS.get(evidence["traffic_light"]), "stop_sign": SemanticClass.STOP_SIGN}
    for sign in elements:
        kind = shown.get(sign["kind"])
        lanes = (evidence["lane_id"],) if sign["kind"] == "signal" else (sign["lane_id"],)
        if kind is None or sign["lane_id"] is None or sign["lane_id"] not in lanes:
            continue
        lines = [one for one in elements if one["kind"] == "stop_line" and one["lane_id"] == sign["lane_id"]]
        for one in (sign, *lines):
            for share in np.linspace(0, 1, 7):
                end_x, end_y = one["x_m"][-1], one["y_m"][-1]
                at_x, at_y = (
                    one["x_m"][0] + share * (end_x - one["x_m"][0]),
                    one["y_m"][0] + share * (end_y - one["y_m"][0]),
                )
                pixels[np.hypot(x - at_x, y - at_y) <= 0.75] = kind
    return pixels


def _ground(d: Draft, moment: dict[str, Any]) -> Pixels:
    """A lane along the route, and what remains of the route from the ego on."""
    ego, x, y = _centres(d, moment)
    (record,) = d.take("rollouts", rollout_id=moment["rollout_id"]).to_pylist()
    line = np.array(record["route_x_m"]), np.array(record["route_y_m"])
    place = project(x.ravel(), y.ravel(), *line)
    (here,) = project(np.array([ego["x_m"]]), np.array([ego["y_m"]]), *line).progress_m
    offset, progress = np.abs(place.offset_m).reshape(x.shape), place.progress_m.reshape(x.shape)
    pixels = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
    pixels[offset <= _LANE_WIDTH_M / 2] = SemanticChannel.DRIVABLE_AREA | SemanticClass.ROAD
    pixels[(offset <= ROUTE_WIDTH_M / 2) & (progress >= here)] |= np.uint8(SemanticChannel.REMAINING_ROUTE)
    return pixels
