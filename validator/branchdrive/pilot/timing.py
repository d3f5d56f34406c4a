"""Whether effects come before their commands or late, by how much, and how that is known.

Where replays are exact, the first observation that differs from the nominal's says it for certain, in whole strides of
observations: nothing that equals the nominal at the branch is early. The delay that explains effects by their commands
says it in ticks, and where replays differ from their nominal by themselves it is all there is. Steering and pedals of a
vehicle may lag, each by a time of its own; what is late altogether is late by no less than the prompter of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from branchdrive.contract.text import counted
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.response import NO_RESPONSE
from branchdrive.engine.tally import Tally
from branchdrive.pilot.onset import Onset, onset_of
from branchdrive.pilot.pilot import Pilot
from branchdrive.raw.rules.responses import prevails

__all__ = ["EARLY", "LATE", "Timing", "timing_of"]

EARLY, LATE = "BD-RSP-003", "BD-RSP-004"
"""Rules on the clock of observations, which replays with noise give no subject."""

_SHIFTED_TICKS = 0.5
"""Onsets from here on are no rounding; all of an interval must be beyond."""

_LATE_TICKS = 0.75
"""Onset from which effects are called late: vehicles whose steering and pedals both lag by less are common."""

_STRIDE_LATE_TICKS = OBSERVATION_STRIDE_TICKS - 0.5


@dataclass(frozen=True)
class Timing:
    """The clock of commands and observations.

    Attributes:
        onsets: When effects begin, by actuator.
        is_early: Whether effects come before their commands.
        is_late: Whether they come late, by a lag of vehicles or otherwise.
        is_stride_late: Whether they come a whole stride of observations late, which is no lag.
        evidence: How it is known, a clause.
    """

    onsets: Mapping[str, Onset]
    is_early: bool
    is_late: bool
    is_stride_late: bool
    evidence: str

    @property
    def ticks(self) -> float | None:
        """Delay of the actuator that is prompter, ``None`` where none is known."""
        return min((onset.ticks for onset in self.onsets.values()), default=None)

    @property
    def amount(self) -> str:
        """By how much effects are early or late, in words."""
        ticks = self.ticks
        if ticks is None or (ticks >= _SHIFTED_TICKS) != self.is_late:
            return ""
        off = round(2 * ticks) / 2 if self.is_late else float(math.ceil(-ticks))
        return f", by about {off:g} {'tick' if off == 1 else 'ticks'} ({off * TICK_S:.2f} s)"


def timing_of(pilot: Pilot) -> Timing:
    """The clock of commands and observations of a pilot."""
    tallies = {tally.rule_id: tally for tally in pilot.report.tallies}
    onsets = onset_of(pilot.parts)
    every = pilot.responses()
    first = every.first[every.is_commanded & (every.first >= 0) & (every.first != NO_RESPONSE)]
    at_branch, next_, later = (int(shows.sum()) for shows in (first == 0, first == 1, first > 1))
    if _fails(tallies[EARLY]):
        text = f"{at_branch} of {counted(len(first), 'intervention')} differ from their nominal at the branch already"
        return Timing(onsets, is_early=True, is_late=False, is_stride_late=False, evidence=text)
    if _fails(tallies[LATE]):
        text = (
            f"{later} of {counted(len(first), 'intervention')} equal their nominal at the observation after the branch"
        )
        return Timing(onsets, is_early=False, is_late=True, is_stride_late=True, evidence=text)
    prompt = min(onsets.values(), key=lambda onset: onset.ticks, default=None)
    is_never_early = prevails(len(first) - at_branch, len(first))
    is_early = prompt is not None and prompt.high <= -_SHIFTED_TICKS and not is_never_early
    is_late = prompt is not None and prompt.low >= _SHIFTED_TICKS and prompt.ticks >= _LATE_TICKS
    is_stride_late = is_late and prompt is not None and prompt.low >= _STRIDE_LATE_TICKS
    is_stride_late &= not prevails(next_, len(first))
    return Timing(onsets, is_early=is_early, is_late=is_late, is_stride_late=is_stride_late, evidence=_fit_text(onsets))


def _fails(tally: Tally) -> bool:
    """Whether a rule on the clock of observations fails; not of accelerations, which have a clock of their own."""
    return any("column" not in finding.location for finding in tally.findings)


def _fit_text(onsets: Mapping[str, Onset]) -> str:
    parts = [
        f"{onset.ticks * TICK_S:+.2f} s with {name} ({counted(onset.num, 'intervention')})"
        for name, onset in onsets.items()
    ]
    return f"compared with the recorded commands, effects begin {' and '.join(parts)}"
