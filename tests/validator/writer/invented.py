"""Small invented rollouts: conforming, deterministic in their identity, and driven by nobody."""

from __future__ import annotations

import zlib
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tests.validator.formats.image_files import noise, png

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.camera import Camera, TopDownCamera
from branchdrive.contract.descriptor import Collection, Descriptor, ReplayNoise, Software
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive.raw.rollout import Rollout
from branchdrive.writer.group_writer import GroupWriter
from branchdrive.writer.rollout_writer import RolloutWriter
from branchdrive.writer.writer import DatasetWriter

BRANCH_TICK = 80
WHOLE_TICKS = BRANCH_TICK + ACTIVE_TICKS + 1
"""Ticks of a rollout that holds every window."""

ATTEMPTS = (("nominal", "nominal"), ("intervention", "brake_0.50"), ("nominal_replay", "nominal"))
"""Role and action key of the attempts of a small group."""


def camera(name: str, stream: Any) -> Camera:
    """A camera of 5 x 4 pixels."""
    return TopDownCamera(
        name=name, stream=stream, width_px=5, height_px=4, px_per_m=1.0, origin_row_px=2.0, origin_column_px=2.5
    )


CAMERAS = (camera("top_down", "rgb_top_down"), camera("bev", "semantic_bev"))
"""Cameras of two media streams, with which an invented dataset may have media."""


def image_of(camera: Camera, *identity: object) -> bytes:
    """An image of a camera that depends on an identity alone."""
    channels = () if camera.stream == "semantic_bev" else (3,)
    return png(noise(zlib.crc32(repr((camera.name, identity)).encode()), camera.height_px, camera.width_px, *channels))


def make_descriptor(*, has_evidence: bool = True, has_media: bool = False, dataset_id: str = "invented") -> Descriptor:
    evidence = ("actor_risk_evidence",) if has_evidence else ()
    media = tuple(camera.stream for camera in CAMERAS) if has_media else ()
    return Descriptor(
        dataset_id=dataset_id,
        dataset_version="0.1.0",
        title="Invented rollouts",
        licence="CC-BY-4.0",
        simulator=Software(name="none", version="1"),
        collector=Software(name="tests", version="1"),
        streams=("ego_route_state", "controls", "route_result", *evidence, *media),
        cameras=CAMERAS if has_media else (),
        action_bank=load_action_bank(),
        collection=Collection(seed=1, replay_noise=ReplayNoise(kind="natural")),
    )


def identity_fields(role: str, action_key: str, nominal_id: str | None) -> dict[str, object]:
    """Columns of the rollouts table that are known when a rollout begins."""
    return {
        "role": role,
        "action_key": action_key,
        "protocol_variant": "v1",
        "nominal_rollout_id": None if role == "nominal" else nominal_id,
        "scenario_type": "CutIn",
        "town": "Town12",
        "route_id": "route-7",
        "route_x_m": [0.0, 50.0, 100.0],
        "route_y_m": np.array([0.0, 1.0, 4.0]),
        "environment": "ClearNoon",
        "seed": 2**53 + 1,
        "repetition": 0,
        "ego_length_m": 4.5,
        "ego_width_m": 1.9,
        "ego_height_m": 1.6,
        "simulator_version": "1",
        "collector_version": "1",
        "provenance": "invented",
        **load_action_bank()[action_key].effective_action(),
    }


def result_fields() -> dict[str, object]:
    """Columns of the rollouts table that are known when a rollout ends."""
    return {
        "status": "complete",
        "result_completion": "completed",
        "result_termination": "end of route",
        "result_route_fraction": 1.0,
        "result_num_vehicle_collisions": 0,
    }


def branch_fields(nominal_id: str, branch_tick: int = BRANCH_TICK) -> dict[str, object]:
    """Branch and trigger columns of the rollouts table."""
    return {
        "branch_tick": branch_tick,
        "branch_frame": branch_tick // OBSERVATION_STRIDE_TICKS,
        "trigger_definition": "first brake",
        "trigger_rollout_id": nominal_id,
        "trigger_tick": branch_tick,
        "trigger_signal": "brake",
        "trigger_value": 0.4,
        "trigger_threshold": 0.3,
        "trigger_confidence": 1.0,
    }


def control_rows(rng: np.random.Generator, num_ticks: int, active: np.ndarray) -> dict[str, Any]:
    """Columns of the control audit, ``[num_ticks]``; policy columns are masked off the active window."""
    columns: dict[str, Any] = {
        "tick": np.arange(num_ticks),
        "active": active,
        "source": np.where(active, "intervention", "online_expert"),
    }
    for actuator, low in (("steer", -1.0), ("throttle", 0.0), ("brake", 0.0)):
        for kind in ("expert", "applied"):
            columns[f"{kind}_{actuator}"] = rng.uniform(low, 1.0, num_ticks).astype(np.float32)
        for kind in ("nominal", "intended"):
            values = rng.uniform(low, 1.0, num_ticks).astype(np.float32)
            columns[f"{kind}_{actuator}"] = np.ma.MaskedArray(values, mask=~active)
    return columns


