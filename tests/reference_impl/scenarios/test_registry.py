"""The registry: names and trigger definitions are unique, and every accepted route can be staged."""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np
import pytest
from tests.each import each
from tests.reference_impl.simulation.worlds import SCENARIO_NAMES

from branchdrive_reference.scenarios.registry import SCENARIOS, scenario_routes
from branchdrive_reference.scenarios.scenario import Scenario
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.town import TOWN_NAMES
from branchdrive_reference.world.body import Body

MIN_ROUTES = 8
each_scenario = each("scenario", SCENARIO_NAMES)


@each_scenario
def test_a_type_is_registered_under_the_name_of_its_class(scenario: str) -> None:
    assert SCENARIOS[scenario].name == type(SCENARIOS[scenario]).__name__ == scenario


def test_names_are_unique_and_in_order() -> None:
    assert len(SCENARIO_NAMES) >= 14
    assert list(SCENARIO_NAMES) == sorted(set(SCENARIO_NAMES))


def test_trigger_definitions_are_versioned_and_unique() -> None:
    definitions = [scenario.trigger.definition for scenario in SCENARIOS.values()]
    assert len(set(definitions)) == len(definitions)
    assert all(re.fullmatch(r"[a-z][a-z-]* [1-9][0-9]*", definition) for definition in definitions)


@each_scenario
def test_a_type_fits_enough_routes(scenario: str) -> None:
    routes = scenario_routes(scenario)
    assert len(routes) >= MIN_ROUTES
    assert len({(route.town, route.route_id) for route in routes}) == len(routes)


def test_every_town_is_used() -> None:
    assert {route.town for name in SCENARIO_NAMES for route in scenario_routes(name)} == set(TOWN_NAMES)


def accepted() -> dict[tuple[str, str], list[tuple[str, int]]]:
    """Who accepts each route, by town and id: scenario types, with a seed of their own for every route.

    By route, because its tables are kept for a moment only.
    """
    found: dict[tuple[str, str], list[tuple[str, int]]] = defaultdict(list)
    for scenario in SCENARIO_NAMES:
        for seed, route in enumerate(scenario_routes(scenario)):
            found[route.town, route.route_id].append((scenario, seed))
    return found


@pytest.mark.parametrize("step", [12, pytest.param(1, marks=pytest.mark.thorough)])
@each(("route", "scenarios"), accepted().items(), ids=["/".join(route) for route in accepted()])
def test_every_accepted_route_can_be_staged(
    route: tuple[str, str], scenarios: list[tuple[str, int]], step: int
) -> None:
    for scenario, seed in scenarios[::step]:
        world = World(WorldSpec(scenario, *route, "clear-noon", seed))
        world.think()
        poses = np.array([world.bodies[name] for name in ("x_m", "y_m", "yaw_rad", "speed_mps")])
        assert np.isfinite(poses).all(), scenario


@each_scenario
def test_instances_hold_no_state(scenario: str) -> None:
    route = scenario_routes(scenario)[0]

    def staged() -> list[Body]:
        world = World(WorldSpec(scenario, route.town, route.route_id, "clear-noon", 5))
        return world.scenario.bodies(world.scene.road)

    assert staged() == staged()
    assert vars(SCENARIOS[scenario]) == {}
    assert isinstance(SCENARIOS[scenario], Scenario)


@each_scenario
def test_trigger_definitions_are_versioned(scenario: str) -> None:
    name, version = SCENARIOS[scenario].trigger.definition.rsplit(" ", 1)
    assert name
    assert int(version) >= 1
