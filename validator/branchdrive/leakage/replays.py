"""What a leakage audit may see of a shard's replays: rows before the branch, and how many of them are there.

The ego history is in the frame of the group's nominal at its branch. With ``p_j``, ``yaw_j`` and ``v_j`` of a replay
at the observations ``t_b - 80 .. t_b``, ``p_n`` and ``yaw_n`` the pose of the nominal at ``t_b`` and ``dt = 0.25 s``::

    x, y     = R(-yaw_n) (p_j - p_n)         yaw      = wrap(yaw_j - yaw_n)           speed = v_j
    accel    = (v_j - v_{j-1}) / dt          yaw_rate = wrap(yaw_j - yaw_{j-1}) / dt

All rows of a group share one frame, so that an offset between replays stays visible.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md#inputs; the variables of the
ego history are this project's choice.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.timing import HISTORY_OBSERVATIONS, HISTORY_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.driving.angle import cos_sin, wrap_rad
from branchdrive.driving.history import CONTROL_WINDOW, STATE_WINDOW
from branchdrive.driving.target import STEP_S
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.recording import camera_numbers, has_all_images, recorded_numbers
from branchdrive.leakage.streams import Streams, examined_cameras, ranked, stream_columns
from branchdrive.quality.replay import Pairs
from branchdrive.quality.threshold import VARIABLES
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows
from branchdrive.tables.frame import Frame, take

__all__ = [
    "AVAILABILITY_NAMES",
    "CONTROL_NAMES",
    "DIMENSIONS",
    "EGO_NAMES",
    "collected_inputs",
    "core_valid_homes",
    "ego_frames",
    "inputs_of_facts",
    "replay_facts",
    "replay_inputs",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AVAILABILITY_NAMES = ("controls", "observations", "evidence", "actors")
"""Streams whose share of the expected rows before the branch is an input."""

CONTROL_NAMES = ("steer", "throttle", "brake")

DIMENSIONS = ("ego_length_m", "ego_width_m", "ego_height_m")
"""Columns of an attempt with the size of its vehicle."""

_AUDITED = (
    "group_id", "availability", "discrepancy", "ego", "controls", "has_nominal_replay", "stream_ranks", "stream_spread",
)  # fmt: skip
"""Facts that an audit sees; what rules ask of nominals is beside them."""

EGO_NAMES = ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2", "yaw_rate_radps")
"""Variables in the order of the last axis of `ego_frames`."""


def replay_facts(
    view: ShardView, groups: Index, candidates: Index, replays: Index, pairs: Pairs, paired: Frame
) -> Frame:
    """Inputs of integrity-complete groups.

    Args:
        view: The shard.
        groups: Their indices ``[groups]``.
        candidates: Their chosen attempts ``[groups, policies]``.
        replays: Compliant nominal replays of these groups; of several, the lowest attempt stands for the nominal.
        pairs: All pairs of replay and nominal.
        paired: Their discrepancies, columns of the table `pairs`.

    Returns:
        A row for each group: cells of the shapes of `ReplayInputs`, whether numbers are those of all images, numbers
        of the nominal's images in the order of `camera_columns`, its environment, and its `DIMENSIONS`.
    """
    nominal_index = view.descriptor.action_bank.nominal_index
    drives = candidates.copy()
    drives[:, nominal_index] = -1
    order = sorted(replays.tolist(), key=lambda i: (view.rollouts["attempt"][i], view.rollout_ids[i]))
    place = {int(group): row for row, group in enumerate(groups)}
    for i in order[::-1]:
        drives[place[int(view.group[i])], nominal_index] = i
    there = drives >= 0
    discrepancy = np.full((*drives.shape, len(VARIABLES)), np.nan)
    row_of = np.full(view.num_rollouts, -1)
    row_of[pairs.replay] = np.arange(len(pairs.replay))
    values = np.stack([np.ma.filled(paired[v.name], np.inf) for v in VARIABLES], axis=1)
    discrepancy[there] = values[row_of[drives[there]]]
    interventions = np.delete(drives, nominal_index, axis=1)
    numbers = recorded_numbers(view, interventions.ravel())
    nominals = candidates[:, nominal_index]
    stream_ranks, stream_spread = ranked(numbers.reshape(*interventions.shape, numbers.shape[1]))
    return {
        "group_id": np.array(view.group_ids, object)[groups],
        "availability": _availability(view, drives),
        "discrepancy": discrepancy,
        "ego": _ego(view, drives, nominals),
        "controls": _controls(view, drives),
        "has_nominal_replay": there[:, nominal_index],
        "stream_ranks": stream_ranks,
        "stream_spread": stream_spread,
        "has_images": np.full(len(groups), has_all_images(view)),
        "nominal_images": camera_numbers(view, nominals).astype(np.float32),
        "environment": view.rollouts["environment"][nominals],
        "dimensions": np.stack([view.rollouts[name][nominals] for name in DIMENSIONS], axis=1).astype(np.float64),
    }


def _absent(values: Array, drives: Index) -> Array:
    values[drives < 0] = np.nan
    return values


def _availability(view: ShardView, drives: Index) -> Array:
    """Share of the expected rows that are there, ``[groups, policies, streams]``; 1 where a stream is not claimed."""
    flat = np.where(drives < 0, 0, drives).ravel()
    windows = {
        "controls": CONTROL_WINDOW,
        "observations": (PREDECESSOR_OFFSET, *HISTORY_OFFSETS),
        "evidence": HISTORY_OFFSETS,
        "actors": HISTORY_OFFSETS,
    }
    shares = np.ones((len(flat), len(AVAILABILITY_NAMES)))
    for column, name in enumerate(AVAILABILITY_NAMES):
        if name in view:
            ticks = view.branch_tick[flat][:, None] + np.asarray(windows[name])
            found = view.stream(name).find(np.broadcast_to(flat[:, None], ticks.shape), ticks)
            shares[:, column] = (found >= 0).mean(axis=1)
    return _absent(shares.reshape(*drives.shape, len(AVAILABILITY_NAMES)), drives)


def _ego(view: ShardView, drives: Index, nominals: Index) -> Array:
    observations = view.observations
    flat = np.where(drives < 0, 0, drives).ravel()
    rows = window_rows(view, observations, flat, STATE_WINDOW)
    fields = [
        observations[name][rows].astype(np.float64).reshape(*drives.shape, len(STATE_WINDOW))
        for name in ("x_m", "y_m", "yaw_rad", "speed_mps")
    ]
    at = window_rows(view, observations, nominals, (0,))[:, 0]
    pose = np.stack([observations[name][at].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad")], axis=1)
    x, y, yaw, speed = fields
    return _absent(ego_frames(x, y, yaw, speed, pose), drives)


def ego_frames(
    x_m: ArrayLike, y_m: ArrayLike, yaw_rad: ArrayLike, speed_mps: ArrayLike, nominal_pose: ArrayLike
) -> Array:
    """Ego history ``[groups, actions, 16, 6]`` in the order of `EGO_NAMES`, NaN where it cannot be had.

    Args:
        x_m: Ego centre ``[groups, actions, 17]`` at ``t_b - 80, t_b - 75, .. t_b``, world frame.
        y_m: As `x_m`.
        yaw_rad: Heading, as `x_m`.
        speed_mps: Longitudinal speed, as `x_m`.
        nominal_pose: ``[groups, 3]``: x (m), y (m) and heading (rad) of the nominal at its ``t_b``, world frame.

    Raises:
        ValueError: A shape is wrong.
    """
    fields = [np.asarray(values, np.float64) for values in (x_m, y_m, yaw_rad, speed_mps)]
    pose = np.asarray(nominal_pose, np.float64)
    shape = fields[0].shape
    if len(shape) != 3 or shape[2] != HISTORY_OBSERVATIONS + 1 or any(f.shape != shape for f in fields):
        raise ValueError(f"histories have shapes {[list(f.shape) for f in fields]}, not [groups, actions, 17]")
    if pose.shape != (shape[0], 3):
        raise ValueError(f"`nominal_pose` has shape {list(pose.shape)}, not [{shape[0]}, 3]")
    x, y, yaw, speed = (np.where(np.isfinite(f), f, np.nan) for f in fields)
    x_n, y_n, yaw_n = (column[:, None, None] for column in pose.T)
    with np.errstate(over="ignore", invalid="ignore"):
        dx, dy = x[..., 1:] - x_n, y[..., 1:] - y_n
        cos, sin = cos_sin(yaw_n)
        frames = np.stack(
            [
                cos * dx + sin * dy,
                cos * dy - sin * dx,
                wrap_rad(yaw[..., 1:] - yaw_n),
                speed[..., 1:],
                np.diff(speed, axis=2) / STEP_S,
                wrap_rad(np.diff(yaw, axis=2)) / STEP_S,
            ],
            axis=3,
        )
    return np.where(np.isfinite(frames), frames, np.nan)


def _controls(view: ShardView, drives: Index) -> Array:
    flat = np.where(drives < 0, 0, drives).ravel()
    rows = window_rows(view, view.controls, flat, CONTROL_WINDOW)
    applied = [view.controls[f"applied_{name}"][rows].astype(np.float64) for name in CONTROL_NAMES]
    return _absent(np.stack(applied, axis=2).reshape(*drives.shape, len(CONTROL_WINDOW), len(CONTROL_NAMES)), drives)


def replay_inputs(replays: Frame, groups: Frame, descriptor: Descriptor) -> ReplayInputs:
    """Inputs of the audit of a release: its core-valid groups with their partitions.

    Args:
        replays: Facts of the replays of integrity-complete groups, as `replay_facts` gives them.
        groups: Rows of `group_quality`, complete.
        descriptor: Of the dataset, which names the action bank and the recorded tables.

    Raises:
        ValueError: A core-valid group is not integrity-complete, or images were not all decoded.
    """
    return collected_inputs([replays], core_valid_homes(groups), descriptor)


def core_valid_homes(groups: Frame) -> dict[str, str]:
    """Partition of every core-valid group, of rows of `group_quality`."""
    valid = np.asarray(groups["core_valid"], bool)
    homes = np.ma.filled(groups["partition"], "")[valid].tolist()
    return dict(zip(groups["group_id"][valid].tolist(), homes, strict=True))


def collected_inputs(replays: Iterable[Frame], homes: Mapping[str, str], descriptor: Descriptor) -> ReplayInputs:
    """Inputs of the audit of some groups whose facts come in parts, of which one at a time is held.

    Args:
        replays: Facts of the replays of groups, as `replay_facts` gives them, each group in one part.
        homes: Partition of each group of the audit.
        descriptor: As `replay_inputs` takes it.

    Raises:
        ValueError: As `replay_inputs`.
    """
    chosen = sorted(homes)
    place = {group: row for row, group in enumerate(chosen)}
    found: dict[str, NDArray[Any]] = {}
    is_found = np.zeros(len(chosen), bool)
    for part in replays:
        groups = part["group_id"].tolist()
        rows = np.array([row for row, group in enumerate(groups) if group in place], np.intp)
        at = np.array([place[groups[row]] for row in rows.tolist()], np.intp)
        if not part["has_images"][rows].all():
            raise ValueError("not all images were decoded")
        for name in _AUDITED:
            if name not in found:
                found[name] = np.zeros((len(chosen), *part[name].shape[1:]), part[name].dtype)
            found[name][at] = part[name][rows]
        is_found[at] = True
    if not is_found.all():
        raise ValueError(f"group {chosen[int(np.argmin(is_found))]!r} is core-valid and not integrity-complete")
    for values in found.values():
        values.flags.writeable = False
    return inputs_of_facts(found, None, tuple(homes[group] for group in chosen), descriptor)


def inputs_of_facts(
    replays: Frame, rows: NDArray[np.intp] | None, partitions: tuple[str, ...], descriptor: Descriptor
) -> ReplayInputs:
    """Inputs of some groups.

    Args:
        replays: Facts of the replays of groups, as `replay_facts` gives them.
        rows: Rows of the groups, in the order of their identities; ``None`` where those are all, in their order.
        partitions: Partition of each.
        descriptor: Of the dataset.
    """
    bank = descriptor.action_bank
    facts = replays if rows is None else take(replays, rows)
    return ReplayInputs(
        tuple(facts["group_id"].tolist()),
        partitions,
        tuple(bank.keys),
        bank.nominal_index,
        AVAILABILITY_NAMES,
        EGO_NAMES,
        CONTROL_NAMES,
        facts["availability"],
        facts["discrepancy"],
        facts["ego"],
        facts["controls"],
        facts["has_nominal_replay"],
        Streams(
            stream_columns(descriptor.tables, examined_cameras(descriptor)),
            facts["stream_ranks"],
            facts["stream_spread"],
        ),
    )