def observation_rows(rng: np.random.Generator, num_ticks: int) -> dict[str, Any]:
    """Columns of the observations, one row every five ticks."""
    ticks = np.arange(0, num_ticks, OBSERVATION_STRIDE_TICKS)
    unsigned = ("speed_limit_mps", "route_progress_m", "target_speed_mps")
    signed = (
        "yaw_rad", "speed_mps", "accel_longitudinal_mps2", "accel_lateral_mps2", "yaw_rate_radps", "route_offset_m",
        "route_heading_error_rad", "target_point_1_x_m", "target_point_1_y_m", "target_point_2_x_m",
        "target_point_2_y_m", "x_m", "y_m",
    )  # fmt: skip
    return {
        "tick": ticks,
        **{name: rng.uniform(0, 3, ticks.size) for name in unsigned},
        **{name: rng.uniform(-3, 3, ticks.size) for name in signed},
        "command": ["follow"] * ticks.size,
        **{
            name: rng.random(ticks.size) < 0.5
            for name in ("vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard")
        },
    }


def actor_row(rng: np.random.Generator, tick: int, actor_id: int) -> dict[str, Any]:
    """Columns of one actor at one observation, as scalars."""
    x_m, y_m, yaw_rad, vel_x_mps, vel_y_mps = rng.uniform(-3, 3, 5).tolist()
    return {
        "tick": tick, "actor_id": actor_id, "actor_class": "vehicle", "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad,
        "length_m": 4.0, "width_m": 1.8, "height_m": 1.5, "vel_x_mps": vel_x_mps, "vel_y_mps": vel_y_mps,
    }  # fmt: skip


def evidence_row(rng: np.random.Generator, tick: int, num_actors: int) -> dict[str, Any]:
    """Columns of the evidence at one observation, as scalars; what is unavailable is left out."""
    near = num_actors > 0
    return {
        "tick": tick,
        "num_actors": num_actors,
        "separation_available": near,
        "separation_m": float(rng.uniform(0, 40)) if near else None,
        "separation_actor_id": 0 if near else None,
        "ttc_available": False,
        "nearest_vehicle_available": False,
        "nearest_pedestrian_available": False,
        "traffic_light_available": near,
        "traffic_light": "red" if near else None,
        "on_road": True,
        "collision": False,
    }


def generator(*identity: object) -> np.random.Generator:
    """Random numbers that depend on an identity alone."""
    return np.random.default_rng(zlib.crc32(repr(identity).encode()))


def _without(unrecorded: Container[str], table: str, columns: Mapping[str, Any]) -> dict[str, Any]:
    return {name: values for name, values in columns.items() if f"{table}.{name}" not in unrecorded}


def fill(
    rollout: RolloutWriter,
    identity: tuple[object, ...],
    *,
    num_ticks: int,
    is_active: bool,
    has_evidence: bool,
    without: Container[str] = (),
    frame_ticks: Sequence[int] = (),
) -> None:
    """Append the streams of one invented rollout, the columns `without` left out."""
    for tick in frame_ticks:
        for camera in CAMERAS:
            rollout.append_frame(tick, camera.name, image_of(camera, identity, tick))
    rng = generator(*identity)
    ticks = np.arange(num_ticks)
    active = is_active & (ticks >= BRANCH_TICK) & (ticks < BRANCH_TICK + ACTIVE_TICKS)
    rollout.append_ticks(**control_rows(rng, num_ticks, active))
    rollout.append_observations(**_without(without, "observations", observation_rows(rng, num_ticks)))
    for tick in range(0, num_ticks if has_evidence else 0, OBSERVATION_STRIDE_TICKS):
        num_actors = tick // OBSERVATION_STRIDE_TICKS % 3
        for actor_id in range(num_actors):
            rollout.append_actors(**_without(without, "actors", actor_row(rng, tick, actor_id)))
        rollout.append_evidence(**evidence_row(rng, tick, num_actors))


def write_rollout(
    group: GroupWriter,
    role: str,
    action_key: str,
    *,
    num_ticks: int = 12,
    has_evidence: bool = True,
    more: Mapping[str, object] | None = None,
    without: Container[str] = (),
    frame_ticks: Sequence[int] = (),
) -> Rollout:
    """Write one invented rollout; it depends on group, role, action key and attempt only."""
    nominal_id = f"{group.group_id}.nominal.v1.a1"
    rollout = group.begin_rollout(**_without(without, "rollouts", identity_fields(role, action_key, nominal_id)))
    identity = (group.group_id, role, action_key, rollout.attempt)
    is_active = role == "intervention"
    content = {"has_evidence": has_evidence, "without": without, "frame_ticks": frame_ticks}
    fill(rollout, identity, num_ticks=num_ticks, is_active=is_active, **content)
    return rollout.finish(**result_fields(), **branch_fields(nominal_id), **(more or {}))


def write_group(group: GroupWriter, attempts: Sequence[tuple[str, str]] = ATTEMPTS, **options: Any) -> None:
    """Write what is missing of a small group's attempts, in one go or after an interruption."""
    for role, action_key in attempts:
        if group.find(role, action_key) is None:
            write_rollout(group, role, action_key, **options)


def write_dataset(root: Path, num_groups: int, *, groups_per_shard: int = 2, num_ticks: int = 12) -> str:
    """Write a small dataset from start to end; its identity."""
    with DatasetWriter(root, make_descriptor(), groups_per_shard=groups_per_shard) as writer:
        for index in range(num_groups):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group, num_ticks=num_ticks)
        return writer.finalize()
