"""Tick rules: the clock of controls and observations, the branch on it, and the windows before and after the branch.

The branch was placed by the nominal rollout alone, and history and future are complete.

Source: paper, "Branch-Group Representation", "Two-Pass Collection" and "Collection Integrity, Replay Fidelity, and
Leakage"; spec/02-time-frames-units.md, spec/05-raw-streams.md#control-ticks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.contract.timing import (
    ACTIVE_TICKS,
    CONTROL_HISTORY_TICKS,
    FUTURE_OFFSETS,
    HISTORY_OFFSETS,
    OBSERVATION_STRIDE_TICKS,
    PREDECESSOR_OFFSET,
)
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

__all__ = []


def _steps(stream: StreamView, step: int, subjects: Mask) -> Check:
    """Ticks of each rollout start at 0 and increase by exactly `step`."""
    jump = np.ones(len(stream), bool)
    jump[1:] = np.diff(stream.tick) != step
    first = stream.start[stream.start < stream.stop]
    jump[first] = stream.tick[first] != 0
    summary = stream.by_rollout(jump)
    empty = stream.stop == stream.start

    def describe(i: int) -> Mismatch:
        if empty[i]:
            return Mismatch({"table": stream.name}, "rows", "none")
        row = int(summary.first_row[i])
        here = int(stream.tick[row])
        if row == stream.start[i]:
            return Mismatch({"table": stream.name, "tick": here}, "tick 0 first", f"tick {here}", int(summary.count[i]))
        before = int(stream.tick[row - 1])
        return Mismatch(
            {"table": stream.name, "tick": here},
            f"tick {before + step} after tick {before}",
            f"tick {here}",
            int(summary.count[i]),
        )

    return Check.of_subjects(subjects, subjects & (summary.any | empty), describe)


@rule("BD-TIC-001")
def control_ticks_increase_by_one(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``tick[0] = 0``, ``tick[i+1] = tick[i] + 1``."""
    yield _steps(view.controls, 1, subjects)


