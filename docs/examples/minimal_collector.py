"""A minimal collector: one branch group from a simulator of one's own, recorded so that it qualifies.

Copy this file and put your simulator in the place of `World`; everything else is what a collector
owes the specification. Three things are easy to get wrong (`spec/02-time-frames-units.md`):

* SI units and radians, x forward, y left, yaw counter-clockwise, poses of box centres. Steering is
  the one exception: a positive command steers to the *right*.
* The observation of a tick is taken before the control of that tick acts.
* Commands are float32, and the vehicle is driven with the very values that are recorded.

Run it with ``python docs/examples/minimal_collector.py build/straight-road``.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from typing import Any

import numpy as np

import branchdrive as bd

STRIDE_TICKS, TICK_S = 5, 0.05  # controls at 20 Hz, observations at 4 Hz
MAX_TICKS = 900  # every attempt has to reach past the branch tick + 50
ROUTE_X_M, ROUTE_Y_M = [0.0, 200.0], [0.0, 0.0]
EGO_BOX = {"length_m": 4.5, "width_m": 2.0, "height_m": 1.5}  # full extents, exact in float32
PARKED_CAR = {"x_m": 100.0, "y_m": -2.25, "yaw_rad": 0.0, "vel_x_mps": 0.0, "vel_y_mps": 0.0, **EGO_BOX}
BRAKE_THRESHOLD = 0.25  # of the trigger
DOUBLE_COLUMNS = ("x_m", "y_m")  # world positions are float64, all other real columns here float32

SCENE = {  # columns that all attempts of the group share; spec/05-raw-streams.md has every column
    "protocol_variant": "v1", "scenario_type": "ParkedObstacle", "town": "StraightRoad", "route_id": "straight-200",
    "route_x_m": ROUTE_X_M, "route_y_m": ROUTE_Y_M, "environment": "ClearNoon", "seed": 3, "repetition": 0,
    **{f"ego_{name}": value for name, value in EGO_BOX.items()}, "simulator_version": "1.0", "collector_version": "1.0",
    "provenance": "executed from tick 0 by the minimal collector",
}  # fmt: skip


class World:
    """The simulator: an ego vehicle on a straight road along x, and a car parked half in its lane."""

    def __init__(self) -> None:
        self.x_m, self.y_m, self.yaw_rad, self.speed_mps = 0.0, 0.0, 0.0, 8.0
        self.accel_mps2, self.yaw_rate_radps = 0.0, 0.0  # over the last tick, so nothing of the future
        self.is_near, self.target_mps = False, 8.0

    def expert(self) -> bd.Command:
        """The online expert's command on the present state; called at every tick, also while it is overridden."""
        self.is_near = -5.0 < PARKED_CAR["x_m"] - self.x_m < 12.0
        self.target_mps = 3.0 if self.is_near else 8.0
        missing_mps = self.target_mps - self.speed_mps
        steer = np.clip(0.1 * self.y_m + 0.5 * self.yaw_rad, -1, 1)  # too far to the left: steer right, positive
        throttle, brake = np.clip(0.5 * missing_mps, 0, 1), np.clip(-0.5 * missing_mps, 0, 1)
        return bd.Command(np.float32(steer), np.float32(throttle), np.float32(brake))  # rounded before they drive

    def observe(self, tick: int) -> dict[str, Any]:
        """Columns of the observations table for the present state; wrap yaw to [-pi, pi] where it can turn round."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        points = {  # ahead on the route, turned into the ego frame of this tick
            f"target_point_{number}_{axis}_m": value
            for number, lead_m in ((1, 8.0), (2, 16.0))
            for ahead_m in (min(lead_m, ROUTE_X_M[-1] - self.x_m),)  # at the end of the route, its last vertex
            for axis, value in (("x", cos * ahead_m - sin * self.y_m), ("y", -sin * ahead_m - cos * self.y_m))
        }
        return {
            "tick": tick, "x_m": self.x_m, "y_m": self.y_m, "yaw_rad": self.yaw_rad, "speed_mps": self.speed_mps,
            "accel_longitudinal_mps2": self.accel_mps2, "accel_lateral_mps2": self.speed_mps * self.yaw_rate_radps,
            "yaw_rate_radps": self.yaw_rate_radps, "speed_limit_mps": 13.5, "route_progress_m": self.x_m,
            "route_offset_m": self.y_m, "route_heading_error_rad": self.yaw_rad, "command": "follow", **points,
            "target_speed_mps": self.target_mps, "vehicle_hazard": self.is_near, "pedestrian_hazard": False,
            "traffic_light_hazard": False,
        }  # fmt: skip

    def step(self, command: bd.Command) -> None:
        """Apply one command for one tick."""
        steer, throttle, brake = map(float, command)
        speed_mps = max(0.0, self.speed_mps + (3.0 * throttle - 6.0 * brake) * TICK_S)
        self.accel_mps2 = (speed_mps - self.speed_mps) / TICK_S
        self.yaw_rate_radps = -0.13 * steer * speed_mps  # to the right is clockwise: the sign turns here
        self.speed_mps, self.yaw_rad = speed_mps, self.yaw_rad + self.yaw_rate_radps * TICK_S
        self.x_m += speed_mps * np.cos(self.yaw_rad) * TICK_S
        self.y_m += speed_mps * np.sin(self.yaw_rad) * TICK_S


def describe() -> bd.Descriptor:
    """What the dataset is and which streams it claims; a claimed stream is there in every attempt."""
    bank = bd.load_action_bank()  # the thirteen policies of the specification
    return bd.Descriptor(
        dataset_id="minimal", dataset_version="0.1.0", title="One group of a straight road", licence="CC-BY-4.0",
        simulator=bd.Software(name="straight-road", version="1.0"),
        collector=bd.Software(name="minimal-collector", version="1.0"),
        streams=("ego_route_state", "controls", "route_result", "actor_risk_evidence"), action_bank=bank,
        action_encoding=bd.DeclaredEncoding(name="bd29", width=29, sha256=bd.encoding_digest(bank)),
        collection=bd.Collection(seed=3),
    )  # fmt: skip


def drive(group: bd.GroupWriter, role: str, policy: bd.Policy, nominal: bd.Rollout | None = None) -> bd.Rollout:
    """Execute one attempt from tick 0 and record it; without `nominal` it is the nominal itself."""
    nominal_id = nominal.rollout_id if nominal else None
    facts = {"nominal_rollout_id": nominal_id, **SCENE, **policy.effective_action()}
    rollout = group.begin_rollout(role=role, action_key=policy.key, **facts)
    stored = nominal.tables["controls"].to_pylist() if nominal else []
    start = nominal.record["branch_tick"] if nominal else MAX_TICKS
    world, observed, brakes = World(), [], []
    for tick in range(MAX_TICKS):
        if world.x_m >= ROUTE_X_M[-1]:
            break
        applied = expert = world.expert()
        if tick % STRIDE_TICKS == 0:
            observed.append(world.observe(tick))  # before the control acts
        row = named("expert", expert)
        active = start <= tick < start + policy.duration_ticks  # never for the nominal policy: its duration is 0
        if active:
            copied = bd.Command(*(np.float32(stored[tick][name]) for name in named("applied", expert)))
            applied = policy.command(expert, copied)
            row |= named("nominal", copied) | named("intended", applied)
        source = "intervention" if active else "online_expert"
        rollout.append_ticks(tick=tick, active=active, source=source, **row, **named("applied", applied))
        brakes.append(expert.brake)
        world.step(applied)
    num_collisions = record_observations(rollout, observed)
    fraction = min(world.x_m / ROUTE_X_M[-1], 1.0)
    is_there = fraction == 1
    return rollout.finish(
        status="complete", **(branch_of(nominal) if nominal else find_branch(rollout.rollout_id, brakes)),
        result_completion="completed" if is_there else "timeout",
        result_termination="end of route" if is_there else "out of time",
        result_route_fraction=fraction, result_num_vehicle_collisions=num_collisions,
    )  # fmt: skip


def named(prefix: str, command: bd.Command) -> dict[str, Any]:
    """Columns of a command, such as ``applied_steer``."""
    return {f"{prefix}_{actuator}": value for actuator, value in command._asdict().items()}


def record_observations(rollout: bd.RolloutWriter, rows: list[dict[str, Any]]) -> int:
    """Append the tables of the saved observations; the number of collisions."""
    observations = to_columns(rows)
    actors = to_columns([{"tick": row["tick"], "actor_id": 1, "actor_class": "vehicle", **PARKED_CAR} for row in rows])
    # Evidence is computed from the columns as they are recorded, already rounded.
    size = {"ego_length_m": EGO_BOX["length_m"], "ego_width_m": EGO_BOX["width_m"]}
    route = {"route_x_m": np.array(ROUTE_X_M), "route_y_m": np.array(ROUTE_Y_M)}
    evidence = bd.risk_evidence(observations, actors, **size, **route)
    # What follows only the simulator knows; with contact events of its own it would not look at the gap.
    on_road = np.abs(observations["y_m"]) <= 5.25
    collision = np.ma.filled(evidence["separation_m"], np.inf) == 0
    lane_id = ["lane-1" if is_on else None for is_on in on_road]  # None is null: unavailable, no stand-in value
    rollout.append_observations(**observations)
    rollout.append_actors(**actors)
    rollout.append_evidence(
        tick=observations["tick"], **evidence, lane_id=lane_id, on_road=on_road, collision=collision,
        traffic_light_available=False,
    )  # fmt: skip
    return int(np.sum(np.diff(collision.astype(int), prepend=0) == 1))


def to_columns(rows: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Arrays of the rows' values, real numbers rounded to the type that they are recorded in."""
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    singles = [name for name, array in columns.items() if array.dtype.kind == "f" and name not in DOUBLE_COLUMNS]
    return columns | {name: columns[name].astype(np.float32) for name in singles}


