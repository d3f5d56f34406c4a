"""`bd29`: 29 numbers per policy, the same for everybody who follows the definition."""

from __future__ import annotations

import hashlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.each import each

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.encoding import (
    ENCODING_NAME,
    ENCODING_WIDTH,
    encode_bank,
    encode_policy,
    encoding_digest,
)
from branchdrive.contract.policy import ActuatorRule, Policy
from branchdrive.contract.timing import TICK_S
from branchdrive.errors import UsageError
from branchdrive.testing import strategies

REFERENCE_DIGEST = "250bf01cc1f3f5637ddf6cfb7ce69f92f343aa17d9234601d15786274ecedac4"
"""SHA-256 of the reference bank's matrix: promised bytes, they never change."""

# fmt: off
BY_HAND: dict[str, list[float]] = {
    # family; magnitude, scaled, time; lateral, throttle floor, brake floor
    # steering rule; throttle rule; brake rule; open loop, lateral override; recovery
    "nominal": [
        1, 0, 0, 0, 0,   0, 0, 0,   0, 0, 0,
        1, 0, 0, 0,   1, 0, 0, 0,   1, 0, 0, 0,   0, 0,   1, 0, 0, 0,
    ],
    "accelerate_0.50": [
        0, 1, 0, 0, 0,   0.5, 0.625, 1,   0, 0.5, 0,
        0, 1, 0, 0,   0, 1, 0, 0,   0, 1, 0, 0,   0, 1,   0, 1, 0, 0,
    ],
    "brake_1.00": [
        0, 0, 1, 0, 0,   1, 1, 1,   0, 0, 1,
        1, 0, 0, 0,   0, 0, 1, 0,   0, 0, 1, 0,   0, 0,   0, 1, 0, 0,
    ],
    "steer_left_0.10": [
        0, 0, 0, 1, 0,   -0.1, -0.1 / 0.15, 1,   -0.1, 0, 0,
        0, 0, 1, 0,   0, 0, 0, 1,   0, 0, 0, 1,   1, 1,   0, 1, 0, 0,
    ],
    "steer_right_0.15": [
        0, 0, 0, 0, 1,   0.15, 1, 1,   0.15, 0, 0,
        0, 0, 0, 1,   0, 0, 0, 1,   0, 0, 0, 1,   1, 1,   0, 1, 0, 0,
    ],
}
# fmt: on
"""Vectors of one policy per family, written from the definition."""


def vector_by_index(policy: Policy) -> list[float]:
    """The definition again, component by component, as a list of float64."""
    vector = [0.0] * 29
    vector[["nominal", "accelerate", "brake", "steer_left", "steer_right"].index(policy.family)] = 1.0
    if policy.family != "nominal":
        vector[5] = -policy.magnitude if policy.family == "steer_left" else policy.magnitude
        vector[6] = vector[5] / {"a": 0.8, "b": 1.0, "s": 0.15}[policy.family[0]]
    vector[7] = policy.duration_ticks * 0.05 / 2.5
    steer, throttle, brake = policy.steer, policy.throttle, policy.brake
    if steer.rule == "online_expert":
        vector[11] = 1.0
    elif steer.rule == "zero":
        vector[12] = vector[24] = 1.0
    elif steer.rule == "absolute" and steer.value is not None:
        vector[8] = steer.value
        vector[13 if steer.value < 0 else 14] = vector[24] = 1.0
    for rule, floor_index, index_of in (
        (throttle, 9, {"online_expert": 15, "floor": 16, "zero": 17, "stored_nominal": 18}),
        (brake, 10, {"online_expert": 19, "zero": 20, "floor": 21, "stored_nominal": 22}),
    ):
        vector[index_of[rule.rule]] = 1.0
        if rule.rule == "floor" and rule.value is not None:
            vector[floor_index] = rule.value
        if rule.rule == "stored_nominal":
            vector[23] = 1.0
    vector[25 + ("none", "online_expert", "stored_nominal", "hold").index(policy.recovery)] = 1.0
    return vector


def bits(matrix: NDArray[np.float32]) -> NDArray[np.uint32]:
    assert matrix.dtype == np.float32
    return matrix.view(np.uint32)


def test_width_is_29() -> None:
    assert ENCODING_NAME == "bd29"
    assert ENCODING_WIDTH == 29
    assert encode_bank(load_action_bank()).shape == (13, 29)


@pytest.mark.parametrize(("key", "expected"), BY_HAND.items())
def test_vector_is_the_one_written_by_hand(key: str, expected: list[float]) -> None:
    vector = encode_policy(load_action_bank()[key])
    assert bits(vector).tolist() == bits(np.array(expected, np.float64).astype(np.float32)).tolist()


@each("policy", load_action_bank().policies, ids=lambda policy: policy.key)
def test_reference_vectors_agree_with_a_second_implementation(policy: Policy) -> None:
    expected = b"".join(struct.pack("<f", component) for component in vector_by_index(policy))
    assert encode_policy(policy).astype("<f4").tobytes() == expected


