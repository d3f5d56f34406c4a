"""What is to be executed for a group: its attempts in their order, a pure function of the descriptor.

Every draw is a number of the collection's seed, the group, the attempt and the fault alone, so that
a resumed group finds the script that it began with. Without faults a script is one nominal pass, one
attempt of every intervention and two nominal replays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.policy import Policy
from branchdrive_reference.collect.fault import ATTEMPT_FAULTS, FAILURES, Fault
from branchdrive_reference.noise import Purpose, choice, integer, uniform

__all__ = ["MAX_ATTEMPTS", "NUM_NOMINAL_REPLAYS", "Attempt", "GroupScript", "Role", "group_script", "replay_key"]

Role: TypeAlias = Literal["nominal", "intervention", "nominal_replay"]

NUM_NOMINAL_REPLAYS = 2
"""Complete nominal replays of a group."""

MAX_ATTEMPTS = 3
"""Attempts at a policy after which the collector gives it up."""

_STEERED_FAMILY = "accelerate"
"""Family whose policies keep the online expert's steering in a group with the fault `online_steering`."""

_PURPOSES = {fault: int(Purpose[f"FAULT_{fault.name}"]) for fault in Fault}
_EXTENT = int(Purpose.FAULT_EXTENT)
_ROLES: tuple[Role, ...] = ("nominal", "intervention", "nominal_replay")
_MAX_POLICIES = 256
_MAX_NUMBER = 100_000


def replay_key(role: Role, policy_index: int, attempt: int) -> int:
    """A positive number for every attempt of a group, different for each.

    Args:
        role: Role of the attempt.
        policy_index: Place of its policy in the bank, at most 255.
        attempt: Number of the attempt, 1 to 100,000.
    """
    return (_ROLES.index(role) * _MAX_POLICIES + policy_index) * _MAX_NUMBER + attempt


