"""What a picture shows of a group: the candidates around the branch, and the actors they met.

Times are ticks since the branch tick; poses are world frame, as recorded.

Whether what was read of a group can be drawn: texts of bounded length, numbers that are numbers, whole routes.

A picture is no judgement of a dataset, so the bounds are wide: within them everything draws.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.policy import Policy
from branchdrive.contract.timing import ACTIVE_TICKS, PREDECESSOR_OFFSET, TICK_S
from branchdrive.errors import UsageError
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.rollout import Rollout
from branchdrive.raw.window import EVIDENCE_OFFSETS
from branchdrive_reference.study.bank import canonical_bank
from branchdrive_reference.study.label import MAX_TEXT_CHARACTERS, label
from branchdrive_reference.town.elements import Element

__all__ = [
    "HISTORY_TICKS",
    "HORIZON_S",
    "HORIZON_TICKS",
    "Candidate",
    "DrawnActor",
    "DrawnScene",
    "check_scene",
    "outcome_texts",
    "read_scene",
    "require_actors",
]

Array: TypeAlias = NDArray[np.float64]

_MOST_ACTORS = 1000

HISTORY_TICKS = 80
"""A picture begins this long before the branch."""

_WINDOW = (PREDECESSOR_OFFSET, *EVIDENCE_OFFSETS)
"""Ticks since the branch without which there is no picture."""

HORIZON_TICKS = ACTIVE_TICKS + 80
"""A picture ends this long after the branch, or with the rollout."""

HORIZON_S = HORIZON_TICKS * TICK_S
"""The same in seconds."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One executed candidate, from the history to the horizon; arrays ``[observations]``.

    Attributes:
        policy: The candidate.
        tick: Ticks since the branch.
        x_m: Ego box centre.
        y_m: Ego box centre.
        yaw_rad: Ego heading.
        speed_mps: Signed forward speed.
        separation_m: Gap to the nearest relevant actor, ``nan`` where there is none.
        touched: Whether the ego touched something since the observation before.
    """

    policy: Policy
    tick: NDArray[np.int64]
    x_m: Array
    y_m: Array
    yaw_rad: Array
    speed_mps: Array
    separation_m: Array
    touched: NDArray[np.bool_]

    @property
    def time_s(self) -> Array:
        """Seconds since the branch."""
        return np.asarray(self.tick * TICK_S, np.float64)

    @property
    def history(self) -> NDArray[np.bool_]:
        """Observations up to the branch."""
        return self.tick <= 0

    @property
    def future(self) -> NDArray[np.bool_]:
        """The observation of the branch and the ten that follow."""
        return (self.tick >= 0) & (self.tick <= ACTIVE_TICKS)

    @property
    def recovery(self) -> NDArray[np.bool_]:
        """The last observation of the future and all that follow."""
        return self.tick >= ACTIVE_TICKS

    @property
    def contacts(self) -> NDArray[np.int64]:
        """Rows after the branch at which a touch begins."""
        begins = self.touched & ~np.concatenate([[False], self.touched[:-1]])
        return np.flatnonzero(begins & (self.tick > 0))

    @property
    def end_s(self) -> float:
        """Seconds from the branch to the last observation that is shown."""
        return float(self.time_s[-1])

    @property
    def ends_early(self) -> bool:
        """Whether the rollout ends before the horizon, so that nothing is known of the rest."""
        return bool(self.tick[-1] < HORIZON_TICKS)

    @property
    def least_separation_m(self) -> float:
        """Smallest gap in the future, ``nan`` if there never was a relevant actor; 0 where something was touched.

        Touches are recorded between observations and of everything, recorded gaps at observations and of
        static objects in the route corridor only: a touch may have no recorded gap of 0.
        """
        ahead = self.future & (self.tick > 0)
        if self.touched[ahead].any():
            return 0.0
        gaps = self.separation_m[ahead]
        return float(np.nanmin(gaps)) if np.isfinite(gaps).any() else float("nan")


@dataclass(frozen=True, eq=False)
class DrawnActor:
    """One actor at the branch, and its poses in the nominal future ``[observations]``, the branch's first."""

    actor_id: int
    actor_class: str
    length_m: float
    width_m: float
    vel_x_mps: float
    vel_y_mps: float
    x_m: Array
    y_m: Array
    yaw_rad: Array


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """A group as a picture shows it.

    Attributes:
        record: Row of the nominal rollout in the rollouts table.
        bank: The dataset's action bank.
        candidates: Executed candidates in the order of the bank, the nominal one first.
        actors: Actors at the branch tick of the nominal rollout.
        nearest_actor_id: The actor to which the nominal future has its least gap; ``None`` where it has none.
        lane_id: Lane under the ego at the branch, if it was on one.
        traffic_light: State of the light that the ego faces at the branch, if there is one.
        elements: Elements of the map around the candidates; none where there is no map.
    """

    record: dict[str, Any]
    bank: ActionBank
    candidates: tuple[Candidate, ...]
    actors: tuple[DrawnActor, ...]
    nearest_actor_id: int | None
    lane_id: str | None
    traffic_light: str | None
    elements: tuple[Element, ...] = ()

    @property
    def nominal(self) -> Candidate:
        """The nominal candidate."""
        return self.candidates[0]

    @property
    def branch_row(self) -> int:
        """Row of the branch in the nominal candidate."""
        return int(np.searchsorted(self.nominal.tick, 0))

    @property
    def route(self) -> tuple[Array, Array]:
        """Vertices of the route, world frame."""
        return np.asarray(self.record["route_x_m"], float), np.asarray(self.record["route_y_m"], float)


