"""Lines before junctions: what counts as an infraction, and which light governs the ego."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.each import each
from tests.reference_impl.simulation.worlds import BANK, nominal_of

from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.simulation import ending as infraction
from branchdrive_reference.simulation.ending import NO_LIGHT, LineMonitor, governing_light
from branchdrive_reference.simulation.record import record
from branchdrive_reference.simulation.rollout import Run, run
from branchdrive_reference.town.signal import NO_GROUP, Light, light_of
from branchdrive_reference.town.track import EGO_TRACK, TRACK, route_tracks
from branchdrive_reference.world.body import EGO
from branchdrive_reference.world.corridor import FOOT
from branchdrive_reference.world.vehicle import EGO_SIZE

RED_LIGHT, STOP_SIGN = "VanillaSignalizedTurnEncounterRedLight", "VanillaNonSignalizedTurnEncounterStopsign"
WORLDS = range(4)
HALF_M = EGO_SIZE.length_m / 2


def world(
    gap_m: float, *, speed_mps: float = 5.0, light: Light = Light.RED, group: int = 0, stop_sign: bool = False
) -> Any:
    """As much of a world as the monitor looks at, with the ego's front this far before the line."""
    feet = np.zeros((1, 1), FOOT)
    feet["arc_m"], feet["half_length_m"], feet["speed_mps"] = 100.0 - gap_m - HALF_M, HALF_M, speed_mps
    tracks = np.array([(0, 0, 100.0, group, stop_sign)], TRACK)
    return SimpleNamespace(feet=feet, tables=SimpleNamespace(tracks=tracks), lights=np.full(2, int(light)))


def watched(*worlds: Any) -> LineMonitor:
    monitor = LineMonitor()
    for seen in worlds:
        monitor.watch(seen)
    return monitor


@pytest.mark.parametrize("light", list(Light))
def test_the_line_is_run_at_red_only(light: Light) -> None:
    assert watched(world(0.2, light=light), world(-0.2, light=light)).num_red_lights_run == (light is Light.RED)


@pytest.mark.parametrize(
    "gaps_m", [(5.0, 0.2), (-0.2, -5.0), (-0.2, 0.2), (0.2, 0.2)], ids=["before", "behind", "backwards", "waiting"]
)
def test_who_does_not_cross_the_line_forwards_runs_nothing(gaps_m: tuple[float, float]) -> None:
    monitor = watched(*(world(gap_m, stop_sign=True) for gap_m in gaps_m))
    assert (monitor.num_red_lights_run, monitor.num_stop_signs_run) == (0, 0)


def test_a_line_without_signals_has_no_red_light() -> None:
    assert watched(world(0.2, group=NO_GROUP), world(-0.2, group=NO_GROUP)).num_red_lights_run == 0


@pytest.mark.parametrize(
    ("stop_m", "speed_mps", "run_signs"),
    [(1.0, 0.0, 0), (1.0, 2.0, 1), (20.0, 0.0, 1), (-1.0, 0.0, 1)],
    ids=["stopped", "rolled", "stopped too early", "stopped too late"],
)
def test_a_stop_sign_asks_for_a_stop_at_its_line(stop_m: float, speed_mps: float, run_signs: int) -> None:
    stop = world(stop_m, speed_mps=speed_mps, group=NO_GROUP, stop_sign=True)
    around = [world(gap_m, group=NO_GROUP, stop_sign=True) for gap_m in (0.2, -0.2)]
    seen = [stop, *around] if stop_m > 0 else [*around, stop]
    assert watched(*seen).num_stop_signs_run == run_signs


def test_every_crossing_counts() -> None:
    assert watched(*(world(gap_m) for gap_m in (0.2, -0.2, 0.2, -0.2))).num_red_lights_run == 2


