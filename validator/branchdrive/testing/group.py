"""Tables of a branch group from a scene: what a rule recomputes is computed here from the definitions.

Nothing here calls the functions of the rules, the risk evidence excepted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.columns import DECISIONS, TABLES, TICK_TABLES, table_schema
from branchdrive.driving.risk import risk_evidence
from branchdrive.tables.arrow import unsigned_zeros
from branchdrive.testing.drive import (
    EGO_BOX_M,
    NUM_TICKS,
    STRIDE,
    TICK_S,
    TRIGGER_TICK,
    Array,
    Drive,
    InventedScene,
    Plan,
    Route,
    angle_on_grid,
    drive,
    group_name,
    on_grid,
    plans,
    route_columns,
)

__all__ = [
    "Tables", "by_key", "collision_counts", "concat", "evidence_columns", "make_group", "route_polyline", "to_table",
]  # fmt: skip

Tables = dict[str, pa.Table]

_EVIDENCE_STEPS = 2**22
"""Steps in a unit of the grid of evidence, each a quarter of what recomputed evidence may differ by."""

TOUCHES_STILL_TICKS = 20
"""What touches again within a second touches still."""


def _actor_columns(scene: InventedScene, ticks: Array, moved_m: float) -> dict[str, Any]:
    route = scene.route
    parts: list[dict[str, Any]] = []
    for actor_id, actor in enumerate(scene.actors, start=1):
        here = ticks[(ticks >= actor.first_tick) & (ticks <= actor.last_tick)]
        time_s = here * TICK_S
        x, y, heading = route.point(
            actor.progress_m + moved_m + actor.speed_mps * time_s, actor.offset_m + actor.lateral_mps * time_s
        )
        cos, sin = np.cos(heading), np.sin(heading)
        facing = heading + (np.pi if actor.speed_mps < 0 else 0.0)
        sizes = dict(zip(("length_m", "width_m", "height_m"), actor.box_m, strict=True))
        parts.append(
            {
                "tick": here,
                "actor_id": np.full(len(here), actor_id),
                "actor_class": np.full(len(here), actor.kind),
                "x_m": on_grid(x),
                "y_m": on_grid(y),
                "yaw_rad": angle_on_grid(facing).astype(np.float32),
                **{name: np.full(len(here), size, np.float32) for name, size in sizes.items()},
                "vel_x_mps": on_grid(actor.speed_mps * cos - actor.lateral_mps * sin).astype(np.float32),
                "vel_y_mps": on_grid(actor.speed_mps * sin + actor.lateral_mps * cos).astype(np.float32),
            }
        )
    if not parts:
        return {name: [] for name in table_schema("actors").names if name != "rollout_id"}
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.lexsort((joined["actor_id"], joined["tick"]))
    return {name: values[order] for name, values in joined.items()}


def _observation_columns(route: Route, driven: Drive, i: int, ticks: Array, pedestrian_ticks: Array) -> dict[str, Any]:
    x, y, yaw, speed = (values[ticks, i] for values in (driven.x_m, driven.y_m, driven.yaw_rad, driven.speed_mps))
    past = np.maximum(ticks - 1, 0)
    yaw_step = (yaw - driven.yaw_rad[past, i] + np.pi) % (2 * np.pi) - np.pi
    gained = speed - driven.speed_mps[past, i]
    heeds = np.logical_or.accumulate((ticks >= TRIGGER_TICK + 30) & np.isin(ticks, pedestrian_ticks))
    state = {
        "x_m": x, "y_m": y, "speed_mps": speed,
        "accel_longitudinal_mps2": gained / TICK_S, "accel_lateral_mps2": speed * yaw_step / TICK_S,
        "yaw_rate_radps": yaw_step / TICK_S,
    }  # fmt: skip
    recorded = {name: on_grid(values) for name, values in state.items()} | {"yaw_rad": angle_on_grid(yaw)}
    on_route = route_columns(recorded["x_m"], recorded["y_m"], recorded["yaw_rad"], route_polyline(route))
    columns: dict[str, Any] = {
        "tick": ticks, **recorded,
        "speed_limit_mps": np.full(len(ticks), 13.5), **on_route,
        "command": np.where(ticks < TRIGGER_TICK, "follow", "left" if np.isfinite(route.radius_m) else "straight"),
        "target_speed_mps": np.where(ticks < TRIGGER_TICK, 8.0, 4.0),
        "vehicle_hazard": ticks >= TRIGGER_TICK, "pedestrian_hazard": heeds,
        "traffic_light_hazard": np.zeros(len(ticks), bool),
    }  # fmt: skip
    return {
        name: values.astype(np.float32) if values.dtype == float and name not in ("x_m", "y_m") else values
        for name, values in columns.items()
    }


def _control_columns(driven: Drive, i: int, num_ticks: int) -> dict[str, Any]:
    active = driven.active[:num_ticks, i]
    columns: dict[str, Any] = {
        "tick": np.arange(num_ticks), "active": active, "source": np.where(active, "intervention", "online_expert"),
    }  # fmt: skip
    for k, actuator in enumerate(("steer", "throttle", "brake")):
        columns[f"expert_{actuator}"] = driven.expert[:num_ticks, i, k]
        columns[f"applied_{actuator}"] = driven.applied[:num_ticks, i, k]
        columns[f"nominal_{actuator}"] = np.ma.masked_array(driven.stored[:num_ticks, i, k], ~active)
        columns[f"intended_{actuator}"] = np.ma.masked_array(driven.applied[:num_ticks, i, k], ~active)
    return columns


def route_polyline(route: Route) -> tuple[Array, Array]:
    """Vertices of a route, every two metres."""
    x, y, _ = route.point(np.arange(0.0, route.length_m + 1, 2.0))
    return on_grid(x), on_grid(y)


def evidence_columns(
    observations: Mapping[str, Any], actors: Mapping[str, Any], route: tuple[Array, Array]
) -> dict[str, Any]:
    """Evidence of one rollout from its recorded columns, states of the world included."""
    exact = risk_evidence(
        observations,
        actors,
        ego_length_m=EGO_BOX_M[0],
        ego_width_m=EGO_BOX_M[1],
        route_x_m=route[0],
        route_y_m=route[1],
    )
    computed = {name: _finely(values) if values.dtype.kind == "f" else values for name, values in exact.items()}
    ticks = np.asarray(observations["tick"])
    signal = ticks < 60
    return {
        "tick": ticks, **computed, "traffic_light_available": signal,
        "traffic_light": np.ma.masked_array(np.where(ticks < 30, "red", "green"), ~signal),
        "lane_id": np.ma.masked_array(np.full(len(ticks), "road1:-1"), ticks % 4 == 0),
        "on_road": np.ones(len(ticks), bool),
        "collision": np.ma.filled(computed["separation_m"], np.inf) == 0.0,
    }  # fmt: skip


def _finely(values: Array) -> Array:
    rounded = on_grid(np.ma.getdata(values), _EVIDENCE_STEPS)
    return np.ma.masked_array(rounded, values.mask) if isinstance(values, np.ma.MaskedArray) else rounded


def collision_counts(evidence: Mapping[str, Any], actors: Mapping[str, Any]) -> dict[str, int]:
    """Columns that count collisions: who is nearest at a contact was hit."""
    kinds = dict(zip(np.asarray(actors["actor_id"]).tolist(), np.asarray(actors["actor_class"]).tolist(), strict=True))
    counts, last_tick = dict.fromkeys(("vehicle", "pedestrian", "static"), 0), dict[int, int]()
    nearest = np.ma.filled(evidence["separation_actor_id"], -1)
    touched = np.flatnonzero(evidence["collision"])
    for tick, actor_id in zip(np.asarray(evidence["tick"])[touched].tolist(), nearest[touched].tolist(), strict=True):
        if actor_id not in last_tick or tick - last_tick[actor_id] > TOUCHES_STILL_TICKS:
            counts["vehicle" if kinds[actor_id] == "cycle" else kinds[actor_id]] += 1
        last_tick[actor_id] = tick
    return {f"result_num_{kind}_collisions": count for kind, count in counts.items()}


def _record(
    index: int,
    scene: InventedScene,
    plan: Plan,
    bank: ActionBank,
    driven: Drive,
    progress_m: float,
    collisions: Mapping[str, int],
) -> dict[str, Any]:
    group_id = group_name(index)
    policy = bank[plan.action_key]
    nominal_id = f"{group_id}.{bank.nominal.key}.a1"
    effective: dict[str, Any] = {}
    for actuator in ("steer", "throttle", "brake"):
        rule = getattr(policy, actuator)
        effective[f"effective_{actuator}_rule"], effective[f"effective_{actuator}_value"] = rule.rule, rule.value
    x, y = route_polyline(scene.route)
    num_ticks = len(driven.active)
    trigger_tick = min(max(TRIGGER_TICK, plan.branch_tick), plan.branch_tick + 20)
    brake = float(driven.expert[trigger_tick, 0, 2])
    return {
        "rollout_id": plan.rollout_id(group_id), "group_id": group_id, "role": plan.role, "status": "complete",
        "status_reason": None, "attempt": plan.attempt, "protocol_variant": "v1", "action_key": plan.action_key,
        "nominal_rollout_id": None if plan.role == "nominal" else nominal_id, "scenario_type": scene.scenario_type,
        "town": scene.town, "route_id": f"route-{index}", "route_x_m": x, "route_y_m": y,
        "environment": "ClearNoon", "seed": 2**53 + index, "repetition": index, "ego_length_m": EGO_BOX_M[0],
        "ego_width_m": EGO_BOX_M[1], "ego_height_m": EGO_BOX_M[2], "branch_tick": plan.branch_tick,
        "branch_frame": plan.branch_tick // STRIDE, "trigger_definition": "first-brake/1",
        "trigger_rollout_id": nominal_id, "trigger_tick": trigger_tick,
        "trigger_signal": "brake", "trigger_value": brake, "trigger_threshold": brake / 2, "trigger_confidence": 0.75,
        **effective, "effective_duration_ticks": policy.duration_ticks, "effective_recovery": policy.recovery,
        "num_ticks": num_ticks, "num_observations": -(-num_ticks // STRIDE), "simulator_version": "1.0",
        "collector_version": "1.0", "provenance": "written by a test", "result_completion": "timeout",
        "result_termination": "end of recording", "result_route_fraction": progress_m / scene.route.length_m,
        **collisions, "result_num_red_light_infractions": 0,
        "result_num_stop_sign_infractions": None, "result_num_off_road_infractions": 0,
    }  # fmt: skip


def to_table(name: str, columns: Mapping[str, Any]) -> pa.Table:
    """Table with the declared schema and its rows by key from columns as lists, arrays or masked arrays."""
    schema = table_schema(name)
    arrays = []
    for field in schema:
        values = columns[field.name]
        mask = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
        plain = np.ma.getdata(values) if mask is not None else values
        array = pa.array(
            plain.tolist() if isinstance(plain, np.ndarray) and plain.dtype.kind == "U" else plain, mask=mask
        )
        arrays.append(unsigned_zeros(array.cast(field.type)))
    table = pa.Table.from_arrays(arrays, schema=schema)
    return by_key(name, table)


def by_key(name: str, table: pa.Table) -> pa.Table:
    """The rows of a table in the order of their keys."""
    return table.sort_by([(column, "ascending") for column in TABLES[name].key]).combine_chunks()


def make_group(
    index: int,
    scene: InventedScene,
    planned: Sequence[Plan] | None = None,
    *,
    bank: ActionBank | None = None,
    num_ticks: int = NUM_TICKS,
) -> Tables:
    """Tables of one branch group, without media.

    Args:
        index: Which group: names follow from it.
        scene: Where it drives, and among whom.
        planned: Attempts, the nominal first; those of `plans` by default.
        bank: The bank to drive.
        num_ticks: Control rows of every attempt.
    """
    bank = bank or load_action_bank()
    planned = plans(index, bank) if planned is None else planned
    driven = drive(scene, planned, bank, num_ticks, seed=index)
    ticks = np.arange(0, num_ticks, STRIDE)
    route = route_polyline(scene.route)
    streams: dict[str, list[dict[str, Any]]] = {name: [] for name in TICK_TABLES}
    for i in range(len(planned)):
        actors = _actor_columns(scene, ticks, scene.moved_m.get(i, 0.0))
        pedestrian_ticks = np.asarray(actors["tick"])[np.asarray(actors["actor_class"]) == "pedestrian"]
        observations = _observation_columns(scene.route, driven, i, ticks, pedestrian_ticks)
        streams["controls"].append(_control_columns(driven, i, num_ticks))
        streams["observations"].append(observations)
        streams["actors"].append(actors)
        streams["evidence"].append(evidence_columns(observations, actors, route))
    tables = {
        "rollouts": pa.Table.from_pylist(
            [
                _record(
                    index,
                    scene,
                    plan,
                    bank,
                    driven,
                    float(observations["route_progress_m"].max()),
                    collision_counts(evidence, actors),
                )
                for plan, observations, evidence, actors in zip(
                    planned, streams["observations"], streams["evidence"], streams["actors"], strict=True
                )
            ],
            schema=table_schema("rollouts"),
        )
    }
    for name, parts in streams.items():
        merged: dict[str, Any] = {
            column: np.ma.concatenate([p[column] for p in parts])  # type: ignore[no-untyped-call]
            if isinstance(parts[0][column], np.ma.MaskedArray)
            else np.concatenate([p[column] for p in parts])
            for column in parts[0]
        }
        merged["rollout_id"] = np.repeat(
            [plan.rollout_id(group_name(index)) for plan in planned], [len(p["tick"]) for p in parts]
        )
        tables[name] = to_table(name, merged)
    if any(plan.role == "drive" for plan in planned):
        made = [(plan.rollout_id(group_name(index)), *one) for plan in planned for one in plan.decisions]
        names = ("rollout_id", "tick", "action_key")
        tables[DECISIONS] = to_table(DECISIONS, {name: [one[i] for one in made] for i, name in enumerate(names)})
    return tables | {"rollouts": by_key("rollouts", tables["rollouts"])}


def concat(parts: Sequence[Tables]) -> Tables:
    """Tables of several groups in one."""
    return {name: by_key(name, pa.concat_tables([part[name] for part in parts])) for name in parts[0]}
