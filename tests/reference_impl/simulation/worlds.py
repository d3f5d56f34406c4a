"""Worlds and rollouts that several tests look at, executed once."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, wraps
from itertools import islice
from typing import ParamSpec, TypeVar

from branchdrive.collector.trigger import Branch
from branchdrive.contract.bank import load_action_bank
from branchdrive_reference.collect.plan import plan_group
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.simulation.rollout import Run, find_branch, run
from branchdrive_reference.simulation.spec import WorldSpec

BANK = load_action_bank()
SEED = 20
SCENARIO_NAMES = tuple(SCENARIOS)
_MOST_DRAWN = 60

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def cached(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Like `functools.cache`, but a default that is given is the same call as one that is left out."""
    signature, remembered = inspect.signature(function), cache(function)

    @wraps(function)
    def call(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        bound = signature.bind(*args, **kwargs)
        bound.apply_defaults()
        return remembered(*bound.args)

    return call


@dataclass(frozen=True)
class Drive:
    """What is kept of the nominal rollout of a drawn world."""

    spec: WorldSpec
    clean: bool
    """Whether the expert finished the route without an infraction."""

    num_ticks: int
    branch: Branch | None


def drawn_spec(scenario: str, number: int) -> WorldSpec:
    """The world `number` that a collection draws of a scenario type."""
    return plan_group(SEED, SCENARIO_NAMES.index(scenario) + len(SCENARIO_NAMES) * number).spec


@cache
def drive_of(scenario: str, number: int) -> Drive:
    """Nominal rollout of a drawn world."""
    spec = drawn_spec(scenario, number)
    rollout = run(spec, BANK.nominal)
    log = rollout.log
    lawful = not log.collided.any() and log.num_red_lights_run == 0 and log.num_stop_signs_run == 0
    return Drive(spec, rollout.ending.completion == "completed" and lawful, log.num_ticks, find_branch(rollout))


@cached
def spec_of(scenario: str, number: int = 0) -> WorldSpec:
    """World `number` of a scenario type, counting those that the expert masters and that branch."""
    drives = (drive_of(scenario, drawn) for drawn in range(_MOST_DRAWN))
    usable = (drive.spec for drive in drives if drive.clean and drive.branch is not None)
    found = next(islice(usable, number, None), None)
    if found is None:
        raise AssertionError(f"{scenario} has no {number + 1} worlds that branch among {_MOST_DRAWN}")
    return found


@cached
def nominal_of(scenario: str, number: int = 0) -> Run:
    """Nominal rollout of a world."""
    return run(spec_of(scenario, number), BANK.nominal)


def branch_of(scenario: str, number: int = 0) -> Branch:
    """Branch of a world's nominal rollout."""
    branch = find_branch(nominal_of(scenario, number))
    if branch is None:
        raise AssertionError(f"{scenario} {number} has no branch")
    return branch


def execute(scenario: str, action_key: str, number: int = 0) -> Run:
    """Rollout of an intervention, executed now and not kept."""
    nominal, branch = nominal_of(scenario, number), branch_of(scenario, number)
    return run(nominal.spec, BANK[action_key], branch_tick=branch.branch_tick, nominal=nominal.log.applied)


@cached
def intervention_of(scenario: str, action_key: str, number: int = 0) -> Run:
    """Rollout of an intervention."""
    return execute(scenario, action_key, number)


def digest(rollout: Run) -> str:
    """Digest of everything that was logged."""
    log = rollout.log
    decided = (log.expert, log.applied, log.lane_shift_m, log.plan)
    arrays = (*decided, log.bodies, log.vehicle, log.touched, log.collided, log.light)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
