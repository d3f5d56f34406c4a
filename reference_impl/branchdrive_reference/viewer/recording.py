"""A branch group as a recording of rerun: an entity for each candidate, all on one time line that is 0 at the branch.

Boxes and paths lie in the frame of the town. Source: rerun.io, recordings and blueprints.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from branchdrive.contract.timing import TICK_S
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.rollout import Rollout

__all__ = ["save_recording"]

_TIMELINE = "since_branch"
_ROAD = (128, 128, 128)
_HEIGHT_M = 1.5
"""Height of a box whose own is not recorded."""

_AREA_KINDS = ("lane", "shoulder", "parking")


def save_recording(group: BranchGroup, elements: Sequence[dict[str, Any]], path: Path) -> int:
    """Write a group with its blueprint to an .rrd file.

    Args:
        group: With a nominal rollout.
        elements: Elements of the map of its town, rows of the table `map`; none where there is no map.
        path: The file.

    Returns:
        Candidates that it shows.

    Raises:
        UsageError: The group has no nominal rollout.
    """
    candidates = {key: rollout for key, rollout in group.candidates.items() if rollout.branch_s is not None}
    recording = rr.RecordingStream("branchdrive", recording_id=group.group_id)
    recording.save(path, default_blueprint=_blueprint())
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _log_map(recording, elements)
    for key, rollout in candidates.items():
        _log_candidate(recording, key, rollout)
    recording.flush()
    recording.disconnect()
    return len(candidates)


def _blueprint() -> rrb.Blueprint:
    charts = rrb.Vertical(
        rrb.TimeSeriesView(name="speed, m/s", origin="speed"),
        rrb.TimeSeriesView(name="separation, m", origin="separation"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Spatial3DView(name="futures", origin="world"), charts, column_shares=[2, 1]),
        rrb.TimePanel(timeline=_TIMELINE),
        collapse_panels=True,
    )


def _log_map(recording: rr.RecordingStream, elements: Sequence[dict[str, Any]]) -> None:
    lines: dict[str, list[Any]] = {}
    for element in elements:
        flat = np.zeros(len(element["x_m"]))
        lines.setdefault(element["kind"], []).append(np.stack([element["x_m"], element["y_m"], flat], axis=1))
    for kind, strips in lines.items():
        radius = 0.2 if kind in _AREA_KINDS else 0.1
        shown = [strip for strip in strips if len(strip) > 1]
        recording.log(f"world/map/{kind}", rr.LineStrips3D(shown, radii=radius, colors=_ROAD), static=True)


def _log_candidate(recording: rr.RecordingStream, key: str, rollout: Rollout) -> None:
    """Path, box, actors, speed and separation of one candidate."""
    root, zero_s = f"world/candidates/{key}", rollout.branch_s or 0.0
    x, y, yaw, speed = (rollout.column("observations", name) for name in ("x_m", "y_m", "yaw_rad", "speed_mps"))
    size = [(rollout.record[f"ego_{name}_m"] or _HEIGHT_M) / 2 for name in ("length", "width", "height")]
    recording.log(f"{root}/path", rr.LineStrips3D([np.stack([x, y, np.zeros(len(x))], axis=1)]), static=True)
    actors = rollout.actors if "actors" in rollout.tables else {}
    for place, (time_s, tick) in enumerate(zip(rollout.t_s, rollout.column("observations", "tick"), strict=True)):
        recording.set_time(_TIMELINE, duration=float(time_s - zero_s))
        ego = _boxes([x[place]], [y[place]], [yaw[place]], [size], [key])
        recording.log(f"{root}/ego", ego)
        recording.log(f"speed/{key}", rr.Scalars(float(speed[place])))
        if int(tick) in actors:
            recording.log(f"{root}/actors", _actors(actors[int(tick)].to_pydict()))
    if "evidence" in rollout.tables:
        _log_separation(recording, key, rollout, zero_s)


def _log_separation(recording: rr.RecordingStream, key: str, rollout: Rollout, zero_s: float) -> None:
    separation_m = np.ma.filled(rollout.column("evidence", "separation_m").astype(float), np.nan)
    for tick, value in zip(rollout.column("evidence", "tick"), separation_m, strict=True):
        if np.isfinite(value):
            recording.set_time(_TIMELINE, duration=float(tick * TICK_S - zero_s))
            recording.log(f"separation/{key}", rr.Scalars(float(value)))


def _actors(rows: dict[str, list[Any]]) -> rr.Boxes3D:
    sizes = zip(rows["length_m"], rows["width_m"], rows["height_m"], strict=True)
    half = [[(side or _HEIGHT_M) / 2 for side in size] for size in sizes]
    return _boxes(rows["x_m"], rows["y_m"], rows["yaw_rad"], half, rows["actor_class"])


def _boxes(x: Sequence[float], y: Sequence[float], yaw: Sequence[float], half: Any, labels: Any) -> rr.Boxes3D:
    """Boxes on the ground, turned about the vertical."""
    heights = [sides[2] for sides in half]
    turned = [rr.Quaternion(xyzw=[0.0, 0.0, float(np.sin(a / 2)), float(np.cos(a / 2))]) for a in yaw]
    centres = np.stack([x, y, heights], axis=1) if len(heights) else np.zeros((0, 3))
    return rr.Boxes3D(centers=centres, half_sizes=half, quaternions=turned, labels=labels, show_labels=False)
