"""The page on the reference world says what the code says."""

from __future__ import annotations

import re
from collections import Counter

from tests.each import each
from tests.repo.checkout import ROOT

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive_reference.collect.fault import DESCRIPTIONS
from branchdrive_reference.collect.plan import FAULT_PRESETS
from branchdrive_reference.rendering import fault as image_fault
from branchdrive_reference.scenarios.registry import SCENARIOS, scenario_routes
from branchdrive_reference.simulation import branch_kind, placement, replay_noise
from branchdrive_reference.town.lane import LANE_WIDTH_M, RoadClass
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.signal import CYCLE_TICKS, ENVIRONMENTS, Light, light_of
from branchdrive_reference.town.town import (
    INTERURBAN_ROADS,
    INTERURBAN_TOWN_NAME,
    TOWN_NAMES,
    URBAN_ROADS,
    URBAN_TOWN_NAME,
    town,
)

PAGE = (ROOT / "docs" / "reference-world.md").read_text(encoding="utf-8")
ABILITIES = {"overtaking", "merging", "emergency braking", "giving way", "traffic signs"}
ROADS = {URBAN_TOWN_NAME: URBAN_ROADS, INTERURBAN_TOWN_NAME: INTERURBAN_ROADS}


def table(header: str) -> list[list[str]]:
    """Cells of the rows below a header, back-ticks left out."""
    block = re.search(rf"^\| {re.escape(header)} \|.*\n\|[ -|]*\n((?:\|.*\n)+)", PAGE, re.M)
    assert block is not None, header
    return [[cell.strip(" `") for cell in row.strip("|").split("|")] for row in block[1].splitlines()]


def test_every_scenario_type_is_listed_in_the_order_of_the_registry() -> None:
    assert [row[0] for row in table("scenario type")] == list(SCENARIOS)


@each("row", table("scenario type"), ids=lambda row: row[0])
def test_a_scenario_type_is_described_as_registered(row: list[str]) -> None:
    name, abilities, staged, _, definition = row
    places = {route.place.value for route in scenario_routes(name)}
    assert set(abilities.split(", ")) <= ABILITIES
    assert staged.partition(":")[0].split(", ") == sorted(places)
    assert definition == SCENARIOS[name].trigger.definition


def test_every_ability_is_covered() -> None:
    assert {ability for row in table("scenario type") for ability in row[1].split(", ")} == ABILITIES


def controls(network: RoadNetwork) -> str:
    counts = Counter(junction.control.value for junction in network.junctions.values())
    signs = f"{counts['signal']} with signals, {counts['stop']} with stop signs, {counts['yield']} with yield signs"
    return f"{len(network.junctions)}: {signs}"


def test_the_towns_are_counted() -> None:
    rows = {row[0]: row[1:] for row in table("town")}
    assert tuple(rows) == TOWN_NAMES
    for name, (junctions, roads, motorway, limits) in rows.items():
        network = town(name)
        lanes = list(network.lanes.values())
        kmh = [lane.speed_limit_mps * 3.6 for lane in lanes]
        assert junctions == controls(network)
        assert int(roads) == len(ROADS[name])
        assert limits == f"{min(kmh):.0f} to {max(kmh):.0f} km/h"
        ramps = [lane for lane in lanes if lane.road_class is RoadClass.RAMP]
        entries = sum(1 for ramp in ramps if network.successors[ramp.lane_id])
        motorway_lanes = [lane for lane in lanes if lane.road_class is RoadClass.MOTORWAY]
        first = [lane for lane in motorway_lanes if not network.predecessors[lane.lane_id]]
        found = f"{len(first) // 2} lanes each way, {entries} entries, {len(ramps) - entries} exits"
        assert motorway == (found if first else "none")


def test_the_lane_width_is_right() -> None:
    assert f"lanes are {LANE_WIDTH_M} m wide" in PAGE


def test_the_environments_are_those_of_the_code() -> None:
    assert table("environment") == [[name, f"{found.grip:.2f}"] for name, found in ENVIRONMENTS.items()]


def test_the_signal_programme_is_that_of_the_code() -> None:
    lights = Counter(light_of(0, tick, 0) for tick in range(CYCLE_TICKS))
    all_red = sum(light_of(0, tick, 0) == light_of(1, tick, 0) == Light.RED for tick in range(CYCLE_TICKS)) / 2
    green_s, yellow_s, red_s = (count * TICK_S for count in (lights[Light.GREEN], lights[Light.YELLOW], all_red))
    assert f"{green_s:g} s green, {yellow_s:g} s yellow, {red_s:g} s red for all" in PAGE


def test_the_replay_noise_is_that_of_the_code() -> None:
    held_s = OBSERVATION_STRIDE_TICKS * TICK_S
    expected = [
        f"{replay_noise._TRAFFIC_M:g} m",
        f"{100 * replay_noise._TRAFFIC_SHARE:g} %",
        f"{replay_noise._EGO_M:g} m",
        f"{100 * replay_noise._EGO_SHARE:g} %",
        f"{replay_noise._STEER:g}",
        f"{100 * replay_noise._PEDAL_SHARE:g} %",
        f"{1000 * replay_noise._SENSOR_S:g} ms",
    ]
    rows = table("what is disturbed")
    assert [row[1] for row in rows] == expected
    assert all(f"held for {held_s:g} s" in row[0] for row in rows if "command" in row[0] or "throttle" in row[0])


def test_the_faults_are_those_of_the_code() -> None:
    described = {**DESCRIPTIONS, **image_fault.DESCRIPTIONS}
    assert table("fault") == [[str(fault), text] for fault, text in described.items()]
    assert all(preset in FAULT_PRESETS for preset in re.findall(r"--faults ([a-z]+)`", PAGE))


def test_the_kinds_of_branch_are_those_of_the_code() -> None:
    assert table("kind") == [[str(kind), text] for kind, text in branch_kind.DESCRIPTIONS.items()]
    assert f"the definition of a quiet branch is `{placement.QUIET_DEFINITION}`" in PAGE.lower()
    early_s, most_s = (TICK_S * ticks for ticks in (branch_kind.EARLY_TICKS, placement.MOST_EARLY_TICKS))
    assert f"{early_s:g} to {most_s:g} s before" in branch_kind.DESCRIPTIONS[branch_kind.BranchKind.EARLY]
    quiet = branch_kind.DESCRIPTIONS[branch_kind.BranchKind.QUIET]
    assert f"within {placement.QUIET_SEPARATION_M:g} m" in quiet
    assert f"which is at most {placement.QUIET_CHANGE:g} and" in PAGE