def find_branch(nominal_id: str, brakes: list[np.float32]) -> dict[str, Any]:
    """Place the branch at the observation before the expert brakes, from the nominal rollout alone."""
    tick = next(tick for tick, brake in enumerate(brakes) if tick >= 80 and brake >= BRAKE_THRESHOLD)
    frame = tick // STRIDE_TICKS
    return {
        "branch_tick": frame * STRIDE_TICKS, "branch_frame": frame, "trigger_definition": "first-brake/1",
        "trigger_rollout_id": nominal_id, "trigger_tick": tick, "trigger_signal": "brake",
        "trigger_value": brakes[tick], "trigger_threshold": BRAKE_THRESHOLD, "trigger_confidence": 1.0,
    }  # fmt: skip


def branch_of(nominal: bd.Rollout) -> dict[str, Any]:
    """Every other attempt of the group carries the branch of its nominal."""
    return {name: value for name, value in nominal.record.items() if name.startswith(("branch_", "trigger_"))}


def collect(root: str) -> str:
    """Write the dataset at `root`, going on where an interrupted run stopped; its identity."""
    descriptor = describe()
    bank = descriptor.action_bank
    with bd.DatasetWriter(root, descriptor) as writer:
        with writer.begin_group("straight-road-seed3") as group:
            nominal = group.find("nominal", bank.nominal.key) or drive(group, "nominal", bank.nominal)
            for finding in bd.check_rollout(nominal, descriptor):  # before replays are spent on it
                raise SystemExit(finding.message)
            for policy in bank.interventions:
                group.find("intervention", policy.key) or drive(group, "intervention", policy, nominal)
            group.find("nominal_replay", bank.nominal.key) or drive(group, "nominal_replay", bank.nominal, nominal)
        return writer.finalize()


def main() -> int:
    """Collect into the folder that the command line names; 0, or 2 if that cannot be done."""
    parser = argparse.ArgumentParser(description="Collect one branch group on a straight road.")
    parser.add_argument("root", help="folder of the dataset")
    root = parser.parse_args().root
    try:
        identity = collect(root)
    except (bd.BranchDriveError, OSError) as error:
        sys.stderr.write(f"minimal_collector: {error}\n")
        return 2
    validate = shlex.join(["branchdrive-validate", root])
    sys.stdout.write(f"dataset   {root}\nidentity  {identity}\nnext      {validate}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
