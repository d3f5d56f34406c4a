"""Semantic maps of the small valid dataset, drawn from the definition: what is recorded lies on each pixel's centre."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.synthetic import BRANCH_TICK, to_table
from tests.validator.engine.rules.case import NOMINAL, SHARD_0
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import table_schema
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass
from branchdrive.driving.route import project
from branchdrive.testing.media import png

__all__ = ["MAP_AT", "Change", "Pixels", "add_semantic_map"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Change = Callable[[Pixels], Pixels]

MAP_AT = {"table": "frames", "rollout_id": NOMINAL, "tick": BRANCH_TICK}
"""Where the map is."""

SIDE_PX, PX_PER_M = 64, 1.0
CAMERA = {
    "name": "bev", "stream": "semantic_bev", "projection": "top_down", "width_px": SIDE_PX, "height_px": SIDE_PX,
    "px_per_m": PX_PER_M, "origin_row_px": SIDE_PX / 2, "origin_column_px": SIDE_PX / 2,
}  # fmt: skip

_LANE_WIDTH_M, _ROUTE_WIDTH_M = 20.0, 2.0


def _same(pixels: Pixels) -> Pixels:
    return pixels


def add_semantic_map(
    d: Draft, *, bodies: Change = _same, ground: Change = _same, whole: Change = _same, tick: int = BRANCH_TICK
) -> None:
    """Claim semantic maps, and draw that of the first nominal at its branch or a tick.

    Args:
        d: The draft.
        bodies: Changes vehicles before they cover the ground.
        ground: Changes road and route before that.
        whole: Changes what is seen in the end.
        tick: When it is taken.
    """
    moment = {"rollout_id": NOMINAL, "tick": tick}
    vehicles, road = bodies(_bodies(d, moment)), ground(_ground(d, moment))
    pixels = whole((vehicles | road) & 0xF0 | np.maximum(vehicles & 15, road & 15))
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


def _bodies(d: Draft, moment: dict[str, Any]) -> Pixels:
    """Recorded vehicles and the ego."""
    ego, x, y = _centres(d, moment)
    (record,) = d.take("rollouts", rollout_id=moment["rollout_id"]).to_pylist()
    own = {**ego, "length_m": record["ego_length_m"], "width_m": record["ego_width_m"]}
    others = [one for one in d.take("actors", **moment).to_pylist() if one["actor_class"] in ("vehicle", "cycle")]
    channels = [*[SemanticChannel.OTHER_VEHICLE] * len(others), SemanticChannel.EGO]
    pixels = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
    for box, channel in zip([*others, own], channels, strict=True):
        cos, sin = np.cos(box["yaw_rad"]), np.sin(box["yaw_rad"])
        dx, dy = x - box["x_m"], y - box["y_m"]
        inside = np.abs(cos * dx + sin * dy) <= max(box["length_m"] / 2, 0.5)
        inside &= np.abs(cos * dy - sin * dx) <= max(box["width_m"] / 2, 0.5)
        pixels[inside] |= np.uint8(channel | SemanticClass.VEHICLE)
    assert all((pixels & channel).any() for channel in {*channels})
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
    pixels[(offset <= _ROUTE_WIDTH_M / 2) & (progress >= here)] |= np.uint8(SemanticChannel.REMAINING_ROUTE)
    return pixels
