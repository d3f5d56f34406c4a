"""Expert-guided triggers: where the expert's manoeuvre begins in a completed nominal rollout.

A signal's onset is the first tick, not before the hazard became active, at which the signal passes
its threshold while it did not a tick earlier. The confidence of an onset is the share of the
following 0.5 s in which the signal still passes. The branch lies at the last observation before the
earliest confident onset. Source: paper, "Two-Pass Collection".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import ACTIVE_TICKS, CONTROL_HISTORY_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive.raw.rollout import Rollout

__all__ = [
    "MARGIN_TICKS",
    "Branch",
    "ExpertTrace",
    "Signal",
    "SignalName",
    "Trigger",
    "brake_trigger",
    "branch_columns",
]

SignalName: TypeAlias = Literal["brake", "throttle_release", "lane_shift"]

MARGIN_TICKS = 20
"""Ticks that every rollout goes on, at least, after its intervention has ended."""

_PERSISTENCE_TICKS = 10
_MIN_CONFIDENCE = 0.6
_DRIVING_TICKS = 10
_DRIVING_THROTTLE = 0.05
_BRAKE_FOLLOWS_TICKS = 25


@dataclass(frozen=True, eq=False)
class ExpertTrace:
    """The expert along a completed nominal rollout, arrays ``[ticks]``.

    Attributes:
        throttle: Commanded throttle.
        brake: Commanded brake.
        lane_shift_m: Planned offset from the route at the point the steering looks at.
        reacting: Whether an actor on the road, not the road itself, sets its speed.
        hazard_tick: Tick at which the scenario's hazard became active; -1 if it never did.
    """

    throttle: NDArray[np.float32]
    brake: NDArray[np.float32]
    lane_shift_m: NDArray[np.float64]
    reacting: NDArray[np.bool_]
    hazard_tick: int


@dataclass(frozen=True)
class Branch:
    """Where a group branches and why.

    Attributes:
        branch_tick: Last observation tick before the manoeuvre.
        definition: Name and version of the trigger.
        tick: First tick of the manoeuvre; of a control branch, which has none, the branch tick.
        signal: Signal that shows it; ``steady`` at a control branch.
        value: The signal there, in its own unit.
        threshold: What the signal had to pass.
        confidence: Share of the next 0.5 s in which the signal still passes.
    """

    branch_tick: int
    definition: str
    tick: int
    signal: SignalName | Literal["steady"]
    value: float
    threshold: float
    confidence: float

    @property
    def branch_frame(self) -> int:
        """Index of the observation at the branch tick."""
        return self.branch_tick // OBSERVATION_STRIDE_TICKS

    def columns(self, rollout_id: str) -> dict[str, str | int | float]:
        """Columns of the rollouts table for the nominal rollout that it was read from."""
        return {
            "branch_tick": self.branch_tick,
            "branch_frame": self.branch_frame,
            "trigger_definition": self.definition,
            "trigger_rollout_id": rollout_id,
            "trigger_tick": self.tick,
            "trigger_signal": self.signal,
            "trigger_value": self.value,
            "trigger_threshold": self.threshold,
            "trigger_confidence": self.confidence,
        }


@dataclass(frozen=True)
class Signal:
    """A signal of the expert and the threshold it passes: from below, or from above for a release."""

    name: SignalName
    threshold: float

    def values(self, trace: ExpertTrace) -> NDArray[np.float64]:
        """The signal ``[ticks]``, in the unit of the threshold."""
        match self.name:
            case "brake":
                return trace.brake.astype(np.float64)
            case "throttle_release":
                return trace.throttle.astype(np.float64)
            case "lane_shift":
                return np.abs(trace.lane_shift_m)

    def passes(self, trace: ExpertTrace) -> NDArray[np.bool_]:
        """Whether the signal passes its threshold ``[ticks]``; pedals count only where the expert reacts."""
        values = self.values(trace)
        if self.name == "lane_shift":
            return values > self.threshold
        pressed = values <= self.threshold if self.name == "throttle_release" else values > self.threshold
        return pressed & trace.reacting

    def begins_manoeuvre(self, trace: ExpertTrace, tick: int) -> bool:
        """Whether an onset at `tick` starts a manoeuvre: a release must follow driving and precede braking."""
        if self.name != "throttle_release":
            return True
        driving = trace.throttle[max(tick - _DRIVING_TICKS, 0) : tick]
        braking = trace.brake[tick : tick + _BRAKE_FOLLOWS_TICKS]
        return bool(driving.size and driving.mean() > _DRIVING_THROTTLE and (braking > 0).any())


@dataclass(frozen=True)
class Trigger:
    """A trigger definition: a versioned name and the signals it watches, preferred first."""

    definition: str
    signals: tuple[Signal, ...]

    def evaluate(self, trace: ExpertTrace) -> Branch | None:
        """The branch, or ``None`` if no manoeuvre is found or its windows do not fit into the rollout."""
        if trace.hazard_tick < 0:
            return None
        onsets = [onset for signal in self.signals if (onset := self._onset(signal, trace)) is not None]
        if not onsets:
            return None
        branch = min(onsets, key=lambda onset: onset.tick)
        fits = CONTROL_HISTORY_TICKS <= branch.branch_tick < len(trace.brake) - ACTIVE_TICKS - MARGIN_TICKS
        return branch if fits else None

    def _onset(self, signal: Signal, trace: ExpertTrace) -> Branch | None:
        passes = signal.passes(trace)
        rising = np.flatnonzero(passes[1:] & ~passes[:-1]) + 1
        for tick in rising[rising >= trace.hazard_tick].tolist():
            confidence = float(passes[tick : tick + _PERSISTENCE_TICKS].mean())
            if confidence >= _MIN_CONFIDENCE and signal.begins_manoeuvre(trace, tick):
                return Branch(
                    branch_tick=(tick - 1) // OBSERVATION_STRIDE_TICKS * OBSERVATION_STRIDE_TICKS,
                    definition=self.definition,
                    tick=tick,
                    signal=signal.name,
                    value=float(signal.values(trace)[tick]),
                    threshold=signal.threshold,
                    confidence=confidence,
                )
        return None


def brake_trigger(definition: str) -> Trigger:
    """A trigger that finds where the expert leaves the throttle to brake, or brakes."""
    return Trigger(definition, (Signal("throttle_release", 0.02), Signal("brake", 0.05)))


def branch_columns(nominal: Rollout) -> dict[str, Any]:
    """The branch of a nominal rollout as every other attempt of its group records it; null where it has none."""
    return {name: value for name, value in nominal.record.items() if name.startswith(("branch_", "trigger_"))}
