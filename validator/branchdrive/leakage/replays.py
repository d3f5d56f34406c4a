"""What a leakage audit may see of a shard's replays: rows before the branch, and how many of them are there.

Source: paper VI-A; spec/13-leakage.md#inputs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.timing import HISTORY_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.driving.history import CONTROL_WINDOW, STATE_WINDOW
from branchdrive.leakage.ego import EGO_NAMES, ego_frames
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.quality.replay import Pairs
from branchdrive.quality.threshold import VARIABLES
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows
from branchdrive.tables.frame import Frame

__all__ = ["AVAILABILITY_NAMES", "CONTROL_NAMES", "replay_facts", "replay_inputs"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AVAILABILITY_NAMES = ("controls", "observations", "evidence", "actors")
"""Streams whose share of the expected rows before the branch is an input."""

CONTROL_NAMES = ("steer", "throttle", "brake")


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
        A row for each group; see `ReplayInputs` for the shapes of its cells.
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
    return {
        "group_id": np.array(view.group_ids, object)[groups],
        "availability": _availability(view, drives),
        "discrepancy": discrepancy,
        "ego": _ego(view, drives, candidates[:, nominal_index]),
        "controls": _controls(view, drives),
        "has_nominal_replay": there[:, nominal_index],
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


def _controls(view: ShardView, drives: Index) -> Array:
    flat = np.where(drives < 0, 0, drives).ravel()
    rows = window_rows(view, view.controls, flat, CONTROL_WINDOW)
    applied = [view.controls[f"applied_{name}"][rows].astype(np.float64) for name in CONTROL_NAMES]
    return _absent(np.stack(applied, axis=2).reshape(*drives.shape, len(CONTROL_WINDOW), len(CONTROL_NAMES)), drives)


def replay_inputs(replays: Frame, groups: Frame, bank: ActionBank) -> ReplayInputs:
    """Inputs of the audit of a release: its core-valid groups with their partitions.

    Args:
        replays: Facts of the replays of integrity-complete groups, as `replay_facts` gives them.
        groups: Rows of `group_quality`, complete.
        bank: The action bank.

    Raises:
        ValueError: A core-valid group is not integrity-complete.
    """
    valid = np.asarray(groups["core_valid"], bool)
    home = dict(
        zip(groups["group_id"][valid].tolist(), np.ma.filled(groups["partition"], "")[valid].tolist(), strict=True)
    )
    place = {group: row for row, group in enumerate(replays["group_id"].tolist())}
    chosen = sorted(home)
    if not set(chosen) <= place.keys():
        raise ValueError(f"group {min(set(chosen) - place.keys())!r} is core-valid and not integrity-complete")
    rows = [place[group] for group in chosen]
    return ReplayInputs(
        tuple(chosen),
        tuple(home[group] for group in chosen),
        tuple(bank.keys),
        bank.nominal_index,
        AVAILABILITY_NAMES,
        EGO_NAMES,
        CONTROL_NAMES,
        replays["availability"][rows],
        replays["discrepancy"][rows],
        replays["ego"][rows],
        replays["controls"][rows],
        replays["has_nominal_replay"][rows],
    )