@given(strategies.bd29_policies())
def test_any_vector_agrees_with_a_second_implementation(policy: Policy) -> None:
    expected = np.array(vector_by_index(policy), np.float64).astype(np.float32)
    assert np.array_equal(encode_policy(policy), expected)


@given(strategies.bd29_policies())
def test_no_component_is_negative_zero(policy: Policy) -> None:
    vector = encode_policy(policy)
    assert not np.any(np.signbit(vector) & (vector == 0) & ~_underflows(policy))


def _underflows(policy: Policy) -> NDArray[np.bool_]:
    """Components that are not 0 before they are rounded to float32."""
    return np.array(vector_by_index(policy), np.float64) != 0


def test_zero_of_a_left_command_is_positive() -> None:
    left = load_action_bank()["steer_left_0.05"]
    assert not np.signbit(encode_policy(left.model_copy(update={"magnitude": 0.0}))[5:7]).any()


@given(strategies.bd29_policies())
def test_one_hot_blocks_hold_exactly_one(policy: Policy) -> None:
    vector = encode_policy(policy)
    for block in (slice(0, 5), slice(11, 15), slice(15, 19), slice(19, 23), slice(25, 29)):
        assert sorted(vector[block])[-1] == 1
        assert vector[block].sum() == 1
    assert set(vector[23:25]) <= {0.0, 1.0}


@given(strategies.bd29_banks(), st.data())
def test_permuting_the_bank_permutes_rows_only(bank: ActionBank, data: st.DataObject) -> None:
    order = data.draw(st.permutations(range(len(bank.policies))))
    permuted = ActionBank(name=bank.name, policies=tuple(bank.policies[index] for index in order))
    assert bits(encode_bank(permuted)).tolist() == bits(encode_bank(bank)[order]).tolist()


@given(strategies.bd29_banks(), strategies.identifiers())
def test_encoding_is_blind_to_names(bank: ActionBank, name: str) -> None:
    keyed = tuple(policy.model_copy(update={"key": f"{index}"}) for index, policy in enumerate(bank.policies))
    assert encoding_digest(ActionBank(name=name, policies=keyed)) == encoding_digest(bank)


@given(strategies.policies_outside_bd29())
def test_policies_outside_the_domain_are_named(policy: Policy) -> None:
    with pytest.raises(UsageError) as raised:
        encode_policy(policy)
    message = str(raised.value)
    assert repr(policy.key) in message
    assert "outside the domain of `bd29`" in message


OUTSIDE = {
    "family": ({"family": "swerve"}, "family 'swerve'"),
    "steer copies": ({"steer": ActuatorRule(rule="stored_nominal")}, "steering rule 'stored_nominal'"),
    "steer floor": ({"steer": ActuatorRule(rule="floor", value=0.1)}, "steering rule 'floor'"),
    "steer straight": ({"steer": ActuatorRule(rule="absolute", value=0.0)}, "steering rule 'absolute'"),
    "throttle value": ({"throttle": ActuatorRule(rule="absolute", value=0.1)}, "throttle rule 'absolute'"),
    "brake value": ({"brake": ActuatorRule(rule="absolute", value=0.1)}, "brake rule 'absolute'"),
}


@pytest.mark.parametrize(("change", "culprit"), OUTSIDE.values(), ids=OUTSIDE)
def test_message_names_what_is_outside(change: dict[str, object], culprit: str) -> None:
    policy = load_action_bank()["brake_0.50"].model_copy(update=change)
    with pytest.raises(UsageError, match=culprit):
        encode_policy(policy)


@given(strategies.banks(), strategies.policies_outside_bd29())
def test_one_policy_outside_puts_the_bank_outside(bank: ActionBank, outside: Policy) -> None:
    with pytest.raises(UsageError):
        encode_bank(bank.model_copy(update={"policies": (*bank.policies, outside)}))


def test_rows_of_the_reference_bank_are_distinct() -> None:
    matrix = encode_bank(load_action_bank())
    assert len(np.unique(matrix, axis=0)) == len(matrix) == 13


def test_digest_is_the_promised_one() -> None:
    assert encoding_digest(load_action_bank()) == REFERENCE_DIGEST


@given(strategies.bd29_banks())
def test_digest_is_of_little_endian_rows(bank: ActionBank) -> None:
    rows = b"".join(struct.pack("<29f", *row) for row in encode_bank(bank).tolist())
    assert encoding_digest(bank) == hashlib.sha256(rows).hexdigest()


def test_duration_does_not_depend_on_the_order_of_evaluation() -> None:
    ticks = np.arange(1001, dtype=np.float64)
    assert np.array_equal((ticks * TICK_S / 2.5).astype(np.float32), (ticks / 50).astype(np.float32))
