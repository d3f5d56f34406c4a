"""Faults that a collection can inject, each with a rate that its descriptor declares.

They are the failures that the paper reports of its own collection, and what a validator must find.
An attempt has one fault at most: the first of its own whose draw succeeds, in the order below.
Source: paper V-A (population table) and V-B.

What a fault does to an attempt: how it is executed, and what is recorded of it.

An attempt without faults is executed and recorded as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.policy import ACTUATORS, ActuatorRule, Policy
from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OFFSETS, HISTORY_OFFSETS
from branchdrive.errors import UsageError
from branchdrive.raw.rollout import Rollout
from branchdrive_reference.collect.script import Attempt
from branchdrive_reference.simulation.ending import Ending
from branchdrive_reference.simulation.record import Columns, Record, record
from branchdrive_reference.simulation.rollout import Run, run
from branchdrive_reference.simulation.spec import WorldSpec

__all__ = [
    "ATTEMPT_FAULTS",
    "DESCRIPTIONS",
    "FAILURES",
    "MAX_SHIFT_TICKS",
    "PROTOCOL_VARIANT",
    "Fault",
    "execute_attempt",
    "parse_faults",
    "protocol_variant",
    "record_attempt",
]


class Fault(StrEnum):
    """Name of a fault, as the descriptor has it."""

    PARTIAL = "partial"
    QUARANTINED = "quarantined"
    EARLY_BRANCH = "early_branch"
    LATE_BRANCH = "late_branch"
    WRONG_DURATION = "wrong_duration"
    TRUNCATED_LOG = "truncated_log"
    DROPPED_FRAME = "dropped_frame"
    UNRETRIED = "unretried"
    DUPLICATE = "duplicate"
    ABANDONED = "abandoned"
    SEED_DISAGREEMENT = "seed_disagreement"
    ONLINE_STEERING = "online_steering"


DESCRIPTIONS: Mapping[Fault, str] = {
    Fault.PARTIAL: "per attempt: the simulator dies, and the attempt is partial",
    Fault.QUARANTINED: "per attempt: it runs to its end, and the collector distrusts it",
    Fault.EARLY_BRANCH: "per intervention attempt: the treatment begins 1 to 10 ticks before the recorded branch",
    Fault.LATE_BRANCH: "per intervention attempt: the treatment begins 1 to 10 ticks after the recorded branch",
    Fault.WRONG_DURATION: "per intervention attempt: the treatment lasts 1 to 5 ticks more or less than recorded",
    Fault.TRUNCATED_LOG: "per intervention attempt: the recorded tables stop inside the treatment",
    Fault.DROPPED_FRAME: "per intervention attempt: one saved observation of the windows is missing",
    Fault.UNRETRIED: "per partial or quarantined attempt: it is not repeated; otherwise it is, up to the third",
    Fault.DUPLICATE: "per policy: its first complete attempt is executed once more",
    Fault.ABANDONED: "per group: the collection of the group stops before its bank is complete",
    Fault.SEED_DISAGREEMENT: "per group: one intervention is executed and recorded with another seed",
    Fault.ONLINE_STEERING: "per group: acceleration keeps the online expert's steering",
}
"""What a rate counts, and what the fault does."""

FAILURES = (Fault.PARTIAL, Fault.QUARANTINED)
"""Faults after which an attempt is not complete; they happen in every role."""

ATTEMPT_FAULTS = (
    *FAILURES,
    Fault.EARLY_BRANCH,
    Fault.LATE_BRANCH,
    Fault.WRONG_DURATION,
    Fault.TRUNCATED_LOG,
    Fault.DROPPED_FRAME,
)
"""Faults of one attempt, in the order in which they are drawn."""


def parse_faults(text: str, presets: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Rates of a text: ``none``, a preset's name, or ``NAME=RATE`` separated by commas.

    Args:
        text: What the user wrote.
        presets: Rates by the name of their preset.

    Returns:
        Rates by the name of the fault; those that are 0 are left out.

    Raises:
        UsageError: A name is unknown or comes twice, or a rate is no number of 0 to 1.
    """
    if text == "none":
        return {}
    if text in presets:
        return dict(presets[text])
    rates: dict[str, float] = {}
    for part in text.split(","):
        name, _, rate = (piece.strip() for piece in part.partition("="))
        if name not in list(Fault):
            raise _refused(text, f"{name!r} is no fault", presets)
        if name in rates:
            raise _refused(text, f"{name!r} comes twice", presets)
        try:
            rates[name] = float(rate)
        except ValueError:
            raise _refused(text, f"{rate!r} is no rate of {name!r}", presets) from None
        if not 0 <= rates[name] <= 1:
            raise _refused(text, f"the rate {rate} of {name!r} is not in 0 .. 1", presets)
    return {name: rate for name, rate in rates.items() if rate > 0}


def _refused(text: str, problem: str, presets: Mapping[str, Mapping[str, float]]) -> UsageError:
    wholes, names = ", ".join(["none", *presets]), ", ".join(Fault)
    return UsageError(f"--faults {text!r}: {problem}; give one of {wholes}, or NAME=RATE,... with the names {names}")


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
