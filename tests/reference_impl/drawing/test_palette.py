"""Colours tell the candidates of a bank apart."""

from __future__ import annotations

import itertools
import math

from branchdrive import ActionBank, load_action_bank
from branchdrive_reference.drawing.palette import candidate_colours

BANK = load_action_bank()


def test_every_candidate_has_its_own_colour() -> None:
    colours = candidate_colours(BANK)
    assert list(colours) == list(BANK.keys)
    assert min(math.dist(*pair) for pair in itertools.combinations(colours.values(), 2)) > 0.1
    assert all(0 <= channel <= 1 for colour in colours.values() for channel in colour)


def test_larger_magnitudes_are_darker() -> None:
    colours = candidate_colours(BANK)
    for _, policies in itertools.groupby(BANK.interventions, key=lambda policy: policy.family):
        by_magnitude = sorted(policies, key=lambda policy: policy.magnitude)
        brightness = [sum(colours[policy.key]) for policy in by_magnitude]
        assert brightness == sorted(brightness, reverse=True) and len(set(brightness)) == len(brightness)


def test_families_of_another_bank_have_colours_too() -> None:
    renamed = [
        policy.model_copy(update={"key": f"x{index}", "family": f"family{index}"})
        for index, policy in enumerate(BANK.interventions)
    ]
    bank = ActionBank(name="other", policies=(BANK.nominal, *renamed[:4]))
    assert len(set(candidate_colours(bank).values())) == 5
