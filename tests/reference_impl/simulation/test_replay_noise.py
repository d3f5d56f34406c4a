"""Replay noise: declared, reproducible, independent of the policy, and none where none is asked for."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.reference_impl.simulation.worlds import BANK, SCENARIO_NAMES, branch_of, digest, nominal_of, spec_of

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive_reference.expert.control import PLAN
from branchdrive_reference.simulation.log import Logger
from branchdrive_reference.simulation.replay_noise import ReplayNoise
from branchdrive_reference.simulation.rollout import Run, run
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.track import route_tracks
from branchdrive_reference.world.body import BODY, EGO, Behaviour

SOME = SCENARIO_NAMES[::5]
each_scenario = each("scenario", SOME)
STRENGTHS = (0.3, 1.0, 3.0)


def replayed(scenario: str, replay: int, strength: float) -> WorldSpec:
    return dataclasses.replace(spec_of(scenario), replay=replay, replay_noise=strength)


def replay_of(scenario: str, replay: int, strength: float) -> Run:
    """The nominal policy once more."""
    return run(replayed(scenario, replay, strength), BANK.nominal)


def discrepancy_m(scenario: str, replay: int, strength: float) -> float:
    """Root mean square distance of the ego from its nominal pass, up to the branch."""
    frames = branch_of(scenario).branch_frame + 1
    ego, truth = (
        rollout.log.bodies[:frames, EGO] for rollout in (replay_of(scenario, replay, strength), nominal_of(scenario))
    )
    return float(np.sqrt(np.mean((ego["x_m"] - truth["x_m"]) ** 2 + (ego["y_m"] - truth["y_m"]) ** 2)))


@each_scenario
@each(("replay", "strength"), [(0, 0.0), (0, 2.0), (3, 0.0)])
def test_without_a_replay_or_strength_the_nominal_is_repeated_bit_by_bit(
    scenario: str, replay: int, strength: float
) -> None:
    assert digest(replay_of(scenario, replay, strength)) == digest(nominal_of(scenario))


@each_scenario
def test_a_key_gives_the_same_replay_again(scenario: str) -> None:
    assert digest(replay_of(scenario, 2, 1.0)) == digest(replay_of(scenario, 2, 1.0))


@each_scenario
def test_every_key_gives_another_replay(scenario: str) -> None:
    digests = {digest(replay_of(scenario, replay, 1.0)) for replay in (1, 2, 3)}
    assert len(digests | {digest(nominal_of(scenario))}) == 4


def test_the_discrepancy_grows_with_the_strength() -> None:
    medians = [
        np.median([discrepancy_m(scenario, replay, strength) for scenario in SOME for replay in (1, 2)])
        for strength in STRENGTHS
    ]
    assert 0.0 < medians[0] < medians[1] < medians[2]


def test_a_replay_stays_close_to_its_nominal_up_to_the_branch() -> None:
    found = [discrepancy_m(scenario, replay, 1.0) for scenario in SOME for replay in (1, 2)]
    assert np.median(found) < 0.5


def test_different_worlds_draw_different_noise_for_the_same_key() -> None:
    keys = {ReplayNoise.of(replayed(scenario, 1, 1.0)).key for scenario in SCENARIO_NAMES}
    assert len(keys) == len(SCENARIO_NAMES)


@each_scenario
def test_the_noise_does_not_depend_on_the_policy(scenario: str) -> None:
    """Before the branch, interventions of one replay key are bit-equal."""
    nominal, branch = nominal_of(scenario), branch_of(scenario)
    spec = replayed(scenario, 4, 1.0)
    pasts = set()
    for key in ("accelerate_0.50", "brake_1.00", "steer_left_0.10"):
        log = run(spec, BANK[key], branch_tick=branch.branch_tick, nominal=nominal.log.applied).log
        pasts.add((log.applied[: branch.branch_tick].tobytes(), log.bodies[: branch.branch_frame + 1].tobytes()))
    log = replay_of(scenario, 4, 1.0).log
    pasts.add((log.applied[: branch.branch_tick].tobytes(), log.bodies[: branch.branch_frame + 1].tobytes()))
    assert len(pasts) == 1
    assert pasts != {
        (nominal.log.applied[: branch.branch_tick].tobytes(), nominal.log.bodies[: branch.branch_frame + 1].tobytes())
    }


@each_scenario
def test_recorded_commands_stay_legal(scenario: str) -> None:
    for command in (replay_of(scenario, 1, 8.0).log.applied, replay_of(scenario, 1, 8.0).log.expert):
        assert command.dtype == np.float32
        assert (np.abs(command[:, 0]) <= 1.0).all()
        assert ((command[:, 1:] >= 0.0) & (command[:, 1:] <= 1.0)).all()
        assert not ((command[:, 1] > 0.0) & (command[:, 2] > 0.0)).any()


def plan_row(steer: float, throttle: float, brake: float) -> np.void:
    row = np.zeros(1, PLAN)
    row["steer"], row["throttle"], row["brake"] = steer, throttle, brake
    return row[0]


@given(
    st.integers(0, 2**53 - 1), st.floats(0.0, 100.0), st.integers(0, 900),
    st.floats(-1.0, 1.0), st.floats(0.0, 1.0), st.booleans(),
)  # fmt: skip
def test_disturbed_commands_stay_legal(
    key: int, scale: float, tick: int, steer: float, pedal: float, brakes: bool
) -> None:
    plan = plan_row(steer, 0.0 if brakes else pedal, pedal if brakes else 0.0)
    ReplayNoise(key, scale).disturb_command(plan, tick)
    assert -1.0 <= plan["steer"] <= 1.0
    assert 0.0 <= plan["brake" if brakes else "throttle"] <= 1.0
    assert plan["throttle" if brakes else "brake"] == 0.0


def steers(scale: float, *, ticks: int = 4000) -> np.ndarray:
    """Steering commands of an expert that keeps straight on."""
    noise, found = ReplayNoise(11, scale), []
    for tick in range(0, ticks, OBSERVATION_STRIDE_TICKS):
        plan = plan_row(0.0, 0.0, 0.0)
        noise.disturb_command(plan, tick)
        found.append(float(plan["steer"]))
    return np.array(found)


def test_command_noise_is_unbiased_and_proportional_to_the_scale() -> None:
    single, double = steers(1.0), steers(2.0)
    assert double == pytest.approx(2.0 * single, rel=1e-4, abs=1e-9)
    assert abs(single.mean()) < 4.0 * single.std() / math.sqrt(len(single))
    assert single.std() > 0.0


def test_command_noise_is_held_between_observations() -> None:
    noise, found = ReplayNoise(11, 1.0), []
    for tick in range(3 * OBSERVATION_STRIDE_TICKS):
        plan = plan_row(0.1, 0.5, 0.0)
        noise.disturb_command(plan, tick)
        found.append((float(plan["steer"]), float(plan["throttle"])))
    assert len(set(found)) == 3
    assert len(set(found[:OBSERVATION_STRIDE_TICKS])) == 1


def test_observations_are_taken_early_or_late() -> None:
    """Every pose is off by its velocity times one and the same time."""
    bodies = np.zeros(3, BODY)
    bodies["vel_x_mps"], bodies["vel_y_mps"], bodies["yaw_rate_radps"] = (
        [10.0, -4.0, 0.0],
        [0.0, 3.0, 0.0],
        [0.1, 0.0, 0.0],
    )
    before = bodies.copy()
    ReplayNoise(5, 1.0).disturb_observation(bodies, 40)
    late_s = bodies["x_m"][0] / 10.0
    assert late_s != 0.0
    assert bodies["x_m"] == pytest.approx(before["vel_x_mps"] * late_s)
    assert bodies["y_m"] == pytest.approx(before["vel_y_mps"] * late_s)
    assert bodies["yaw_rad"] == pytest.approx(before["yaw_rate_radps"] * late_s)
    assert bodies[2] == before[2]


def test_observation_noise_does_not_reach_the_world() -> None:
    world = World(replayed("HardBrakeRoute", 1, 1.0))
    logger = Logger(OBSERVATION_STRIDE_TICKS, len(world.bodies))
    world.think()
    before = world.bodies.copy()
    logger.begin_tick(world)
    assert world.bodies.tobytes() == before.tobytes()
    assert logger.finish(1).bodies[0]["x_m"][EGO] != before["x_m"][EGO]


@each_scenario
def test_starts_differ_along_the_lane_only(scenario: str) -> None:
    before, after = World(spec_of(scenario)).bodies, World(replayed(scenario, 1, 1.0)).bodies
    tables = route_tracks(spec_of(scenario).town, spec_of(scenario).route_id)
    follows = before["behaviour"] == Behaviour.FOLLOWING
    others = ~follows
    others[EGO] = False
    assert after[others].tobytes() == before[others].tobytes()
    assert (after["arc_m"][follows] != before["arc_m"][follows]).all()
    assert (after["offset_m"] == before["offset_m"]).all()
    for body in after[follows]:
        path = tables.path(int(body["track"]))
        away_m = np.hypot(path["x_m"] - body["x_m"], path["y_m"] - body["y_m"]).min()
        assert away_m < abs(body["offset_m"]) + 1.0 or not path["arc_m"][0] < body["arc_m"] < path["arc_m"][-1]
    dx, dy = after["x_m"][EGO] - before["x_m"][EGO], after["y_m"][EGO] - before["y_m"][EGO]
    yaw = before["yaw_rad"][EGO]
    assert dx * math.sin(yaw) == pytest.approx(dy * math.cos(yaw), abs=1e-9)
    assert math.hypot(dx, dy) > 0.0


@each_scenario
def test_the_ego_starts_at_the_speed_of_its_vehicle_state(scenario: str) -> None:
    world = World(replayed(scenario, 1, 1.0))
    ego = world.bodies[EGO]
    assert ego["speed_mps"] != spec_speed(scenario)
    assert world.vehicle["forward_mps"][0] == ego["speed_mps"]
    assert math.hypot(ego["vel_x_mps"], ego["vel_y_mps"]) == pytest.approx(ego["speed_mps"])


def spec_speed(scenario: str) -> float:
    """Speed at which the ego starts without noise."""
    return float(World(spec_of(scenario)).bodies["speed_mps"][EGO])
