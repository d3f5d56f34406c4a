"""The reference bank is the paper's; any bank finds its policies by key."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.timing import ACTIVE_TICKS
from branchdrive.testing import strategies

MAGNITUDES = {
    "accelerate": ("0.30", "0.50", "0.80"),
    "brake": ("0.30", "0.50", "1.00"),
    "steer_left": ("0.05", "0.10", "0.15"),
    "steer_right": ("0.05", "0.10", "0.15"),
}
RULES = {
    "accelerate": ("zero", "floor", "zero"),
    "brake": ("online_expert", "zero", "floor"),
    "steer_left": ("absolute", "stored_nominal", "stored_nominal"),
    "steer_right": ("absolute", "stored_nominal", "stored_nominal"),
}


def test_reference_keys_are_in_presentation_order() -> None:
    keys = [f"{family}_{size}" for family, sizes in MAGNITUDES.items() for size in sizes]
    assert load_action_bank().keys == ("nominal", *keys)


@each("policy", load_action_bank().interventions, ids=lambda policy: policy.key)
def test_reference_interventions_are_what_their_keys_say(policy: strategies.Policy) -> None:
    family, _, size = policy.key.rpartition("_")
    sign = -1 if family == "steer_left" else 1
    assert policy.family == family
    assert policy.magnitude == float(size)
    assert policy.duration_ticks == ACTIVE_TICKS
    assert policy.recovery == "online_expert"
    assert tuple(rule.rule for rule in policy.rules) == RULES[family]
    assert [rule.value for rule in policy.rules if rule.value is not None] == [sign * float(size)]


def test_reference_nominal_leaves_the_ego_to_the_expert() -> None:
    nominal = load_action_bank().nominal
    assert (nominal.key, nominal.magnitude, nominal.duration_ticks, nominal.recovery) == (
        "nominal",
        0,
        0,
        "none",
    )
    assert {rule.rule for rule in nominal.rules} == {"online_expert"}


@given(strategies.banks())
def test_key_identifies_and_order_presents(bank: ActionBank) -> None:
    assert [bank[key] for key in bank.keys] == list(bank.policies)
    assert bank.nominal.is_nominal
    assert bank.policies[bank.nominal_index] is bank.nominal
    assert not any(policy.is_nominal for policy in bank.interventions)
    assert {bank.nominal.key, *(policy.key for policy in bank.interventions)} == set(bank.keys)


@given(strategies.banks(), st.randoms(use_true_random=False))
def test_permuted_bank_finds_the_same_policies(bank: ActionBank, random: st.RandomType) -> None:
    order = list(bank.policies)
    random.shuffle(order)
    permuted = ActionBank(name=bank.name, policies=tuple(order))
    assert {key: permuted[key] for key in bank.keys} == {key: bank[key] for key in bank.keys}
    assert permuted.nominal == bank.nominal


@pytest.mark.parametrize("key", ["", "brake", "brake_0.5", "NOMINAL", "nominal\n"])
def test_unknown_key_is_a_key_error(key: str) -> None:
    with pytest.raises(KeyError):
        load_action_bank()[key]
