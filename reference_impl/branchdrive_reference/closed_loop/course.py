"""Drives of one site: a selector decides at the branch and again every so many ticks, and everything else is the same.

A drive follows from its choices. What a prefix of choices leads to is remembered, so that selectors which agree share
the drive, and a passage that waits at a decision goes on with the choice that is made there.

At a tick the policy of the latest decision drives while it is active, and the expert where none is. What a policy
copies from the nominal pass it finds only in the window of the first decision; later the expert's command of the tick
stands in, since the nominal pass tells nothing of the states that a drive is in after its first decision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from branchdrive.collector.recording import Record
from branchdrive.contract.bank import ActionBank
from branchdrive.contract.policy import Command
from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OBSERVATIONS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.target import Motion, Risk, Targets, scalar_targets
from branchdrive_reference.closed_loop.sight import SensorNoise, Sight
from branchdrive_reference.closed_loop.site import Nominal, Passage, Site

__all__ = ["Choices", "Course", "Driven", "Schedule", "window_targets"]

Choices = tuple[int, ...]
"""Places of chosen candidates in the bank, one for each decision."""


@dataclass(frozen=True)
class Schedule:
    """When decisions are made.

    Attributes:
        every_ticks: Ticks between decisions, a multiple of an observation's.
        num_decisions: Decisions of a drive at most; the first is at the branch.
    """

    every_ticks: int
    num_decisions: int


@dataclass(frozen=True, eq=False)
class Driven:
    """A drive that came to its end.

    Attributes:
        choices: Places of the chosen candidates in the bank.
        ticks: Ticks of the decisions.
        record: What was recorded.
    """

    choices: Choices
    ticks: tuple[int, ...]
    record: Record


@dataclass
class _Underway:
    """A passage that waits at a tick: its expert has thought, and nothing has acted."""

    passage: Passage
    choices: Choices
    expert: Command | None


class Course:
    """Drives of one site under one schedule and one noise of replays.

    Args:
        site: The site.
        nominal: Its nominal pass.
        bank: Candidates.
        schedule: When decisions are made.
        replay_noise: Strength of the noise of replays.
        unrecorded: Columns that the dataset does not record.
    """

    def __init__(
        self,
        site: Site,
        nominal: Nominal,
        bank: ActionBank,
        schedule: Schedule,
        *,
        replay_noise: float = 0.0,
        unrecorded: tuple[str, ...] = (),
    ) -> None:
        self._site, self._nominal, self._bank, self._schedule = site, nominal, bank, schedule
        self._replay_noise, self._unrecorded = replay_noise, unrecorded
        self._live: _Underway | None = None
        self._seen: dict[Choices, Record | None] = {}
        self._ended: dict[Choices, Record] = {}
        self._windows: dict[Choices, Targets] = {}

    def drive(self, choose: Callable[[Sight], int], noise: SensorNoise) -> Driven:
        """Drive to the end.

        Args:
            choose: What decides: the place of a candidate in the bank.
            noise: Noise on what it sees.
        """
        choices: Choices = ()
        while len(choices) < self._schedule.num_decisions:
            seen = self._at(choices)
            if seen is None:
                break
            choices = (*choices, choose(self._sight(seen, choices, noise)))
        return Driven(choices, tuple(self._tick(i) for i in range(len(choices))), self._end(choices))

    def bank_targets(self, choices: Choices = ()) -> Targets:
        """Executed targets of every candidate at the decision after these choices ``[A, 6]``."""
        found = [self._window((*choices, place)) for place in range(len(self._bank.policies))]
        return Targets(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _tick(self, number: int) -> int:
        """Tick of a decision, counted from 0."""
        return self._nominal.branch_tick + number * self._schedule.every_ticks

    def _sight(self, seen: Record, choices: Choices, noise: SensorNoise) -> Sight:
        number = len(choices)
        return Sight(
            self._site.group_id,
            self._site.scenario_type,
            seen,
            self._tick(number),
            number,
            self._unrecorded,
            noise,
            lambda: self.bank_targets(choices),
        )

    def _at(self, choices: Choices) -> Record | None:
        """What is recorded at the decision after these choices; ``None`` where the drive is over before."""
        if choices not in self._seen:
            underway = self._go(choices, self._tick(len(choices)))
            record = underway.passage.record()
            if underway.expert is None:
                self._ended[choices] = record
            self._seen[choices] = None if underway.expert is None else record
        return self._seen[choices]

    def _end(self, choices: Choices) -> Record:
        if choices not in self._ended:
            self._ended[choices] = self._go(choices, None).passage.record()
        return self._ended[choices]

    def _window(self, choices: Choices) -> Targets:
        if choices not in self._windows:
            begin = self._tick(len(choices) - 1)
            record = self._ended.get(choices)
            if record is None:
                record = self._go(choices, begin + ACTIVE_TICKS).passage.record()
            self._windows[choices] = window_targets(record, begin)
        return self._windows[choices]

    def _go(self, choices: Choices, stop_tick: int | None) -> _Underway:
        """A passage with these choices at a tick, or at its end."""
        underway = self._live
        if underway is None or not self._goes_on(underway, choices, stop_tick):
            passage = self._site.begin(
                self._nominal, replay_noise=self._replay_noise, num_decisions=self._schedule.num_decisions
            )
            underway = self._live = _Underway(passage, choices, passage.think())
        underway.choices = choices
        passage = underway.passage
        while underway.expert is not None and passage.tick != stop_tick:
            passage.act(self._command(choices, passage.tick, underway.expert))
            underway.expert = passage.think()
        return underway

    def _goes_on(self, underway: _Underway, choices: Choices, stop_tick: int | None) -> bool:
        """Whether the passage that waits has done what these choices do up to its tick."""
        made, tick = underway.choices, underway.passage.tick
        if choices[: len(made)] != made or (stop_tick is not None and tick > stop_tick):
            return False
        return len(choices) == len(made) or tick <= self._tick(len(made))

    def _command(self, choices: Choices, tick: int, expert: Command) -> Command:
        number = min((tick - self._nominal.branch_tick) // self._schedule.every_ticks, len(choices) - 1)
        if number < 0:
            return expert
        policy = self._bank.policies[choices[number]]
        if tick >= self._tick(number) + policy.duration_ticks:
            return expert
        stored = Command(*self._nominal.applied[tick]) if number == 0 else expert
        return policy.command(expert, stored)


def window_targets(record: Record, tick: int) -> Targets:
    """Executed targets of the window from a tick on ``[1, 6]``; none is available where the record ends before it.

    Raises:
        KeyError: The record has no evidence.
    """
    first = tick // OBSERVATION_STRIDE_TICKS
    frames = slice(first, first + FUTURE_OBSERVATIONS + 1)
    motion = [np.asarray(record.observations[name])[frames][None] for name in ("x_m", "y_m", "yaw_rad", "speed_mps")]
    if motion[0].shape[1] <= FUTURE_OBSERVATIONS:
        return Targets(np.full((1, 6), np.nan), np.zeros((1, 6), np.bool_))
    evidence = {
        name: np.ma.filled(
            np.ma.asarray(record.evidence[name])[frames][None, 1:], np.nan if name.endswith(("_m", "_s")) else False
        )
        for name in ("separation_m", "separation_available", "ttc_s", "ttc_available")
    }
    risk = Risk(
        evidence["separation_m"], evidence["separation_available"], evidence["ttc_s"], evidence["ttc_available"]
    )
    return scalar_targets(Motion(*motion), risk)
