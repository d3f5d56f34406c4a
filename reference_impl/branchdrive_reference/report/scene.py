"""A group as the player shows it: of every candidate what can be read, and in words what cannot be drawn.

Pictures of `branchdrive draw` refuse a group that is not whole; here every group opens. Times are ticks since the
branch, poses are of the world frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.policy import Policy
from branchdrive_reference.drawing.scene import HISTORY_TICKS, HORIZON_TICKS
from branchdrive_reference.report.shard_rows import Array, ShardRows, TickRows
from branchdrive_reference.study.label import label

__all__ = ["CONTROLS", "Future", "Scene", "Track", "read_scene"]

Ticks = NDArray[np.int64]

CONTROLS = ("applied_steer", "applied_throttle", "applied_brake")
"""Columns of the commands that a player shows."""

_LARGEST = 1e7
"""No coordinate is larger; the format ends positions here, in metres."""

_AWAY_M = 5000.0
"""What is farther than this from the branch is not drawn."""

_NEAR_M = 100.0
"""An actor that comes no closer to the ego of any candidate is not drawn."""

_MOST_TRACKS = 80
"""Actors of a group; the nearest are drawn."""

_MOST_BOX_M = 100.0

_LEAD_TICKS = 20
_MOST_HISTORY_TICKS = 400
"""A group with a finding before the history that others show begins so long before it, and at most so long before the
branch."""


@dataclass(frozen=True, eq=False)
class Track:
    """One actor beside one candidate.

    Attributes:
        actor_class: As recorded.
        length_m: Of its box.
        width_m: Of its box.
        tick: Ticks since the branch, increasing ``[rows]``.
        x_m: Box centre ``[rows]``.
        y_m: Box centre ``[rows]``.
        yaw_rad: Heading ``[rows]``.
        nearest_m: How close its centre comes to that of the ego.
    """

    actor_class: str
    length_m: float
    width_m: float
    tick: Ticks
    x_m: Array
    y_m: Array
    yaw_rad: Array
    nearest_m: float

    def only(self, rows: NDArray[np.bool_]) -> Track:
        """The track at some of its rows."""
        series = {name: getattr(self, name)[rows] for name in ("tick", "x_m", "y_m", "yaw_rad")}
        return replace(self, **series)


@dataclass(frozen=True, eq=False)
class Future:
    """One candidate from the history to the horizon.

    Attributes:
        policy: The candidate.
        rollout_id: The attempt that is shown.
        branch_tick: Its tick from which times count.
        tick: Ticks of its observations since the branch, increasing ``[rows]``.
        x_m: Ego box centre ``[rows]``.
        y_m: Ego box centre ``[rows]``.
        yaw_rad: Ego heading ``[rows]``.
        speed_mps: Speed, NaN where it is unknown ``[rows]``.
        gap_m: Gap to the nearest relevant actor, NaN where there is none ``[rows]``.
        touched: Whether the ego touched something since the row before ``[rows]``.
        control_tick: Ticks of its commands since the branch ``[commands]``.
        controls: Steering, throttle and brake as applied, NaN where unknown ``[3, commands]``.
        tracks: Actors by identity.
        is_marked: Whether a finding marks a tick of it before the history that other groups show.
    """

    policy: Policy
    rollout_id: str
    branch_tick: int
    tick: Ticks
    x_m: Array
    y_m: Array
    yaw_rad: Array
    speed_mps: Array
    gap_m: Array
    touched: NDArray[np.bool_]
    control_tick: Ticks
    controls: Array
    tracks: Mapping[int, Track]
    is_marked: bool = False

    def since(self, tick: int) -> Future:
        """The candidate without what was before a tick."""
        rows, commands = self.tick >= tick, self.control_tick >= tick
        names = ("tick", "x_m", "y_m", "yaw_rad", "speed_mps", "gap_m", "touched")
        tracks = {name: track.only(track.tick >= tick) for name, track in self.tracks.items()}
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in names},
            control_tick=self.control_tick[commands],
            controls=self.controls[:, commands],
            tracks={name: track for name, track in tracks.items() if len(track.tick)},
        )

    @property
    def contacts(self) -> Ticks:
        """Rows after the branch at which a touch begins."""
        begins = self.touched & ~np.concatenate([[False], self.touched[:-1]])
        return np.flatnonzero(begins & (self.tick > 0))


@dataclass(frozen=True, eq=False)
class Scene:
    """A group as it can be shown.

    Attributes:
        group_id: As recorded.
        futures: Candidates that can be drawn, in the order of the bank, the nominal first.
        origin: World frame: x, y and heading of the ego at the branch.
        box_m: Length and width of the ego.
        route: Vertices of the route.
        remarks: What cannot be drawn and why, a sentence each.
        branch_tick: As recorded; ``None`` where no attempt has one.
    """

    group_id: str
    futures: Sequence[Future]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    box_m: tuple[float, float] = (4.6, 1.9)
    route: tuple[Array, Array] = field(default_factory=lambda: (np.zeros(0), np.zeros(0)))
    remarks: Sequence[str] = ()
    branch_tick: int | None = None


def read_scene(
    shard: ShardRows,
    records: Sequence[Mapping[str, Any]],
    rows: Sequence[int],
    bank: ActionBank,
    chosen: Sequence[int] | None,
    marks: Mapping[str, int],
) -> Scene:
    """What can be shown of a group.

    Args:
        shard: Where it lies.
        records: Rows of the rollouts table of the shard.
        rows: Those of the group.
        bank: The dataset's action bank.
        chosen: The canonical attempt of every policy, -1 for none; ``None`` where it is unknown.
        marks: First tick of an attempt that a finding names, by its identity.
    """
    group_id = str(records[rows[0]]["group_id"])
    branch_tick = next((records[row]["branch_tick"] for row in rows if records[row]["branch_tick"] is not None), None)
    if "observations" not in shard.streams:
        said = "No future is drawn: the table of observations cannot be read."
        return Scene(group_id, (), remarks=(said,), branch_tick=branch_tick)
    remarks: list[str] = []
    drawn: list[tuple[Policy, int]] = []
    for policy in (bank.nominal, *bank.interventions):
        place = bank.policies.index(policy)
        row = -1 if chosen is None else chosen[place]
        if row < 0:
            row = _stand_in(records, rows, policy.key)
            if row < 0:
                remarks.append(f"{label(policy.key)}: no attempt is recorded.")
                continue
            if chosen is not None:
                status = label(str(records[row]["status"]))
                remarks.append(f"{label(policy.key)}: no complete attempt; what is shown is one that is {status}.")
        drawn.append((policy, row))
    early = _early_marks([records[row] for _, row in drawn], marks)
    start = max(min(early.values(), default=0) - _LEAD_TICKS, -_MOST_HISTORY_TICKS) if early else -HISTORY_TICKS
    futures: list[Future] = []
    for policy, row in drawn:
        found = _future(shard, records[row], policy, start, records[row]["rollout_id"] in early)
        if isinstance(found, Future):
            futures.append(found)
        else:
            remarks.append(f"{label(policy.key)}: {found}.")
    remarks += _lacking(shard)
    if not futures:
        said = "No candidate of this group can be drawn."
        return Scene(group_id, (), remarks=(*remarks, said), branch_tick=branch_tick)
    first = futures[0]
    record = next(records[row] for row in rows if records[row]["rollout_id"] == first.rollout_id)
    at = int(np.argmin(np.abs(first.tick)))
    origin = (float(first.x_m[at]), float(first.y_m[at]), float(first.yaw_rad[at]))
    if record["branch_tick"] is None:
        remarks.insert(0, "No attempt has a branch: times count from the first observation.")
    near = []
    for one in futures:
        own = one if _is_near(one, origin) else one.since(-HISTORY_TICKS)
        if _is_near(own, origin):
            near.append(own)
        else:
            remarks.append(f"{label(one.policy.key)}: it goes farther than {_AWAY_M:,.0f} m from the branch.")
    route = _finite(shard.route(next(row for row in rows if records[row] is record)), origin)
    box = _box(record, remarks)
    return Scene(group_id, _with_nearest(near), origin, box, route, tuple(remarks), branch_tick)


def _early_marks(records: Sequence[Mapping[str, Any]], marks: Mapping[str, int]) -> dict[str, int]:
    """Ticks since the branch of marks before the history that other groups show, by attempt."""
    found = {}
    for record in records:
        mark, branch = marks.get(record["rollout_id"]), record["branch_tick"]
        if mark is not None and branch is not None and mark - branch < -HISTORY_TICKS:
            found[record["rollout_id"]] = mark - branch
    return found


def _stand_in(records: Sequence[Mapping[str, Any]], rows: Sequence[int], key: str) -> int:
    """The attempt that stands for a policy without a canonical one: a complete one before others, then the first."""
    own = [row for row in rows if records[row]["action_key"] == key and records[row]["role"] != "nominal_replay"]
    order = sorted(own, key=lambda row: (records[row]["status"] != "complete", records[row]["attempt"] or 0, row))
    return order[0] if order else -1


def _lacking(shard: ShardRows) -> list[str]:
    said = {
        "actors": "Actors are not drawn: they are not recorded, or cannot be read.",
        "evidence": "Gaps and contacts are unknown: no evidence is recorded, or it cannot be read.",
        "controls": "Commands are unknown: their table cannot be read.",
    }
    return [text for name, text in said.items() if name not in shard.streams]


def _future(shard: ShardRows, record: Mapping[str, Any], policy: Policy, start: int, is_marked: bool) -> Future | str:
    """A candidate from a tick since the branch on, or why it cannot be drawn."""
    rollout_id, branch = str(record["rollout_id"]), record["branch_tick"]
    stream = shard.streams["observations"]
    rows = stream.span(rollout_id)
    if rows.start == rows.stop:
        return "no observation is recorded"
    tick = stream.numbers("tick", rows).astype(np.int64)
    zero = int(tick[0]) if branch is None else int(branch)
    columns = [stream.numbers(name, rows) for name in ("x_m", "y_m", "yaw_rad", "speed_mps")]
    is_pose = np.all([np.abs(values) <= _LARGEST for values in columns[:3]], axis=0)
    kept = np.flatnonzero(is_pose & _in_view(tick - zero, start))
    kept = kept[np.unique(tick[kept], return_index=True)[1]]
    if not (tick[kept] - zero >= -HISTORY_TICKS).any():
        return "no observation within the horizon has a place"
    tick = tick[kept] - zero
    x, y, yaw, speed = (values[kept] for values in columns)
    gap, touched = _evidence(shard.streams.get("evidence"), rollout_id, tick + zero)
    control_tick, controls = _controls(shard.streams.get("controls"), rollout_id, zero, start)
    actors = shard.streams.get("actors")
    tracks = {} if actors is None else _tracks(actors, rollout_id, zero, (tick, x, y))
    yaw = np.unwrap(yaw)
    return Future(
        policy, rollout_id, zero, tick, x, y, yaw, speed, gap, touched, control_tick, controls, tracks, is_marked
    )


def _in_view(tick: Ticks, start: int) -> NDArray[np.bool_]:
    return np.asarray((tick >= start) & (tick <= HORIZON_TICKS))


def _evidence(stream: TickRows | None, rollout_id: str, tick: Ticks) -> tuple[Array, NDArray[np.bool_]]:
    """Gap and touches at ticks of observations; unknown where there is no evidence."""
    gap, touched = np.full(len(tick), np.nan), np.zeros(len(tick), bool)
    if stream is None:
        return gap, touched
    rows = stream.span(rollout_id)
    own = stream.numbers("tick", rows).astype(np.int64)
    if not len(own):
        return gap, touched
    at = np.minimum(np.searchsorted(own, tick), len(own) - 1)
    is_there = own[at] == tick
    values = stream.numbers("separation_m", rows)[at]
    gap[is_there] = np.where(np.abs(values) <= _LARGEST, values, np.nan)[is_there]
    touched[is_there] = (stream.numbers("collision", rows)[at] == 1)[is_there]
    return gap, touched


def _controls(stream: TickRows | None, rollout_id: str, zero: int, start: int) -> tuple[Ticks, Array]:
    if stream is None:
        return np.zeros(0, np.int64), np.zeros((3, 0))
    rows = stream.span(rollout_id)
    tick = stream.numbers("tick", rows).astype(np.int64) - zero
    kept = np.flatnonzero(_in_view(tick, start))
    kept = kept[np.unique(tick[kept], return_index=True)[1]]
    return tick[kept], np.stack([stream.numbers(name, rows)[kept] for name in CONTROLS])


def _tracks(stream: TickRows, rollout_id: str, zero: int, ego: tuple[Ticks, Array, Array]) -> dict[int, Track]:
    """Actors of a candidate that can be drawn, by identity."""
    rows = stream.span(rollout_id)
    tick = stream.numbers("tick", rows).astype(np.int64) - zero
    ids = stream.numbers("actor_id", rows).astype(np.int64)
    x, y, yaw, length, width = (stream.numbers(name, rows) for name in ("x_m", "y_m", "yaw_rad", "length_m", "width_m"))
    at = np.minimum(np.searchsorted(ego[0], tick), len(ego[0]) - 1)
    away = np.hypot(x - ego[1][at], y - ego[2][at])
    is_pose = np.all([np.abs(values) <= _LARGEST for values in (x, y, yaw)], axis=0)
    is_box = (length > 0) & (length <= _MOST_BOX_M) & (width > 0) & (width <= _MOST_BOX_M)
    usable = np.flatnonzero(is_pose & is_box & (ego[0][at] == tick))
    usable = usable[np.lexsort([tick[usable], ids[usable]])]
    names, first = np.unique(ids[usable], return_index=True)
    found = {}
    for name, start, end in zip(names.tolist(), first, [*first[1:], len(usable)], strict=False):
        own = usable[start:end]
        own = own[np.unique(tick[own], return_index=True)[1]]
        row = int(own[0])
        found[name] = Track(
            label(stream.text("actor_class", rows.start + row)), float(length[row]), float(width[row]),
            tick[own], x[own], y[own], np.unwrap(yaw[own]), float(away[own].min()),
        )  # fmt: skip
    return found


def _with_nearest(futures: Sequence[Future]) -> list[Future]:
    """Candidates with those actors alone that come near the ego of one of them."""
    nearest: dict[int, float] = {}
    for future in futures:
        for actor_id, track in future.tracks.items():
            nearest[actor_id] = min(track.nearest_m, nearest.get(actor_id, np.inf))
    order = sorted(nearest, key=lambda actor_id: (nearest[actor_id], actor_id))
    kept = {actor_id for actor_id in order[:_MOST_TRACKS] if nearest[actor_id] <= _NEAR_M}
    return [
        replace(future, tracks={name: track for name, track in future.tracks.items() if name in kept})
        for future in futures
    ]


def _is_near(future: Future, origin: tuple[float, float, float]) -> bool:
    """Whether a candidate is not absurdly far away."""
    return bool((np.hypot(future.x_m - origin[0], future.y_m - origin[1]) <= _AWAY_M).all())


def _finite(route: tuple[Array, Array], origin: tuple[float, float, float]) -> tuple[Array, Array]:
    """Vertices of a route around the branch."""
    x, y = route
    with np.errstate(all="ignore"):
        near = np.hypot(x - origin[0], y - origin[1]) <= 250.0
    return x[near], y[near]


def _box(record: Mapping[str, Any], remarks: list[str]) -> tuple[float, float]:
    sizes = record["ego_length_m"], record["ego_width_m"]
    if all(size is not None and 0 < size <= _MOST_BOX_M for size in sizes):
        return float(sizes[0]), float(sizes[1])
    remarks.append("The ego's size is none; a box of 4.6 m by 1.9 m is drawn.")
    return 4.6, 1.9