@dataclass(frozen=True)
class Attempt:
    """One attempt to be executed.

    Attributes:
        role: Role in the group.
        policy: The bank's policy that it is recorded under.
        number: Number of the attempt, from 1.
        key: Its `replay_key`.
        fault: The one fault of its own; ``None`` if it has none.
        extent: How far the fault goes, a share in ``[0, 1)``.
        other_seed: Seed that stands in for the group's; ``None`` if none does.
        keeps_steering: Whether the online expert keeps the steering against the policy.
    """

    role: Role
    policy: Policy
    number: int
    key: int
    fault: Fault | None = None
    extent: float = 0.0
    other_seed: int | None = None
    keeps_steering: bool = False

    @property
    def is_failure(self) -> bool:
        """Whether the attempt will not be complete."""
        return self.fault in FAILURES

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Every fault that shows in the attempt."""
        is_shown = {
            Fault.SEED_DISAGREEMENT: self.other_seed is not None,
            Fault.ONLINE_STEERING: self.keeps_steering,
        }
        own = () if self.fault is None else (self.fault,)
        return (*own, *(fault for fault, shows in is_shown.items() if shows))


@dataclass(frozen=True)
class GroupScript:
    """Attempts of a group in the order of their execution.

    Attributes:
        nominal: The nominal passes; the first complete one serves the group.
        replays: Interventions in the order of the bank, then nominal replays.
        stopped_because: Why the bank will not be complete; empty if it will.
    """

    nominal: tuple[Attempt, ...]
    replays: tuple[Attempt, ...]
    stopped_because: str = ""


def group_script(descriptor: Descriptor, group_index: int) -> GroupScript:
    """The script of the group at a place of the dataset that `descriptor` describes."""
    draws = _Draws(descriptor.collection.seed, group_index, descriptor.collection.faults)
    bank = descriptor.action_bank
    nominal_index = bank.nominal_index
    nominal = draws.chain("nominal", bank.nominal, nominal_index)
    begun = draws.num_policies_begun(len(bank.policies))
    other_seed = draws.other_seed(len(bank.policies) - 1)
    replays: list[Attempt] = []
    last = nominal
    interventions = [(index, policy) for index, policy in enumerate(bank.policies) if not policy.is_nominal]
    for place, (index, policy) in enumerate(interventions):
        if _gave_up(last) or place + 1 >= begun:
            break
        seed = other_seed[1] if other_seed is not None and other_seed[0] == place else None
        last = draws.chain("intervention", policy, index, other_seed=seed)
        replays += last
    if _gave_up(last):
        because = f"no attempt at {last[-1].policy.key} succeeded: {len(last)} made"
    elif begun < len(bank.policies):
        because = f"abandoned after {begun} of {len(bank.policies)} policies"
    else:
        for _ in range(NUM_NOMINAL_REPLAYS):
            made = sum(attempt.role == "nominal_replay" for attempt in replays)
            replays += draws.chain("nominal_replay", bank.nominal, nominal_index, num_made=made)
        because = ""
    return GroupScript(nominal, tuple(replays), because)


def _gave_up(chain: tuple[Attempt, ...]) -> bool:
    return all(attempt.is_failure for attempt in chain)


class _Draws:
    """Draws of one group.

    Args:
        seed: Seed of the collection.
        group: Place of the group.
        rates: Rates of the faults by name.
    """

    def __init__(self, seed: int, group: int, rates: Mapping[str, float]) -> None:
        self._seed, self._group, self._rates = seed, group, rates

    def happens(self, fault: Fault, key: int = 0) -> bool:
        """Whether a fault happens to the group, or to its attempt with `key`."""
        rate = self._rates.get(fault, 0.0)
        return rate > 0 and uniform(self._seed, _PURPOSES[fault], self._group, key) < rate

    def num_policies_begun(self, num_policies: int) -> int:
        """Policies after which the group is abandoned, the nominal included; all if it is not.

        One, and another one with probability 1/2 each time, but never all.
        """
        if not self.happens(Fault.ABANDONED):
            return num_policies
        share = uniform(self._seed, int(Purpose.FAULT_POLICIES_BEGUN), self._group)
        return min(1 - math.frexp(share)[1], num_policies - 1)

    def other_seed(self, num_interventions: int) -> tuple[int, int] | None:
        """Place of the one intervention with another seed, and that seed; ``None`` if all agree."""
        if not self.happens(Fault.SEED_DISAGREEMENT):
            return None
        place = choice(num_interventions, self._seed, Purpose.FAULT_SEED_POLICY, self._group)
        return place, integer(self._seed, Purpose.FAULT_OTHER_SEED, self._group)

    def chain(
        self, role: Role, policy: Policy, index: int, *, other_seed: int | None = None, num_made: int = 0
    ) -> tuple[Attempt, ...]:
        """Attempts at a policy until one is complete or the collector gives up, with a duplicate if drawn.

        Args:
            role: Role of the attempts.
            policy: The policy.
            index: Its place in the bank.
            other_seed: Seed that stands in for the group's.
            num_made: Attempts with this role and policy before these.
        """
        keeps_steering = policy.family == _STEERED_FAMILY and self.happens(Fault.ONLINE_STEERING)
        attempts: list[Attempt] = []
        goes_on = True
        while goes_on:
            number = num_made + len(attempts) + 1
            key = replay_key(role, index, number)
            fault = next((fault for fault in self._faults_of(role) if self.happens(fault, key)), None)
            extent = 0.0 if fault is None else uniform(self._seed, _EXTENT, self._group, key)
            was_complete = bool(attempts) and not attempts[-1].is_failure
            attempt = Attempt(role, policy, number, key, fault, extent, other_seed, keeps_steering)
            attempts.append(attempt)
            if was_complete:
                goes_on = False
            elif attempt.is_failure:
                goes_on = len(attempts) < MAX_ATTEMPTS and not self.happens(Fault.UNRETRIED, key)
            else:
                goes_on = self.happens(Fault.DUPLICATE, key)
        return tuple(attempts)

    def _faults_of(self, role: Role) -> tuple[Fault, ...]:
        return ATTEMPT_FAULTS if role == "intervention" else FAILURES
