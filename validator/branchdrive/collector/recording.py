"""Recorded columns of a rollout from the arrays that its collector logged, as columns.json declares them.

Order matters: poses are rounded to their recorded width first, and what derives from them (route state, risk evidence)
is computed from the rounded values.

Source: spec/05-raw-streams.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.collector.contact import num_contacts
from branchdrive.collector.route import route_columns
from branchdrive.contract.columns import TABLES
from branchdrive.contract.policy import ACTUATORS, Command, Policy
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.risk import risk_evidence
from branchdrive.writer.rollout_writer import RolloutWriter

__all__ = ["Columns", "Record", "Recording", "column", "pose_columns"]

Columns = dict[str, Any]
"""Columns of one table by name, without ``rollout_id``: arrays, masked where null, or lists with ``None``."""

_DTYPES: Mapping[str, Any] = {
    "string": object, "bool": np.bool_, "int32": np.int32, "int64": np.int64, "float32": np.float32,
    "float64": np.float64,
}  # fmt: skip

_COUNTED: Mapping[str, tuple[str, ...]] = {
    "vehicle": ("vehicle", "cycle"), "pedestrian": ("pedestrian",), "static": ("static",),
}  # fmt: skip
"""Classes of actors by the kind of the collision with them."""


@dataclass(frozen=True, eq=False)
class Record:
    """A recorded rollout.

    Attributes:
        controls: Control audit, one row per tick.
        observations: Ego and route state, one row per saved observation.
        actors: Oriented boxes; empty where the stream is not claimed.
        evidence: Risk evidence, one row per saved observation; empty where the stream is not claimed.
        fields: Columns of the rollouts table that the drive decides.
        decisions: What was chosen in a drive, one row per decision; empty in other rollouts.
    """

    controls: Columns
    observations: Columns
    actors: Columns
    evidence: Columns
    fields: Columns
    decisions: Columns = field(default_factory=dict)

    def append_to(self, writer: RolloutWriter) -> None:
        """Write the rows; the fields are what `finish` takes."""
        writer.append_ticks(**self.controls)
        writer.append_observations(**self.observations)
        if self.evidence:
            writer.append_actors(**self.actors)
            writer.append_evidence(**self.evidence)
        if self.decisions:
            writer.append_decisions(**self.decisions)

    def with_decisions(self, decisions: Sequence[tuple[int, Policy]], nominal: NDArray[np.float32]) -> Record:
        """This rollout as a drive whose commands were those of its decisions (spec/04-policies.md#drives).

        Args:
            decisions: Tick and chosen policy of each decision in their order, at least one.
            nominal: Applied commands of the nominal rollout, float32 ``[nominal ticks, 3]``.
        """
        expert, applied = (
            np.stack([np.asarray(self.controls[f"{kind}_{actuator}"]) for actuator in ACTUATORS], axis=1)
            for kind in ("expert", "applied")
        )
        active, stored, intended = np.zeros(len(expert), np.bool_), np.zeros_like(expert), np.zeros_like(expert)
        ends = [*(tick for tick, _ in decisions[1:]), len(expert)]
        for (tick, policy), end in zip(decisions, ends, strict=True):
            window = slice(tick, min(tick + policy.duration_ticks, end))
            active[window] = True
            stored[window] = (nominal if tick == decisions[0][0] else expert)[window]
            intended[window] = _demanded(policy, expert[window], stored[window])
        ticks, policies = zip(*decisions, strict=True)
        return replace(
            self,
            controls=_control_columns(expert, applied, active, stored, intended),
            fields={**self.fields, **policies[0].effective_action()},
            decisions={"tick": np.array(ticks, np.int32), "action_key": [policy.key for policy in policies]},
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A rollout as its collector logged it.

    Attributes:
        policy: The policy it executed.
        active: Whether the policy drives ``[ticks]``.
        nominal: Stored nominal commands, float32 ``[nominal ticks, 3]``; ``None`` without a branch.
        expert: The expert's commands, float32 ``[ticks, 3]``.
        applied: Applied commands, float32 ``[ticks, 3]``.
        scene: Columns of the rollouts table that the world decides, route and extents of the ego among them.
        observations: Columns of the observations table but the tick, those of `pose_columns` among them.
        actors: Columns of the actors table; ``None`` where the stream is not claimed.
        lane_id: Lane of the ego, ``None`` off the lanes ``[observations]``.
        on_road: Whether the ego is on the road, ``None`` where that is unknown ``[observations]``.
        traffic_light: Light that governs the ego, ``None`` without one ``[observations]``.
        classes: Class of everything that the ego can touch ``[things]``.
        touching: What it touched since the saved observation before ``[observations, things]``.
        completion: Completion status of the route.
        termination: Why the rollout ended.
        partial_because: Why the attempt is only partial; empty if it is complete.
        goal_m: Progress at which the whole route is driven.
    """

    policy: Policy
    active: NDArray[np.bool_]
    nominal: NDArray[np.float32] | None
    expert: NDArray[np.float32]
    applied: NDArray[np.float32]
    scene: Columns
    observations: Columns
    actors: Columns | None
    lane_id: Sequence[str | None] | NDArray[np.object_]
    on_road: Sequence[bool | None] | NDArray[np.bool_]
    traffic_light: Sequence[str | None] | NDArray[np.object_]
    classes: Sequence[str] | NDArray[np.str_]
    touching: NDArray[np.bool_]
    completion: str
    termination: str
    partial_because: str
    goal_m: float

    def record(self) -> Record:
        """The recorded columns of the rollout."""
        ticks = np.arange(len(self.touching), dtype=np.int32) * np.int32(OBSERVATION_STRIDE_TICKS)
        observations = {"tick": ticks} | {
            name: column("observations", name, values) for name, values in self.observations.items()
        }
        evidence = {} if self.actors is None else self._evidence(observations, self.actors)
        return Record(self._controls(), observations, self.actors or {}, evidence, self._fields(observations))

    def _controls(self) -> Columns:
        active = self.active
        stored, intended = np.zeros_like(self.applied), np.zeros_like(self.applied)
        if self.nominal is not None:
            stored[active] = self.nominal[np.flatnonzero(active)]
            intended[active] = _demanded(self.policy, self.expert[active], stored[active])
        return _control_columns(self.expert, self.applied, active, stored, intended)

    def _evidence(self, observations: Columns, actors: Columns) -> Columns:
        lit = [light is not None for light in self.traffic_light]
        return {
            "tick": observations["tick"],
            **risk_evidence(
                observations,
                actors,
                ego_length_m=float(np.float32(self.scene["ego_length_m"])),
                ego_width_m=float(np.float32(self.scene["ego_width_m"])),
                route_x_m=np.asarray(self.scene["route_x_m"], np.float64),
                route_y_m=np.asarray(self.scene["route_y_m"], np.float64),
            ),
            "lane_id": self.lane_id,
            "on_road": np.array(self.on_road, np.bool_),
            "collision": self.touching.any(axis=1),
            "traffic_light_available": np.array(lit, np.bool_),
            "traffic_light": self.traffic_light,
        }

    def _fields(self, observations: Columns) -> Columns:
        hits = Counter(np.repeat(np.asarray(self.classes, np.str_), num_contacts(self.touching)).tolist())
        off_road = np.array([known is not None and not known for known in self.on_road], np.bool_)
        is_driven = self.completion == "completed"
        driven = 1.0 if is_driven else float(observations["route_progress_m"].max()) / self.goal_m
        return {
            **self.scene,
            **self.policy.effective_action(),
            "status": "partial" if self.partial_because else "complete",
            "status_reason": self.partial_because or None,
            "result_completion": self.completion,
            "result_termination": self.termination,
            "result_route_fraction": min(driven, 1.0),
            **{
                f"result_num_{kind}_collisions": sum(hits[name] for name in classes)
                for kind, classes in _COUNTED.items()
            },
            "result_num_off_road_infractions": int((off_road & ~np.append(False, off_road[:-1])).sum()),
        }


def _demanded(policy: Policy, expert: NDArray[np.float32], stored: NDArray[np.float32]) -> NDArray[np.float32]:
    """Commands that a policy demands ``[ticks, 3]``."""
    return np.stack(policy.command(Command(*expert.T), Command(*stored.T)), axis=1)


def _control_columns(
    expert: NDArray[np.float32],
    applied: NDArray[np.float32],
    active: NDArray[np.bool_],
    stored: NDArray[np.float32],
    intended: NDArray[np.float32],
) -> Columns:
    """Control audit of commands ``[ticks, 3]``; what is stored and intended is null where no policy is active."""
    columns: Columns = {
        "tick": np.arange(len(active), dtype=np.int32),
        "active": active,
        "source": np.where(active, "intervention", "online_expert"),
    }
    for index, actuator in enumerate(ACTUATORS):
        columns[f"expert_{actuator}"] = expert[:, index]
        columns[f"nominal_{actuator}"] = np.ma.masked_array(stored[:, index], ~active)
        columns[f"intended_{actuator}"] = np.ma.masked_array(intended[:, index], ~active)
        columns[f"applied_{actuator}"] = applied[:, index]
    return columns


def column(table: str, name: str, values: ArrayLike) -> Any:
    """Values of a column in its declared type; as they are where some are missing, or where they are text."""
    kind = TABLES[table][name].type
    if isinstance(values, np.ndarray):
        return values if kind == "string" else values.astype(_DTYPES[kind], copy=False)
    listed = list(values)  # type: ignore[arg-type]
    return listed if any(value is None for value in listed) else np.array(listed, _DTYPES[kind])


def pose_columns(
    x_m: ArrayLike, y_m: ArrayLike, yaw_rad: ArrayLike, route_x_m: ArrayLike, route_y_m: ArrayLike
) -> Columns:
    """Columns of the observations table that say where the ego is, in the world and on its route.

    Args:
        x_m: Positions of the ego ``[observations]``.
        y_m: The same, y.
        yaw_rad: Headings ``[observations]``, wrapped here.
        route_x_m: Route polyline ``[vertices]``.
        route_y_m: The same, y.
    """
    x, y, route_x, route_y = (np.asarray(values, np.float64) for values in (x_m, y_m, route_x_m, route_y_m))
    yaw = wrap_rad(np.asarray(yaw_rad, np.float64)).astype(np.float32)
    return {"x_m": x.copy(), "y_m": y.copy(), "yaw_rad": yaw, **route_columns(x, y, yaw, route_x, route_y)}
