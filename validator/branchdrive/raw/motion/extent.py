"""How large road users can be, and how many vehicles of a shard are narrower or wider than road vehicles.

Source: spec/05-raw-streams.md#plausible-extents.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.raw.motion.tracks import tracks
from branchdrive.raw.shard_view import ShardView

__all__ = ["most_m", "vehicle_widths"]


def most_m(class_name: str) -> tuple[float, float, float]:
    """Largest length, width and height of a class; infinite where nothing bounds it."""
    bounds = physical_bounds()
    return {
        "vehicle": (bounds.vehicle_length_m, bounds.vehicle_section_m, bounds.vehicle_section_m),
        "cycle": (bounds.cycle_m,) * 3,
        "pedestrian": (bounds.pedestrian_m,) * 3,
    }.get(class_name, (np.inf,) * 3)


def vehicle_widths(view: ShardView) -> dict[str, tuple[int, int, int]]:
    """Numbers of egos and of tracks of vehicles that are too narrow, too wide, and of all, by their table."""
    found = {"rollouts": _counts(view.rollouts["ego_width_m"])}
    if "actors" in view:
        stream = view.stream("actors")
        row, previous, *_ = view.cached(tracks)
        rows = row[previous < 0]
        found["actors"] = _counts(stream["width_m"][rows[stream.equals("actor_class", "vehicle")[rows]]])
    return found


def _counts(width_m: NDArray[np.float32]) -> tuple[int, int, int]:
    bounds = physical_bounds()
    return (
        int((width_m < bounds.narrow_vehicle_m).sum()),
        int((width_m > bounds.wide_vehicle_m).sum()),
        len(width_m),
    )
