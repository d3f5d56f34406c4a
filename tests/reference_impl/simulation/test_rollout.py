"""Rollouts: equal worlds give equal bytes, policies act exactly while active, and time suffices."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
import shapely
from tests.each import each
from tests.reference_impl.simulation.worlds import (
    BANK,
    SCENARIO_NAMES,
    branch_of,
    digest,
    intervention_of,
    nominal_of,
    spec_of,
)
from tests.repo.checkout import ROOT
from tests.validator.driving.oracle import boxes, polygons

from branchdrive.contract.timing import ACTIVE_TICKS
from branchdrive.errors import UsageError
from branchdrive_reference.simulation.rollout import find_branch, run
from branchdrive_reference.world.body import Behaviour

ACTIONS = [policy.key for policy in BANK.interventions]
each_scenario = each("scenario", SCENARIO_NAMES)
each_intervention = each(
    ("scenario", "action_key"),
    [
        (name, ACTIONS[(3 * index + turn) % len(ACTIONS)])
        for index, name in enumerate(SCENARIO_NAMES)
        for turn in range(3)
    ],
)
"""Three interventions of every scenario type, every action in turn."""


@each_scenario
def test_a_nominal_replay_is_bit_equal(scenario: str) -> None:
    assert digest(run(spec_of(scenario), BANK.nominal)) == digest(nominal_of(scenario))


def sample_digests() -> list[str]:
    """Digests of some nominal rollouts, of a crash, and of a replay with noise."""
    crash = intervention_of("HardBrakeRoute", "accelerate_0.80")
    assert crash.log.collided.any()
    noisy = run(dataclasses.replace(spec_of("HardBrakeRoute"), replay=1, replay_noise=1.0), BANK.nominal)
    return [digest(rollout) for rollout in (*map(nominal_of, SCENARIO_NAMES[::4]), crash, noisy)]


def test_a_process_with_other_hashes_gives_the_same_bytes() -> None:
    code = "from tests.reference_impl.simulation.test_rollout import sample_digests\nprint(*sample_digests())"
    environment = {**os.environ, "PYTHONHASHSEED": "1" if os.environ.get("PYTHONHASHSEED") == "0" else "0"}
    command = [sys.executable, "-c", code]
    found = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=ROOT)
    assert found.stdout.split() == sample_digests()


@each_scenario
def test_traffic_does_not_drive_through_traffic(scenario: str) -> None:
    """Contacts between drivers are not resolved, so their right of way has to keep them apart."""
    for bodies in nominal_of(scenario).log.bodies:
        drivers = bodies[bodies["behaviour"] == Behaviour.FOLLOWING]
        places = boxes(*drivers[["x_m", "y_m", "yaw_rad", "length_m", "width_m"]].tolist())
        shapes = polygons(places)
        touching = shapely.STRtree(shapes).query(shapes, predicate="intersects")
        assert (touching[0] == touching[1]).all()


@each_intervention
def test_interventions_share_the_nominal_past(scenario: str, action_key: str) -> None:
    nominal, rollout = nominal_of(scenario), intervention_of(scenario, action_key)
    tick, frame = branch_of(scenario).branch_tick, branch_of(scenario).branch_frame
    assert (rollout.log.applied[:tick] == nominal.log.applied[:tick]).all()
    assert rollout.log.bodies[: frame + 1].tobytes() == nominal.log.bodies[: frame + 1].tobytes()


@each_intervention
def test_policies_act_exactly_while_active(scenario: str, action_key: str) -> None:
    nominal, rollout = nominal_of(scenario), intervention_of(scenario, action_key)
    log, active = rollout.log, rollout.active
    assert active.sum() == ACTIVE_TICKS
    assert np.flatnonzero(active)[0] == branch_of(scenario).branch_tick
    assert (log.applied[~active] == log.expert[~active]).all()
    for index, rule in enumerate(BANK[action_key].rules):
        copied = nominal.log.applied[np.flatnonzero(active), index]
        assert (log.applied[active, index] == rule.evaluate(log.expert[active, index], copied)).all()


@each_intervention
def test_every_attempt_outlives_its_intervention(scenario: str, action_key: str) -> None:
    rollout = intervention_of(scenario, action_key)
    assert rollout.log.num_ticks > branch_of(scenario).branch_tick + ACTIVE_TICKS + 10
    assert rollout.log.num_ticks % 5 == 0
    assert rollout.ending.partial_reason is None


def test_the_expert_keeps_deciding_while_overridden() -> None:
    nominal, rollout = nominal_of("HardBrakeRoute"), intervention_of("HardBrakeRoute", "accelerate_0.50")
    overridden = rollout.log.expert[rollout.active]
    assert len(np.unique(overridden[:, 2])) > 5
    assert overridden[:, 2].max() > nominal.log.expert[:, 2].max()


@each_scenario
def test_a_route_timeout_makes_a_nominal_attempt_partial(scenario: str) -> None:
    rollout = run(dataclasses.replace(spec_of(scenario), timeout_ticks=122), BANK.nominal)
    assert rollout.log.num_ticks == 125
    assert rollout.ending.completion == "timeout"
    assert rollout.ending.partial_reason is not None


def test_a_timeout_inside_the_intervention_makes_it_partial() -> None:
    nominal, branch = nominal_of("ParkedObstacle"), branch_of("ParkedObstacle")
    spec = dataclasses.replace(nominal.spec, timeout_ticks=branch.branch_tick + 30)
    rollout = run(spec, BANK["brake_0.30"], branch_tick=branch.branch_tick, nominal=nominal.log.applied)
    assert rollout.log.num_ticks == branch.branch_tick + 30
    assert rollout.ending.partial_reason is not None


def test_seeds_make_different_worlds() -> None:
    spec = spec_of("PedestrianCrossing")
    other = run(dataclasses.replace(spec, seed=spec.seed + 1), BANK.nominal)
    assert digest(other) != digest(nominal_of("PedestrianCrossing"))


def test_an_intervention_needs_its_nominal() -> None:
    with pytest.raises(UsageError, match="branch tick and nominal commands"):
        run(spec_of("ParkedObstacle"), BANK["brake_1.00"])


def test_a_branch_depends_on_the_nominal_alone() -> None:
    assert find_branch(nominal_of("ParkedObstacle")) == branch_of("ParkedObstacle")