def outcome_texts(candidate: Candidate) -> tuple[str, str, str, str]:
    """Name of a candidate, its least gap and its speed in the future, and when it first touches something."""
    gap_m = candidate.least_separation_m
    contacts = candidate.time_s[candidate.contacts]
    never = f"none (to +{candidate.end_s:.2f} s)" if candidate.ends_early else "none"
    return (
        candidate.policy.key.replace("_", " "),
        "none" if math.isnan(gap_m) else f"{gap_m:.1f} m",
        f"{candidate.speed_mps[candidate.future][-1]:.1f} m/s",
        f"+{contacts[0]:.2f} s" if len(contacts) else never,
    )


def read_scene(group: BranchGroup, descriptor: Descriptor) -> DrawnScene:
    """What a picture of the group shows.

    Raises:
        UsageError: The dataset has no actors, some policy has no complete attempt, or what is recorded of the
            group cannot be drawn.
    """
    require_actors(descriptor)
    bank = descriptor.action_bank
    rollouts = dict(zip(bank.keys, canonical_bank(group, descriptor), strict=True))
    nominal = rollouts[bank.nominal.key]
    candidates = tuple(_candidate(rollouts[policy.key], policy) for policy in (bank.nominal, *bank.interventions))
    lane_id, traffic_light = (_evidence_text(nominal, name) for name in ("lane_id", "traffic_light"))
    nearest = _nearest_actor_id(nominal)
    scene = DrawnScene(nominal.record, bank, candidates, _actors(nominal), nearest, lane_id, traffic_light)
    check_scene(scene)
    return scene


def require_actors(descriptor: Descriptor) -> None:
    """Refuse a dataset that claims no stream with the actors of a picture.

    Raises:
        UsageError: It does not.
    """
    if "evidence" not in descriptor.tables:
        raise UsageError("the dataset claims no `actor_risk_evidence`, which holds the actors of a picture")


def _refused(rollout: Rollout, reason: str) -> UsageError:
    whose = f"rollout '{label(rollout.rollout_id)}'"
    return UsageError(f"group '{label(rollout.record['group_id'])}' cannot be drawn: {whose} {reason}")


def _since_branch(rollout: Rollout, table: str) -> NDArray[np.int64]:
    ticks: NDArray[np.int64] = rollout.column(table, "tick").astype(np.int64) - (rollout.branch_tick or 0)
    return ticks


def _candidate(rollout: Rollout, policy: Policy) -> Candidate:
    tick = _since_branch(rollout, "observations")
    if rollout.branch_tick is None or not np.isin(_WINDOW, tick).all():
        raise _refused(rollout, "has no observations around a branch; run `branchdrive-validate`")
    if not np.array_equal(tick, _since_branch(rollout, "evidence")) or (np.diff(tick) <= 0).any():
        raise _refused(rollout, "has no evidence for each observation, or a tick twice; run `branchdrive-validate`")
    in_view = (tick >= -HISTORY_TICKS) & (tick <= HORIZON_TICKS)

    def column(table: str, name: str) -> Array:
        values = np.ma.filled(np.ma.asarray(rollout.column(table, name), dtype=np.float64), np.nan)
        return np.asarray(values, np.float64)[in_view]

    return Candidate(
        policy,
        tick[in_view],
        x_m=column("observations", "x_m"),
        y_m=column("observations", "y_m"),
        yaw_rad=column("observations", "yaw_rad"),
        speed_mps=column("observations", "speed_mps"),
        separation_m=column("evidence", "separation_m"),
        touched=rollout.column("evidence", "collision")[in_view].astype(np.bool_),
    )