@pytest.mark.parametrize(("gap_m", "governs"), [(50.0, True), (0.01, True), (-0.1, False), (200.0, False)])
def test_a_light_governs_until_the_front_is_at_its_line(gap_m: float, governs: bool) -> None:
    assert governing_light(world(gap_m)) == (Light.RED if governs else NO_LIGHT)
    assert governing_light(world(gap_m, group=NO_GROUP)) == NO_LIGHT


def gaps_m(rollout: Run) -> np.ndarray:
    """Way of the ego's front to the line of its route, at every observation, as long as it heads along."""
    tables = route_tracks(rollout.spec.town, rollout.spec.route_id)
    ego = rollout.log.bodies[:, EGO]
    progress_m = tables.route.polyline.position(ego["x_m"], ego["y_m"]).progress_m
    return np.asarray(tables.tracks["stop_m"][EGO_TRACK] - progress_m - HALF_M)


def overridden(scenario: str, number: int, action_key: str, *, at_m: float = 14.0) -> Run:
    """An intervention that begins this far before the line."""
    nominal = nominal_of(scenario, number)
    branch_tick = 5 * int(np.argmax(gaps_m(nominal) < at_m))
    return run(nominal.spec, BANK[action_key], branch_tick=branch_tick, nominal=nominal.log.applied)


def counted(rollout: Run) -> tuple[int, int]:
    fields = record(rollout).fields
    return fields["result_num_red_light_infractions"], fields["result_num_stop_sign_infractions"]


@each("number", WORLDS)
@each(("scenario", "expected"), [(RED_LIGHT, (1, 0)), (STOP_SIGN, (0, 1))])
def test_accelerating_over_the_line_is_an_infraction(scenario: str, expected: tuple[int, int], number: int) -> None:
    assert counted(overridden(scenario, number, "accelerate_0.80")) == expected


@each("number", WORLDS)
@each("scenario", [RED_LIGHT, STOP_SIGN])
def test_the_expert_commits_none_with_or_without_braking_earlier(scenario: str, number: int) -> None:
    assert counted(nominal_of(scenario, number)) == (0, 0)
    assert counted(overridden(scenario, number, "brake_0.50")) == (0, 0)


@each("number", WORLDS)
@each("scenario", [RED_LIGHT, "SignalizedJunctionLeftTurn"])
def test_the_governing_light_recomputes(scenario: str, number: int) -> None:
    """From the programme of the signals and the recorded poses."""
    rollout = nominal_of(scenario, number)
    tables = route_tracks(rollout.spec.town, rollout.spec.route_id)
    offset_ticks = SCENARIOS[scenario].signal_offset(EmptyRoad(tables, rollout.spec.seed))
    group, gap_m = int(tables.tracks["group"][EGO_TRACK]), gaps_m(rollout)
    lights = np.array([light_of(group, 5 * frame, offset_ticks) for frame in range(len(gap_m))])
    expected = np.where((gap_m >= 0.0) & (gap_m <= infraction._GOVERNED_M), lights, NO_LIGHT)
    clear = (np.abs(gap_m) > 0.1) & (np.abs(gap_m - infraction._GOVERNED_M) > 0.1)
    assert (rollout.log.light == expected)[clear].all()
    assert (expected != NO_LIGHT).any()


@pytest.mark.parametrize("number", WORLDS)
def test_the_recorded_light_is_null_off_its_reach(number: int) -> None:
    rollout = nominal_of(RED_LIGHT, number)
    evidence = record(rollout).evidence
    available = evidence["traffic_light_available"]
    assert [light is not None for light in evidence["traffic_light"]] == available.tolist()
    assert set(evidence["traffic_light"][available]) <= {"green", "yellow", "red"}
    assert not available[gaps_m(rollout) < -0.5].any()
    assert "red" in evidence["traffic_light"]


@pytest.mark.parametrize("scenario", [STOP_SIGN, "EnterActorFlow", "HighwayCutIn"])
def test_without_signals_no_light_is_recorded(scenario: str) -> None:
    evidence = record(nominal_of(scenario)).evidence
    assert not evidence["traffic_light_available"].any()
    assert set(evidence["traffic_light"]) == {None}
