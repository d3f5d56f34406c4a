"""Consequences: interventions end differently, no family is always right, and other vehicles answer the ego."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from tests.reference_impl.simulation.worlds import (
    BANK,
    SCENARIO_NAMES,
    branch_of,
    execute,
    intervention_of,
    nominal_of,
)
from tests.sampling import sampled

from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OBSERVATIONS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.target import Motion, Risk, Targets, scalar_targets
from branchdrive.driving.utility import PROFILES, extreme_shares, fit_scale, utility
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.simulation.record import record
from branchdrive_reference.simulation.rollout import Run
from branchdrive_reference.town.track import route_tracks
from branchdrive_reference.world.body import EGO, Behaviour

FAMILIES = ("accelerate", "brake", "steer_left", "steer_right")
MOST = 5
"""Worlds of every type that are ranked at most; fewer, if they show everything."""

POLICIES = (BANK.nominal, *BANK.interventions)
each_scenario = pytest.mark.parametrize("scenario", sampled(SCENARIO_NAMES, every=5))


def executed(scenario: str, action_key: str, number: int) -> Run:
    """A rollout of a world; those of its first world are kept, because other tests look at them."""
    if action_key == BANK.nominal.key:
        return nominal_of(scenario, number)
    return (intervention_of if number == 0 else execute)(scenario, action_key, number)


def moved_others(scenario: str, changed: Run) -> bool:
    """Whether an ambient vehicle that nobody hit is elsewhere than in the nominal rollout, two seconds later."""
    nominal = nominal_of(scenario, 0)
    frame = branch_of(scenario).branch_frame + (ACTIVE_TICKS + 40) // OBSERVATION_STRIDE_TICKS
    frame = min(frame, len(nominal.log.bodies) - 1, len(changed.log.bodies) - 1)
    spec = nominal.spec
    first = EGO + 1 + len(SCENARIOS[scenario].bodies(EmptyRoad(route_tracks(spec.town, spec.route_id), spec.seed)))
    before, after = nominal.log.bodies[frame, first:], changed.log.bodies[frame, first:]
    drives = (before["behaviour"] == Behaviour.FOLLOWING) & (after["behaviour"] == Behaviour.FOLLOWING)
    apart = np.hypot(before["x_m"] - after["x_m"], before["y_m"] - after["y_m"])
    return bool((apart[drives] > 0.5).any())


@each_scenario
def test_interventions_have_different_consequences(scenario: str) -> None:
    runs = [intervention_of(scenario, policy.key) for policy in BANK.interventions]
    end = branch_of(scenario).branch_frame + FUTURE_OBSERVATIONS
    ends = {tuple(np.round([r.log.bodies[end]["x_m"][EGO], r.log.bodies[end]["y_m"][EGO]], 1)) for r in runs}
    assert len(ends) >= 6
    assert not all(r.log.collided.any() for r in runs)


def test_many_types_punish_some_intervention_with_a_collision() -> None:
    crashes = [
        any(intervention_of(scenario, policy.key).log.collided.any() for policy in BANK.interventions)
        for scenario in SCENARIO_NAMES
    ]
    assert np.mean(crashes) > 0.5


def test_accelerating_collides_more_often_than_braking() -> None:
    def crashes(action_key: str) -> int:
        return sum(bool(intervention_of(name, action_key).log.collided.any()) for name in SCENARIO_NAMES)

    assert crashes("accelerate_0.80") > crashes("brake_0.50")


def test_other_vehicles_react_to_the_ego() -> None:
    """In many worlds a vehicle that the ego does not touch takes another course."""
    reacted = [
        any(moved_others(scenario, intervention_of(scenario, policy.key)) for policy in BANK.interventions)
        for scenario in SCENARIO_NAMES
    ]
    assert np.mean(reacted) > 0.5


def window(run: Run, frame: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Ego motion and risk evidence of the future window, as `Motion` and `Risk` want them."""
    columns = record(run)
    end = frame + FUTURE_OBSERVATIONS + 1
    future, steps = slice(frame, end), slice(frame + 1, end)
    motion = [columns.observations[name][future] for name in Motion._fields]
    risk = [np.ma.getdata(columns.evidence[name])[steps] for name in Risk._fields]
    return motion, risk


@cache
def targets_of(scenario: str, number: int) -> Targets:
    """Targets of all policies in one world, ``[policies, 6]``."""
    frame = branch_of(scenario, number).branch_frame
    windows = [window(executed(scenario, policy.key, number), frame) for policy in POLICIES]
    motion, risk = ([np.array(values) for values in zip(*part, strict=True)] for part in zip(*windows, strict=True))
    return scalar_targets(Motion(*motion), Risk(*risk))


def extremes(groups: list[Targets]) -> list[dict[str, float]]:
    """Number of worlds in which a family is best, and in which it is worst, by family, ties shared."""
    together = Targets(*(np.stack(parts) for parts in zip(*groups, strict=True)))
    utilities = utility(together, fit_scale(together), PROFILES["balanced"])
    best, worst = (np.nansum(shares, axis=0) for shares in extreme_shares(utilities))
    families = np.array([policy.family for policy in POLICIES])
    return [{name: float(shares[families == name].sum()) for name in FAMILIES} for shares in (best, worst)]


@pytest.mark.thorough
def test_every_family_is_best_somewhere_and_worst_somewhere() -> None:
    """Under the balanced utility, over all scenario types together."""
    groups = [targets_of(scenario, 0) for scenario in SCENARIO_NAMES]
    best, worst = extremes(groups)
    for number, scenario in product(range(1, MOST), SCENARIO_NAMES):
        if min(*best.values(), *worst.values()) >= 1.0:
            break
        groups.append(targets_of(scenario, number))
        best, worst = extremes(groups)
    assert {name: count for name, count in best.items() if count < 1.0} == {}
    assert {name: count for name, count in worst.items() if count < 1.0} == {}
