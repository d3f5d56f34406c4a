"""Plans are a pure function of seed and index."""

from __future__ import annotations

import re

from branchdrive.contract.columns import PATTERNS
from branchdrive_reference.collect.plan import plan_group
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.town.reference_town import reference_town
from branchdrive_reference.town.route import town_routes

PLANS = [plan_group(5, index) for index in range(300)]


def test_equal_keys_give_equal_plans() -> None:
    assert [plan_group(5, index) for index in range(300)] == PLANS
    assert plan_group(6, 0).spec != PLANS[0].spec


def test_identities_are_unique_and_legal() -> None:
    assert len({plan.group_id for plan in PLANS}) == len({plan.spec.seed for plan in PLANS}) == len(PLANS)
    assert PLANS[42].group_id == "g00042-parkedobstacle"
    assert all(re.fullmatch(PATTERNS["id"], plan.group_id) for plan in PLANS)


def test_scenarios_take_turns_and_routes_and_environments_vary() -> None:
    assert [plan.spec.scenario_type for plan in PLANS[:3]] == list(SCENARIOS)
    assert len({plan.spec.route_id for plan in PLANS}) > 100
    assert len({plan.spec.environment for plan in PLANS}) == 4


def test_routes_are_those_of_the_town() -> None:
    assert {plan.spec.route_id for plan in PLANS} <= set(town_routes(reference_town()))