@rule("BD-TIC-002")
def observations_keep_stride(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``tick[0] = 0``, ``tick[i+1] = tick[i] + 5``, up to the last control, or the tick after it."""
    yield Check.of_any(_steps(view.observations, OBSERVATION_STRIDE_TICKS, subjects), _observed_end(view, subjects))


def _observed_end(view: ShardView, subjects: Mask) -> Check:
    """The last observation is that of the last control, or the state that the last control led to."""
    subjects = (
        subjects & (view.observations.stop > view.observations.start) & (view.controls.stop > view.controls.start)
    )
    rollouts = np.flatnonzero(subjects)
    end, last = (np.full(view.num_rollouts, -1, np.int64) for _ in range(2))
    end[rollouts] = view.controls.tick[view.controls.stop[rollouts] - 1].astype(np.int64) + 1
    last[rollouts] = view.observations.tick[view.observations.stop[rollouts] - 1]
    least = (end - 1) // OBSERVATION_STRIDE_TICKS * OBSERVATION_STRIDE_TICKS

    def describe(i: int) -> Mismatch:
        expected = f"observations up to tick {least[i]}, since the last control is at tick {end[i] - 1}"
        place: Location = {"table": "observations", "tick": int(last[i])}
        return Mismatch(place, expected, f"the last at tick {last[i]}")

    return Check.of_subjects(subjects, subjects & ((last < least) | (last > end)), describe)


@rule("BD-TIC-003")
def branch_is_an_observation_tick(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``t_b = 5 * branch_frame``; an attempt without a branch cannot qualify."""
    frame = view.rollouts["branch_frame"].astype(np.int64)
    bad = ~view.branched | (view.branch_tick != frame * OBSERVATION_STRIDE_TICKS)

    def describe(i: int) -> Mismatch:
        place: Location = {"table": "rollouts", "column": "branch_tick"}
        if not view.branched[i]:
            return Mismatch(place, "a branch tick", "no branch: the trigger found nothing")
        found = f"branch_tick {view.branch_tick[i]} and branch_frame {frame[i]}"
        return Mismatch(place, "branch_tick = 5 x branch_frame", found)

    yield Check.of_subjects(subjects, subjects & bad, describe)


@rule("BD-TRG-001")
def trigger_reads_the_nominal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``trigger_rollout_id`` is the attempt's own nominal."""
    subjects = subjects & view.branched
    own = np.where(view.role("nominal"), view.rollouts["rollout_id"], view.rollouts["nominal_rollout_id"])
    named = view.rollouts["trigger_rollout_id"]

    def describe(i: int) -> Mismatch:
        return Mismatch({"table": "rollouts", "column": "trigger_rollout_id"}, quote(own[i]), quote(named[i]))

    yield Check.of_subjects(subjects, subjects & (own != named), describe)


@rule("BD-TRG-002")
def branch_precedes_trigger(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``t_b <= trigger_tick``, and the nominal rollout has a control row at the trigger tick."""
    subjects = subjects & view.branched
    tick = view.rollouts["trigger_tick"].astype(np.int64)
    inside = view.controls.find(view.nominal, tick) >= 0

    def describe(i: int) -> Mismatch:
        expected = f"a trigger tick of the nominal at or after branch tick {view.branch_tick[i]}"
        found = f"tick {tick[i]}" + ("" if inside[i] else ", which the nominal does not have")
        return Mismatch({"table": "rollouts", "column": "trigger_tick"}, expected, found)

    yield Check.of_subjects(subjects, subjects & ~(inside & (view.branch_tick <= tick)), describe)


_SIGNALS = {"brake": "expert_brake", "throttle_release": "expert_throttle", "steer": "expert_steer"}
"""Commands of the nominal that show a trigger signal; nothing recorded shows a lane shift."""

_STEADY = "steady"
"""Signal of a control branch, at which the commands stay as they are."""


def _largest_change(commands: StreamView, rollouts: NDArray[np.int64], tick: NDArray[np.int64]) -> NDArray[np.float64]:
    """Largest change of a command of the expert from `tick` on, over 50 ticks of rollouts that have it ``[n]``."""
    rows = commands.find(rollouts[:, None], tick[:, None] + np.arange(ACTIVE_TICKS))
    values = np.stack([commands[column][rows].astype(np.float64) for column in _SIGNALS.values()])
    changes = np.abs(values - values[..., :1])
    return np.asarray(np.where(rows >= 0, changes, 0.0).max(axis=(0, 2)))


@rule("BD-TRG-003")
def trigger_shows_in_the_nominal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The signal at ``trigger_tick`` is the nominal's command, on its side of the threshold, soon after ``t_b``."""
    subjects, bounds, rollouts = subjects & view.branched, physical_bounds(), view.rollouts
    tick = rollouts["trigger_tick"].astype(np.int64)
    value, threshold = (rollouts[f"trigger_{name}"].astype(np.float64) for name in ("value", "threshold"))
    row = view.controls.find(view.nominal, tick)
    command = value.copy()
    for signal, column in _SIGNALS.items():
        here = rollouts.equals("trigger_signal", signal) & (row >= 0)
        command[here] = view.controls[column][row[here]]
    is_steady = rollouts.equals("trigger_signal", _STEADY)
    steady = np.flatnonzero(subjects & is_steady & (row >= 0))
    command[steady] = _largest_change(view.controls, view.nominal[steady], tick[steady])
    stays_below = is_steady | rollouts.equals("trigger_signal", "throttle_release")
    passes = np.where(stays_below, value <= threshold, np.abs(value) >= np.abs(threshold))
    is_command = np.abs(np.abs(value) - np.abs(command)) <= bounds.signal
    most_ticks = np.where(is_steady, 0.0, bounds.trigger_delay_ticks)
    is_soon = tick - view.branch_tick <= most_ticks

    def describe(i: int) -> Mismatch:
        signal = rollouts["trigger_signal"][i]
        if not is_command[i]:
            whose = (
                f"the largest change of a command of the nominal within {ACTIVE_TICKS} ticks of the branch"
                if is_steady[i]
                else f"`{_SIGNALS[signal]}` of the nominal at tick {tick[i]}"
            )
            expected = f"{command[i]:g}, {whose}"
            return Mismatch({"table": "rollouts", "column": "trigger_value"}, expected, f"{value[i]:g}")
        if not passes[i]:
            side = "at most" if stays_below[i] else "at least"
            expected = f"{side} the threshold {threshold[i]:g}"
            return Mismatch({"table": "rollouts", "column": "trigger_value"}, expected, f"{value[i]:g}")
        expected = f"at most {most_ticks[i]:g} ticks after branch tick {view.branch_tick[i]}"
        return Mismatch({"table": "rollouts", "column": "trigger_tick"}, expected, f"tick {tick[i]}")

    yield Check.of_subjects(subjects, subjects & ~(is_command & passes & is_soon), describe)


def _ticks_missing(view: ShardView, stream: StreamView, low: int, high: int) -> NDArray[np.int64]:
    """Missing ticks of each attempt in ``t_b + low .. t_b + high``."""
    every = np.arange(view.num_rollouts)
    there = stream.distinct_ticks(every, view.branch_tick + low, view.branch_tick + high)
    return np.asarray(high - low + 1 - there)


def _offsets_missing(
    view: ShardView, stream: StreamView, offsets: Sequence[int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Missing rows of each attempt at ``t_b + offset``, and the first missing tick."""
    ticks = view.branch_tick[:, None] + np.asarray(offsets)[None, :]
    absent = stream.find(np.arange(view.num_rollouts)[:, None], ticks) < 0
    return absent.sum(axis=1), ticks[np.arange(view.num_rollouts), absent.argmax(axis=1)]


@rule("BD-WIN-001")
def control_history_is_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Controls at ``t_b - 80 .. t_b - 1``."""
    subjects = subjects & view.branched
    missing = _ticks_missing(view, view.controls, -CONTROL_HISTORY_TICKS, -1)

    def describe(i: int) -> Mismatch:
        return Mismatch(
            {"table": "controls"},
            f"{CONTROL_HISTORY_TICKS} controls before tick {view.branch_tick[i]}",
            f"{CONTROL_HISTORY_TICKS - missing[i]}",
            int(missing[i]),
        )

    yield Check.of_subjects(subjects, subjects & (missing > 0), describe)


def _observed(view: ShardView, subjects: Mask, table: str, offsets: Sequence[int]) -> Check:
    subjects = subjects & view.branched
    missing, first = _offsets_missing(view, view.stream(table), offsets)

    def describe(i: int) -> Mismatch:
        return Mismatch(
            {"table": table, "tick": int(first[i])},
            f"{len(offsets)} rows, {view.branch_tick[i] + offsets[0]} .. {view.branch_tick[i] + offsets[-1]}",
            f"{missing[i]} missing",
            int(missing[i]),
        )

    return Check.of_subjects(subjects, subjects & (missing > 0), describe)


@rule("BD-WIN-002")
def observation_history_is_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Observations at ``t_b - 80`` (for backward differences) and ``t_b - 75 .. t_b``."""
    yield _observed(view, subjects, "observations", (PREDECESSOR_OFFSET, *HISTORY_OFFSETS))


@rule("BD-WIN-003")
def future_is_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Observations at ``t_b + 5 .. t_b + 50`` and controls at ``t_b .. t_b + 50``."""
    observed = _observed(view, subjects, "observations", FUTURE_OFFSETS)
    missing = _ticks_missing(view, view.controls, 0, ACTIVE_TICKS)

    def describe(i: int) -> Mismatch:
        return Mismatch(
            {"table": "controls"},
            f"{ACTIVE_TICKS + 1} controls from tick {view.branch_tick[i]}",
            f"{missing[i]} missing",
            int(missing[i]),
        )

    subjects = observed.mask
    yield Check.of_any(observed, Check.of_subjects(subjects, subjects & (missing > 0), describe))


@rule("BD-WIN-004")
def evidence_window_is_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Evidence at ``t_b - 75 .. t_b + 50``."""
    yield _observed(view, subjects, "evidence", (*HISTORY_OFFSETS, *FUTURE_OFFSETS))


@rule("BD-WIN-005")
def actors_are_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """At every evidence row, ``num_actors`` rows of the actors table."""
    evidence, actors = view.stream("evidence"), view.stream("actors")
    frame = evidence.rows_of_moments(actors)
    rows = np.zeros(len(evidence), np.int64)
    rows[frame[frame >= 0]] = actors.rows_at_moments[frame >= 0]
    recorded = evidence["num_actors"]
    summary = evidence.by_rollout(rows != recorded)

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        place: Location = {"table": "actors", "tick": int(evidence.tick[row])}
        return Mismatch(place, f"{recorded[row]} actor rows", f"{rows[row]}", int(summary.count[i]))

    subjects = subjects & evidence.is_there
    stretch = replace(summary.stretch, table="actors")  # whose rows they are that lack
    yield Check.of_subjects(subjects, subjects & summary.any, describe, stretch)
