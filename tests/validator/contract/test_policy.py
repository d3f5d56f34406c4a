"""The actuator algebra: what every rule demands, in float32."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError
from tests.each import each

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.columns import TABLES
from branchdrive.contract.policy import ACTUATORS, ActuatorRule, Command, Policy
from branchdrive.testing import strategies

EXPERT = np.array([-1.0, -0.25, -0.0, 0.0, 0.25, 0.5, 1.0], np.float32)
NOMINAL = np.array([0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875], np.float32)

DEMANDS: dict[tuple[str, float | None], list[float]] = {
    ("online_expert", None): [-1.0, -0.25, 0.0, 0.0, 0.25, 0.5, 1.0],
    ("stored_nominal", None): [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875],
    ("zero", None): [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ("absolute", -0.5): [-0.5, -0.5, -0.5, -0.5, -0.5, -0.5, -0.5],
    ("absolute", 0.0): [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ("floor", 0.25): [0.25, 0.25, 0.25, 0.25, 0.25, 0.5, 1.0],
    ("floor", -0.5): [-0.5, -0.25, 0.0, 0.0, 0.25, 0.5, 1.0],
    ("floor", 1.0): [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
}
"""What each rule demands of `EXPERT` and `NOMINAL`, by hand."""

each_demand = each(
    ("rule", "value", "demanded"),
    [(rule, value, demanded) for (rule, value), demanded in DEMANDS.items()],
)

float32s = st.floats(-1, 1, width=32)


def signals(num_ticks: int = 6) -> st.SearchStrategy[NDArray[np.float32]]:
    return st.lists(float32s, min_size=num_ticks, max_size=num_ticks).map(lambda x: np.array(x, np.float32))


def same_bits(left: Any, right: Any) -> bool:
    left, right = np.asarray(left), np.asarray(right)
    is_float32 = left.dtype == right.dtype == np.float32
    return is_float32 and left.shape == right.shape and left.tobytes() == right.tobytes()


@each_demand
def test_rule_demands_what_the_table_says(rule: str, value: float | None, demanded: list[float]) -> None:
    command = ActuatorRule(rule=rule, value=value).evaluate(EXPERT, NOMINAL)
    assert command.dtype == np.float32
    assert command.tolist() == demanded


@each_demand
def test_one_tick_agrees_with_many(rule: str, value: float | None, demanded: list[float]) -> None:
    actuator = ActuatorRule(rule=rule, value=value)
    for expert, nominal, expected in zip(EXPERT, NOMINAL, demanded, strict=True):
        command = actuator.evaluate(expert, nominal)
        assert command.dtype == np.float32
        assert command.shape == ()
        assert command == expected


def test_table_of_demands_covers_every_rule() -> None:
    declared = ActuatorRule.model_json_schema()["properties"]["rule"]["enum"]
    assert {rule for rule, _ in DEMANDS} == set(declared)


@given(strategies.actuator_rules(), signals(), signals())
def test_any_rule_agrees_tick_by_tick(
    rule: ActuatorRule, expert: NDArray[np.float32], nominal: NDArray[np.float32]
) -> None:
    whole = rule.evaluate(expert, nominal)
    ticks = [rule.evaluate(own, copied) for own, copied in zip(expert, nominal, strict=True)]
    assert same_bits(whole, np.stack(ticks))
    table = rule.evaluate(expert.reshape(2, 3), nominal.reshape(2, 3))
    assert same_bits(table, whole.reshape(2, 3))


@given(float32s, st.floats(-1, 1))
def test_values_are_rounded_to_float32_once(expert: float, value: float) -> None:
    rounded = np.float32(value)
    assert same_bits(ActuatorRule(rule="absolute", value=value).evaluate(np.float32(expert), None), rounded)
    floored = ActuatorRule(rule="floor", value=value).evaluate(np.float32(expert), None)
    assert floored in (np.float32(expert), rounded)
    assert floored >= np.float32(expert)
    assert floored >= rounded


def test_floor_compares_in_float32() -> None:
    just_above = np.nextafter(np.float32(0.3), np.float32(1))
    rule = ActuatorRule(rule="floor", value=0.3)
    assert rule.evaluate(np.float32(0.3), None) == np.float32(0.3)
    assert rule.evaluate(just_above, None) == just_above
    assert float(rule.evaluate(np.float32(0), None)) != 0.3  # the recorded number is not the decimal one


@given(strategies.actuator_rules(), signals(), signals(), signals())
def test_rules_never_fall_as_the_expert_rises(
    rule: ActuatorRule, one: NDArray[np.float32], other: NDArray[np.float32], nominal: NDArray[np.float32]
) -> None:
    low, high = np.minimum(one, other), np.maximum(one, other)
    assert np.all(rule.evaluate(low, nominal) <= rule.evaluate(high, nominal))


@given(strategies.actuator_rules(), signals(), signals())
def test_rules_of_their_own_result_change_nothing(
    rule: ActuatorRule, expert: NDArray[np.float32], nominal: NDArray[np.float32]
) -> None:
    once = rule.evaluate(expert, nominal)
    assert np.array_equal(rule.evaluate(once, nominal), once)


@given(strategies.actuator_rules(), signals(), signals(), signals())
def test_only_the_online_expert_is_closed_loop(
    rule: ActuatorRule, one: NDArray[np.float32], other: NDArray[np.float32], nominal: NDArray[np.float32]
) -> None:
    is_open_loop = rule.rule in ("stored_nominal", "zero", "absolute")
    if is_open_loop:
        assert same_bits(rule.evaluate(one, nominal), rule.evaluate(other, nominal))
    if rule.rule != "stored_nominal":
        assert same_bits(rule.evaluate(one, nominal), rule.evaluate(one, None))


def test_stored_nominal_needs_a_nominal_command() -> None:
    with pytest.raises(ValueError, match="needs the nominal command"):
        ActuatorRule(rule="stored_nominal").evaluate(EXPERT, None)
    zeros = Command(EXPERT, EXPERT, EXPERT)
    with pytest.raises(ValueError, match="needs the nominal command"):
        load_action_bank()["steer_left_0.10"].command(zeros)


@pytest.mark.parametrize("expert", [0, 0.25, [0.25, 0.5], np.array([0.25], np.float64)], ids=repr)
def test_commands_of_other_types_are_rounded(expert: Any) -> None:
    for rule in (ActuatorRule(rule="online_expert"), ActuatorRule(rule="floor", value=0.1)):
        command = rule.evaluate(expert, None)
        assert command.dtype == np.float32
        assert command.shape == np.shape(expert)


INVALID_RULES: dict[str, dict[str, Any]] = {
    "floor without value": {"rule": "floor"},
    "absolute of null": {"rule": "absolute", "value": None},
    "zero with value": {"rule": "zero", "value": 0.0},
    "expert with value": {"rule": "online_expert", "value": 0.5},
    "value out of range": {"rule": "floor", "value": 1.0000001},
    "value not finite": {"rule": "absolute", "value": float("nan")},
    "value as text": {"rule": "absolute", "value": "0.5"},
    "value as bool": {"rule": "absolute", "value": True},
    "unknown rule": {"rule": "ceiling", "value": 0.5},
    "unknown field": {"rule": "zero", "gain": 1.0},
}


@each("fields", INVALID_RULES.values(), ids=INVALID_RULES)
def test_invalid_rules_are_rejected(fields: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        ActuatorRule(**fields)


TICK = Command(np.float32(0.2), np.float32(0.4), np.float32(0.1))
STORED = Command(np.float32(-0.3), np.float32(0.6), np.float32(0.0))

COMMANDS: dict[str, tuple[float, float, float]] = {
    "nominal": (0.2, 0.4, 0.1),
    "accelerate_0.30": (0.0, 0.4, 0.0),
    "accelerate_0.50": (0.0, 0.5, 0.0),
    "accelerate_0.80": (0.0, 0.8, 0.0),
    "brake_0.30": (0.2, 0.0, 0.3),
    "brake_0.50": (0.2, 0.0, 0.5),
    "brake_1.00": (0.2, 0.0, 1.0),
    "steer_left_0.05": (-0.05, 0.6, 0.0),
    "steer_left_0.10": (-0.10, 0.6, 0.0),
    "steer_left_0.15": (-0.15, 0.6, 0.0),
    "steer_right_0.05": (0.05, 0.6, 0.0),
    "steer_right_0.10": (0.10, 0.6, 0.0),
    "steer_right_0.15": (0.15, 0.6, 0.0),
}
"""What the reference bank commands at one tick, by hand from the definition of its families."""


@each(("key", "expected"), COMMANDS.items())
def test_reference_policy_commands(key: str, expected: tuple[float, float, float]) -> None:
    command = load_action_bank()[key].command(TICK, STORED)
    assert [float(value) for value in command] == [float(np.float32(value)) for value in expected]
    assert command._fields == ACTUATORS


def test_commands_are_given_for_the_whole_reference_bank() -> None:
    assert tuple(COMMANDS) == load_action_bank().keys


@given(strategies.banks(), st.data())
def test_any_bank_of_the_algebra_is_evaluated(bank: ActionBank, data: st.DataObject) -> None:
    expert, nominal = data.draw(strategies.commands(4)), data.draw(strategies.commands(4))
    for policy in bank.policies:
        command = policy.command(expert, nominal)
        for rule, own, copied, commanded in zip(policy.rules, expert, nominal, command, strict=True):
            if rule.rule in strategies.VALUED_RULES:
                value = np.float32(rule.value)
                expected = np.maximum(own, value) if rule.rule == "floor" else np.full(4, value, np.float32)
            else:
                zeros = np.zeros(4, np.float32)
                expected = {"online_expert": own, "stored_nominal": copied, "zero": zeros}[rule.rule]
            assert same_bits(commanded, expected)
    assert all(np.array_equal(a, b) for a, b in zip(bank.nominal.command(expert), expert, strict=True))


@given(strategies.policies())
def test_effective_action_fills_its_columns(policy: Policy) -> None:
    columns = policy.effective_action()
    assert list(columns) == [c.name for c in TABLES["rollouts"].columns if c.name.startswith("effective_")]
    for actuator, rule in zip(ACTUATORS, policy.rules, strict=True):
        value = columns[f"effective_{actuator}_value"]
        assert columns[f"effective_{actuator}_rule"] == rule.rule
        assert (value is None) == (rule.value is None)
        if rule.value is not None:
            assert value == float(np.float32(rule.value))
    assert columns["effective_duration_ticks"] == policy.duration_ticks
    assert columns["effective_recovery"] == policy.recovery
