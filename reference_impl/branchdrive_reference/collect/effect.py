"""What a fault does to an attempt: how it is executed, and what is recorded of it.

An attempt without faults is executed and recorded as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.recording import Columns, Record
from branchdrive.contract.policy import ACTUATORS, ActuatorRule, Policy
from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OFFSETS, HISTORY_OFFSETS
from branchdrive.raw.rollout import Rollout
from branchdrive_reference.collect.fault import Fault
from branchdrive_reference.collect.script import Attempt
from branchdrive_reference.simulation.ending import Ending
from branchdrive_reference.simulation.record import record
from branchdrive_reference.simulation.rollout import Run, run
from branchdrive_reference.simulation.spec import WorldSpec

__all__ = ["MAX_SHIFT_TICKS", "PROTOCOL_VARIANT", "execute_attempt", "protocol_variant", "record_attempt"]

PROTOCOL_VARIANT = "reference-1"
_ONLINE_STEERING_VARIANT = f"{PROTOCOL_VARIANT}-online-steering"

MAX_SHIFT_TICKS = 10
"""Ticks by which a treatment begins too early or too late, at most."""

_MAX_DURATION_ERROR_TICKS = 5
_FIRST_DEATH_TICK, _DEATH_TICKS = 20, 280
_WINDOW_OFFSETS = (*HISTORY_OFFSETS, *FUTURE_OFFSETS)
_QUARANTINED = "quarantined by the collector: the log of this attempt is not trusted"


def protocol_variant(attempt: Attempt) -> str:
    """Name of the protocol that an attempt follows."""
    return _ONLINE_STEERING_VARIANT if attempt.keeps_steering else PROTOCOL_VARIANT


def execute_attempt(attempt: Attempt, spec: WorldSpec, replay_noise: float, nominal: Rollout | None) -> Run:
    """Execute an attempt from tick 0, as far as its faults let it run.

    Args:
        attempt: What to execute.
        spec: The world that the group shares.
        replay_noise: Strength of the noise of replays.
        nominal: The nominal rollout that a replay belongs to; ``None`` for a nominal pass.
    """
    if attempt.other_seed is not None:
        spec = replace(spec, seed=attempt.other_seed)
    if nominal is not None and replay_noise > 0:
        spec = replace(spec, replay=attempt.key, replay_noise=replay_noise)
    if attempt.fault is Fault.PARTIAL:
        death_tick = _FIRST_DEATH_TICK + _step(attempt, _DEATH_TICKS)
        spec = replace(spec, timeout_ticks=min(spec.timeout_ticks, death_tick))
    if nominal is None:
        executed = run(spec, attempt.policy)
    else:
        branch_tick = nominal.branch_tick
        if branch_tick is not None:
            branch_tick += _shift_ticks(attempt)
        executed = run(spec, _executed_policy(attempt), branch_tick=branch_tick, nominal=_applied(nominal))
    if attempt.fault is Fault.PARTIAL:
        reason = f"the simulator died at tick {executed.log.num_ticks}"
        return replace(executed, ending=Ending("timeout", "simulator died", reason))
    return executed


def record_attempt(attempt: Attempt, executed: Run, nominal: Rollout | None) -> Record:
    """The columns of an executed attempt, as the collector with its faults writes them.

    Args:
        attempt: What was executed.
        executed: Its run.
        nominal: The nominal rollout that a replay belongs to.
    """
    recorded = record(executed)
    fields = dict(recorded.fields)
    if attempt.fault is Fault.QUARANTINED and fields["status"] == "complete":
        fields |= {"status": "quarantined", "status_reason": _QUARANTINED}
    if attempt.fault is Fault.WRONG_DURATION:
        fields["effective_duration_ticks"] = attempt.policy.duration_ticks
    recorded = replace(recorded, fields=fields)
    if nominal is None or nominal.branch_tick is None:
        return recorded
    if attempt.fault is Fault.TRUNCATED_LOG:
        end_tick = nominal.branch_tick + 1 + _step(attempt, ACTIVE_TICKS)
        controls = _rows(recorded.controls, lambda tick: tick < end_tick)
        return replace(_observed(recorded, lambda tick: tick < end_tick), controls=controls)
    if attempt.fault is Fault.DROPPED_FRAME:
        lost_tick = nominal.branch_tick + _WINDOW_OFFSETS[_step(attempt, len(_WINDOW_OFFSETS))]
        return _observed(recorded, lambda tick: tick != lost_tick)
    return recorded


def _step(attempt: Attempt, count: int) -> int:
    """The extent of the attempt's fault as one of ``0 .. count - 1``."""
    return int(attempt.extent * count)


def _shift_ticks(attempt: Attempt) -> int:
    """How much later than recorded the treatment begins."""
    shift = 1 + _step(attempt, MAX_SHIFT_TICKS)
    if attempt.fault is Fault.EARLY_BRANCH:
        return -shift
    return shift if attempt.fault is Fault.LATE_BRANCH else 0


def _executed_policy(attempt: Attempt) -> Policy:
    changes: dict[str, Any] = {}
    if attempt.keeps_steering:
        changes["steer"] = ActuatorRule(rule="online_expert")
    if attempt.fault is Fault.WRONG_DURATION:
        errors = [error for error in range(-_MAX_DURATION_ERROR_TICKS, _MAX_DURATION_ERROR_TICKS + 1) if error]
        changes["duration_ticks"] = attempt.policy.duration_ticks + errors[_step(attempt, len(errors))]
    return attempt.policy.model_copy(update=changes) if changes else attempt.policy


def _applied(nominal: Rollout) -> NDArray[np.float32]:
    """Applied commands of a nominal rollout, float32 ``[ticks, 3]``."""
    return np.stack([nominal.column("controls", f"applied_{actuator}") for actuator in ACTUATORS], axis=1)


def _rows(columns: Columns, is_kept: Callable[[NDArray[Any]], NDArray[np.bool_]]) -> Columns:
    kept = is_kept(columns["tick"])
    return {name: values[kept] for name, values in columns.items()}


def _observed(recorded: Record, is_kept: Callable[[NDArray[Any]], NDArray[np.bool_]]) -> Record:
    """The record with some of its observations, their actors and their evidence."""
    return replace(
        recorded,
        observations=_rows(recorded.observations, is_kept),
        actors=_rows(recorded.actors, is_kept),
        evidence=_rows(recorded.evidence, is_kept),
    )
