"""Plans are a pure function of seed and index."""

from __future__ import annotations

import re

import pytest

from branchdrive.contract.columns import PATTERNS
from branchdrive.errors import UsageError
from branchdrive_reference.collect.plan import PlannedGroup, plan_group, select_scenarios
from branchdrive_reference.scenarios.registry import SCENARIOS, scenario_routes
from branchdrive_reference.simulation.branch_kind import BranchKind
from branchdrive_reference.town.signal import ENVIRONMENTS


@pytest.fixture(scope="module")
def planned() -> list[PlannedGroup]:
    return [plan_group(5, index) for index in range(300)]


def test_equal_keys_give_equal_plans(planned: list[PlannedGroup]) -> None:
    assert [plan_group(5, index) for index in range(300)] == planned
    assert plan_group(6, 0).spec != planned[0].spec


def test_identities_are_unique_and_legal(planned: list[PlannedGroup]) -> None:
    assert len({plan.group_id for plan in planned}) == len({plan.spec.seed for plan in planned}) == len(planned)
    assert planned[42].group_id == f"g00042-{planned[42].spec.scenario_type.lower()}"
    assert all(re.fullmatch(PATTERNS["id"], plan.group_id) for plan in planned)


def test_scenarios_take_turns_and_routes_and_environments_vary(planned: list[PlannedGroup]) -> None:
    assert [plan.spec.scenario_type for plan in planned[: len(SCENARIOS)]] == list(SCENARIOS)
    assert len({plan.spec.route_id for plan in planned}) > 100
    assert {plan.spec.environment for plan in planned} == set(ENVIRONMENTS)


def test_routes_are_those_that_the_scenario_fits(planned: list[PlannedGroup]) -> None:
    for plan in planned:
        routes = {(route.town, route.route_id) for route in scenario_routes(plan.spec.scenario_type)}
        assert (plan.spec.town, plan.spec.route_id) in routes


def test_selected_scenarios_take_turns_in_registered_order(planned: list[PlannedGroup]) -> None:
    first, second, *_ = SCENARIOS
    selected = select_scenarios([second, first, second])
    assert selected == (first, second)
    plans = [plan_group(5, index, selected) for index in range(4)]
    assert [plan.spec.scenario_type for plan in plans] == [first, second, first, second]
    assert [plan.spec.seed for plan in plans] == [plan.spec.seed for plan in planned[:4]]


def test_kinds_of_branch_change_nothing_else_of_a_plan(planned: list[PlannedGroup]) -> None:
    plans = [plan_group(5, index, (), {"early": 0.5, "quiet": 0.25}) for index in range(300)]
    assert {plan.kind for plan in plans} == set(BranchKind)
    assert [plan.spec for plan in plans] == [plan.spec for plan in planned]
    assert {plan.kind for plan in planned} == {BranchKind.ONSET}


def test_all_scenarios_are_no_selection() -> None:
    assert select_scenarios([]) == select_scenarios(list(SCENARIOS)) == ()


def test_an_unknown_scenario_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UsageError, match="unknown scenario type 'Rain'; choose from " + ", ".join(SCENARIOS)):
        select_scenarios(["Rain"])
