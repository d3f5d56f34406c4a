"""Every scenario: the expert masters it, a branch is found, and the bank has different consequences."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.simulation.worlds import BANK, SCENARIO_NAMES, intervention_of, nominal_of, spec_of

from branchdrive_reference.scenarios.scenario import FIRST_ROW
from branchdrive_reference.simulation.rollout import Run, find_branch, run
from branchdrive_reference.world.body import EGO, Behaviour

WORLDS = 40
each_scenario = pytest.mark.parametrize("scenario", SCENARIO_NAMES)


def crashes(rollout: Run) -> bool:
    return bool(rollout.log.collided.any())


@each_scenario
def test_the_expert_finishes_without_collision_and_branches(scenario: str) -> None:
    runs = [run(spec_of(scenario, number), BANK.nominal) for number in range(WORLDS)]
    mastered = [r.ending.completion == "completed" and not crashes(r) for r in runs]
    assert np.mean(mastered) >= 0.95
    assert np.mean([find_branch(r) is not None for r in runs]) >= 0.95
    assert all(250 <= r.log.num_ticks <= 700 for r in runs)


@each_scenario
def test_interventions_have_different_consequences(scenario: str) -> None:
    runs = [intervention_of(scenario, policy.key) for policy in BANK.interventions]
    ends = {tuple(np.round([r.log.bodies[-1]["x_m"][EGO], r.log.bodies[-1]["y_m"][EGO]], 1)) for r in runs}
    assert len(ends) >= 6
    assert any(crashes(r) for r in runs)
    assert not all(crashes(r) for r in runs)


@each_scenario
def test_accelerating_is_more_dangerous_than_braking(scenario: str) -> None:
    worlds = range(4)
    accelerated = [crashes(intervention_of(scenario, "accelerate_0.50", number)) for number in worlds]
    braked = [crashes(intervention_of(scenario, "brake_0.50", number)) for number in worlds]
    assert sum(accelerated) > sum(braked)


def test_the_hard_braking_leader_stops_and_drives_on() -> None:
    rollout = nominal_of("HardBrakeRoute")
    speed = rollout.log.bodies["speed_mps"][:, FIRST_ROW]
    stopped = np.flatnonzero(speed == 0.0)
    assert stopped[0] * 5 > rollout.hazard_tick
    assert speed[-1] > 3.0


def test_the_pedestrian_crosses_the_whole_carriageway() -> None:
    rollout = nominal_of("PedestrianCrossing")
    walker = rollout.log.bodies[:, FIRST_ROW]
    assert walker["behaviour"][0] == Behaviour.STANDING
    assert walker["behaviour"][-1] == Behaviour.WALKING
    assert np.hypot(*(walker["x_m"][-1] - walker["x_m"][0], walker["y_m"][-1] - walker["y_m"][0])) > 7.0


def test_the_parked_obstacle_is_passed_with_clearance() -> None:
    rollout = nominal_of("ParkedObstacle")
    ego, parked = rollout.log.bodies[:, EGO], rollout.log.bodies[0, FIRST_ROW]
    distance = np.hypot(ego["x_m"] - parked["x_m"], ego["y_m"] - parked["y_m"])
    assert distance.min() > 1.9
    assert rollout.log.lane_shift_m.max() > 1.5 or rollout.log.lane_shift_m.min() < -1.5
