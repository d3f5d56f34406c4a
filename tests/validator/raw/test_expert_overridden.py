"""What the expert commands while it is overridden, as interventions of one policy show it (BD-RSP-010)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.validator.driving.test_response import interventions

from branchdrive.contract.bank import load_action_bank
from branchdrive.driving.response import Responses
from branchdrive.raw.rules.responses import MIN_INTERVENTIONS, expert_goes_on_while_it_is_overridden

CHANGES, CONSTANT, NOMINAL, APPLIED = np.eye(4, dtype=bool)
STEER, PEDALS = 0, 1


def findings(responses: Responses) -> list[str]:
    descriptor = SimpleNamespace(driver=None, action_bank=load_action_bank())
    survey = SimpleNamespace(descriptor=descriptor, shards=[SimpleNamespace(responses=responses)])
    (check,) = expert_goes_on_while_it_is_overridden(cast(Any, survey))
    return [check.mismatch(index).found for index in check.bad.tolist()]


def of_policy(key: str, actuator: int, shown: np.ndarray[Any, Any]) -> Responses:
    num = MIN_INTERVENTIONS
    policy = load_action_bank().keys.index(key)
    expert = np.zeros((num, 2, 4), bool)
    expert[:, actuator] = CHANGES | shown
    effects = {"steer": [0.1] * num, "lateral_m": [1.0] * num, "drive": [0.5] * num, "speed_mps": [1.0] * num}
    return interventions(num, policy=[policy] * num, expert=expert, **effects)


@pytest.mark.parametrize(
    ("key", "actuator"),
    [("brake_0.30", PEDALS), ("accelerate_0.30", STEER), ("accelerate_0.30", PEDALS), ("steer_left_0.05", STEER)],
)
def test_commands_that_are_the_applied_ones_are_found_where_the_policy_takes_the_actuator(
    key: str, actuator: int
) -> None:
    assert any(
        f"the applied commands in nearly all of {MIN_INTERVENTIONS}" in text
        for text in findings(of_policy(key, actuator, APPLIED))
    )


def test_an_expert_that_steers_through_a_braking_gets_what_it_commands() -> None:
    assert findings(of_policy("brake_0.30", STEER, APPLIED)) == []


@pytest.mark.parametrize("shown", [CONSTANT, NOMINAL])
def test_an_expert_that_steers_through_a_braking_still_decides_on_its_own_state(shown: np.ndarray[Any, Any]) -> None:
    assert len(findings(of_policy("brake_0.30", STEER, shown))) == 2  # of all interventions, and of its policy