def _actors(nominal: Rollout) -> tuple[DrawnActor, ...]:
    tick, ids = _since_branch(nominal, "actors"), nominal.column("actors", "actor_id")
    columns = {name: nominal.column("actors", name) for name in nominal.tables["actors"].column_names}
    ahead = (tick >= 0) & (tick <= ACTIVE_TICKS)
    num_actors = int((tick == 0).sum())
    if num_actors > _MOST_ACTORS:
        raise _refused(nominal, f"has {num_actors:,} actors at the branch; at most {_MOST_ACTORS:,} are drawn")
    actors = []
    for row in np.flatnonzero(tick == 0):
        path = np.flatnonzero(ahead & (ids == ids[row]))
        path = path[np.argsort(tick[path], kind="stable")]
        x, y, yaw = (columns[name][path].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad"))
        length, width, vel_x, vel_y = (
            float(columns[name][row]) for name in ("length_m", "width_m", "vel_x_mps", "vel_y_mps")
        )
        actors.append(
            DrawnActor(int(ids[row]), str(columns["actor_class"][row]), length, width, vel_x, vel_y, x, y, yaw)
        )
    return tuple(actors)


def _nearest_actor_id(nominal: Rollout) -> int | None:
    since = _since_branch(nominal, "evidence")
    future = (since > 0) & (since <= ACTIVE_TICKS)
    gaps = np.ma.filled(np.ma.asarray(nominal.column("evidence", "separation_m"), dtype=np.float64), np.inf)[future]
    gaps = np.where(np.isfinite(gaps), gaps, np.inf)
    if not np.isfinite(gaps).any():
        return None
    whose = np.ma.asarray(nominal.column("evidence", "separation_actor_id"))[future]
    if np.ma.getmaskarray(whose)[gaps.argmin()]:
        raise _refused(nominal, "has a `separation_m` without its `separation_actor_id`; run `branchdrive-validate`")
    return int(np.ma.getdata(whose)[gaps.argmin()])


def _evidence_text(nominal: Rollout, column: str) -> str | None:
    """Text of the evidence at the branch, ``None`` where it is null."""
    row = int(np.searchsorted(_since_branch(nominal, "evidence"), 0))
    values = np.ma.asarray(nominal.column("evidence", column))
    return None if np.ma.getmaskarray(values)[row] else str(values[row])


_LARGEST = 1e7
"""No number of a picture is larger; the format ends positions here, in metres."""

_LARGEST_BOX_M = 100.0

_TEXTS = ("group_id", "scenario_type", "town", "route_id", "environment", "trigger_signal")
_NUMBERS = ("branch_tick", "trigger_tick", "trigger_value", "trigger_threshold", "trigger_confidence")


def check_scene(scene: DrawnScene) -> None:
    """Refuse a scene that holds what cannot be drawn.

    Raises:
        UsageError: With the group and the first fault.
    """
    fault = next(_faults(scene), None)
    if fault is not None:
        raise UsageError(
            f"group '{label(scene.record['group_id'])}' cannot be drawn: {fault}; run `branchdrive-validate`"
        )


def _faults(scene: DrawnScene) -> Iterator[str]:
    record = scene.record
    for name in _TEXTS:
        if not isinstance(record[name], str):
            yield f"`{name}` is absent"
        elif len(record[name]) > MAX_TEXT_CHARACTERS:
            yield f"`{name}` has {len(record[name]):,} characters and may have {MAX_TEXT_CHARACTERS:,}"
    for name in _NUMBERS:
        if record[name] is None or not _are_numbers(record[name]):
            yield f"`{name}` is {'absent' if record[name] is None else record[name]}"
    for name in ("ego_length_m", "ego_width_m"):
        if not _is_extent(record[name]):
            yield f"`{name}` is {record[name]}"
    yield from _route_faults(record)
    for candidate in scene.candidates:
        yield from _candidate_faults(candidate)
    for actor in scene.actors:
        yield from _actor_faults(actor)


def _are_numbers(values: Any) -> bool:
    """Whether all of some numbers are finite and not enormous."""
    return bool((np.abs(np.asarray(values, np.float64)) <= _LARGEST).all())


def _is_extent(value_m: float) -> bool:
    return 0.0 < value_m <= _LARGEST_BOX_M


def _route_faults(record: dict[str, Any]) -> Iterator[str]:
    x_m, y_m = record["route_x_m"], record["route_y_m"]
    most = spec_limits().max_route_vertices
    if len(x_m) != len(y_m) or not 2 <= len(x_m) <= most:
        yield f"its route has {len(x_m):,} x and {len(y_m):,} y values, not both the same 2 .. {most:,}"
    elif not _are_numbers([x_m, y_m]):
        yield "its route has a vertex that is no place"


def _candidate_faults(candidate: Candidate) -> Iterator[str]:
    whose = f"of candidate {candidate.policy.key!r}"
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps"):
        if not _are_numbers(getattr(candidate, name)):
            yield f"`{name}` {whose} is not a number at some tick"
    if (candidate.separation_m < 0).any() or np.isinf(candidate.separation_m).any():
        yield f"`separation_m` {whose} is no distance at some tick"


def _actor_faults(actor: DrawnActor) -> Iterator[str]:
    for name in ("x_m", "y_m", "yaw_rad", "vel_x_mps", "vel_y_mps"):
        if not _are_numbers(getattr(actor, name)):
            yield f"`{name}` of actor {actor.actor_id} is not a number at some tick"
    if len(actor.x_m) > ACTIVE_TICKS + 1:
        yield f"actor {actor.actor_id} has {len(actor.x_m):,} poses in a future of {ACTIVE_TICKS} ticks"
    for name in ("length_m", "width_m"):
        if not _is_extent(getattr(actor, name)):
            yield f"`{name}` of actor {actor.actor_id} is {getattr(actor, name)}"
