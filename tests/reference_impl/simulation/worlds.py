"""Worlds and rollouts that several tests look at, executed once."""

from __future__ import annotations

import hashlib
from functools import cache

from branchdrive.contract.bank import load_action_bank
from branchdrive_reference.collect.plan import plan_group
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.scenarios.trigger import Branch
from branchdrive_reference.simulation.rollout import Run, find_branch, run
from branchdrive_reference.simulation.spec import WorldSpec

BANK = load_action_bank()
SEED = 20
SCENARIO_NAMES = tuple(SCENARIOS)


def spec_of(scenario: str, number: int = 0) -> WorldSpec:
    """World `number` of a scenario type."""
    return plan_group(SEED, SCENARIO_NAMES.index(scenario) + len(SCENARIO_NAMES) * number).spec


@cache
def nominal_of(scenario: str, number: int = 0) -> Run:
    """Nominal rollout of a world."""
    return run(spec_of(scenario, number), BANK.nominal)


def branch_of(scenario: str, number: int = 0) -> Branch:
    """Branch of a world's nominal rollout."""
    branch = find_branch(nominal_of(scenario, number))
    if branch is None:
        raise AssertionError(f"{scenario} {number} has no branch")
    return branch


@cache
def intervention_of(scenario: str, action_key: str, number: int = 0) -> Run:
    """Rollout of an intervention."""
    nominal, branch = nominal_of(scenario, number), branch_of(scenario, number)
    return run(nominal.spec, BANK[action_key], branch_tick=branch.branch_tick, nominal=nominal.log.applied)


def digest(rollout: Run) -> str:
    """Digest of everything that was logged."""
    log = rollout.log
    arrays = (log.expert, log.applied, log.bodies, log.vehicle, log.plan, log.touched, log.collided)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
