"""The recorded state of one observation, as far as an image shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.text import quote
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.errors import UsageError
from branchdrive.raw.rollout import Rollout

__all__ = ["Actors", "Playback", "Snapshot"]

Array = NDArray[np.float64]

_LARGEST = 1e7
"""No number that is drawn is larger; the format ends positions here, in metres."""

_UNKNOWN_HEIGHTS_M = {"vehicle": 1.6, "cycle": 1.7, "pedestrian": 1.75, "static": 1.2}
"""Where heights are not recorded."""


@dataclass(frozen=True, eq=False)
class Actors:
    """Actors at one tick, world frame; arrays ``[actors]``."""

    actor_class: NDArray[np.object_]
    x_m: Array
    y_m: Array
    yaw_rad: Array
    length_m: Array
    width_m: Array
    height_m: Array

    def __len__(self) -> int:
        return len(self.x_m)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What one observation records of the world.

    Attributes:
        x_m: Centre of the ego's box.
        y_m: Centre of the ego's box.
        yaw_rad: Heading of the ego.
        length_m: Length of the ego.
        width_m: Width of the ego.
        height_m: Height of the ego.
        actors: The actors.
        light: State of the signal that governs the ego's lane; ``None`` where there is none.
        lane_id: Lane under the ego; ``None`` where there is none.
        route_m: The rest of the route, from the ego's progress on ``[vertices, 2]``.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    width_m: float
    height_m: float
    actors: Actors
    light: str | None
    lane_id: str | None
    route_m: Array


class Playback:
    """Snapshots of a rollout, observation by observation.

    Raises:
        UsageError: What is recorded cannot be drawn.
    """

    def __init__(self, rollout: Rollout) -> None:
        self._rollout = rollout
        column = rollout.column
        self.ticks: NDArray[np.int64] = column("observations", "tick").astype(np.int64)
        self._pose = np.stack(
            [column("observations", name).astype(float) for name in ("x_m", "y_m", "yaw_rad")], axis=1
        )
        self._progress_m = column("observations", "route_progress_m").astype(float)
        height_m = rollout.record["ego_height_m"]
        self._extents = (
            float(rollout.record["ego_length_m"]),
            float(rollout.record["ego_width_m"]),
            float(height_m) if height_m is not None else _UNKNOWN_HEIGHTS_M["vehicle"],
        )
        self._actor_tick = column("actors", "tick").astype(np.int64)
        self._actor_class = column("actors", "actor_class")
        names = ("x_m", "y_m", "yaw_rad", "length_m", "width_m")
        self._actors = np.stack([column("actors", name).astype(float) for name in names], axis=1)
        self._check(rollout)
        unknown = np.array([_UNKNOWN_HEIGHTS_M[name] for name in self._actor_class])
        recorded_m: Array = np.ma.filled(np.ma.asarray(column("actors", "height_m"), dtype=float), np.nan)
        self._height_m = np.where(np.isfinite(recorded_m), recorded_m, unknown)
        self._evidence_tick = column("evidence", "tick").astype(np.int64)
        self._light = column("evidence", "traffic_light")
        self._lane_id = column("evidence", "lane_id")
        self._route_m = np.stack([rollout.record["route_x_m"], rollout.record["route_y_m"]], axis=1).astype(float)
        steps = np.hypot(*np.diff(self._route_m, axis=0).T)
        self._route_arc_m = np.concatenate([np.zeros(1), np.cumsum(steps)])

    def _check(self, rollout: Rollout) -> None:
        """Refuse what cannot be drawn: a picture is no judgement of a dataset, so the bounds are wide."""
        route = [rollout.record["route_x_m"], rollout.record["route_y_m"]]
        numbers = (self._pose, self._progress_m, self._actors, self._extents, *route)
        faults = {
            "a route without two whole vertices": len({*map(len, route)}) != 1 or len(route[0]) < 2,
            "actors of unknown classes": not {*self._actor_class} <= {*_UNKNOWN_HEIGHTS_M},
            "poses, extents or progress that are no numbers": not all(
                (np.abs(values) <= _LARGEST).all() for values in numbers
            ),
        }
        found = [fault for fault, is_there in faults.items() if is_there]
        if found:
            raise UsageError(
                f"rollout {quote(rollout.rollout_id)} cannot be drawn: it has {found[0]}; run `branchdrive-validate`"
            )

    def window(self, offsets: Sequence[int] | None) -> list[int]:
        """Ticks of observations at some offsets from the branch; all ticks without offsets, none without a branch."""
        ticks = self.ticks.tolist()
        if offsets is None:
            return [tick for tick in ticks if tick % OBSERVATION_STRIDE_TICKS == 0]
        branch = self._rollout.branch_tick
        wanted = set() if branch is None else {branch + offset for offset in offsets}
        return [tick for tick in ticks if tick in wanted]

    def at(self, tick: int) -> Snapshot:
        """The state at the observation of a tick, which must exist."""
        row = int(np.searchsorted(self.ticks, tick))
        x, y, yaw = self._pose[row].tolist()
        first, after = np.searchsorted(self._actor_tick, [tick, tick + 1])
        here = slice(int(first), int(after))
        actors = Actors(self._actor_class[here], *self._columns(here), self._height_m[here])
        light = lane_id = None
        known = int(np.searchsorted(self._evidence_tick, tick))
        if known < len(self._evidence_tick) and self._evidence_tick[known] == tick:
            light, lane_id = (_text(values, known) for values in (self._light, self._lane_id))
        return Snapshot(x, y, yaw, *self._extents, actors, light, lane_id, self._rest_of_route(self._progress_m[row]))

    def _columns(self, rows: slice) -> tuple[Array, Array, Array, Array, Array]:
        x, y, yaw, length, width = self._actors[rows].T
        return x, y, yaw, length, width

    def _rest_of_route(self, progress_m: float) -> Array:
        ahead = self._route_arc_m > progress_m
        here = [np.interp(progress_m, self._route_arc_m, self._route_m[:, axis]) for axis in (0, 1)]
        return np.concatenate([[here], self._route_m[ahead]])


def _text(values: NDArray[np.object_], row: int) -> str | None:
    return None if np.ma.getmaskarray(values)[row] else str(values[row])
