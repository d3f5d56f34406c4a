"""Presets are one table of defaults."""

from __future__ import annotations

import pytest

from branchdrive_reference.collect.campaign import collection_descriptor
from branchdrive_reference.collect.fault import Fault
from branchdrive_reference.collect.plan import BRANCH_PRESETS, CONSEQUENTIAL, FAULT_PRESETS, PRESETS, select_scenarios
from branchdrive_reference.scenarios.registry import SCENARIOS


def test_the_demo_has_every_scenario_type_once_exact_and_faultless() -> None:
    demo = PRESETS["demo"]
    assert (demo.num_groups, demo.replay_noise, dict(demo.faults)) == (len(SCENARIOS), 0.0, {})
    assert "demo" not in FAULT_PRESETS


@pytest.mark.parametrize("name", ["benchmark", "context", "deep", "paper"])
def test_the_others_are_noisy_and_have_every_fault(name: str) -> None:
    preset = PRESETS[name]
    assert preset.replay_noise == 1.0
    assert set(preset.faults) == set(Fault)
    assert FAULT_PRESETS[name] == preset.faults


def test_the_benchmark_is_milder_than_the_paper() -> None:
    mild, harsh = PRESETS["benchmark"].faults, PRESETS["paper"].faults
    assert all(mild[fault] < harsh[fault] for fault in Fault)


@pytest.mark.parametrize("name", PRESETS)
def test_a_descriptor_declares_what_is_switched_on(name: str) -> None:
    preset = PRESETS[name]
    declared = collection_descriptor(
        1,
        replay_noise=preset.replay_noise,
        faults=preset.faults,
        branches=preset.branches,
        scenario_types=preset.scenario_types,
    ).collection
    assert (declared.replay_noise.strength or 0.0, declared.faults) == (preset.replay_noise, preset.faults)
    assert (declared.branches, declared.scenario_types) == (preset.branches, preset.scenario_types)
    assert list(declared.faults) == sorted(declared.faults)
    assert all(type(key) is str for key in declared.faults)


def test_two_presets_ask_for_other_kinds_of_branch() -> None:
    assert BRANCH_PRESETS == {"context": {"early": 0.1, "quiet": 0.6}, "deep": {"early": 0.4}}
    for name in BRANCH_PRESETS:
        assert select_scenarios(PRESETS[name].scenario_types) == PRESETS[name].scenario_types


def test_deep_asks_much_of_few_types_whose_consequence_lies_in_the_window() -> None:
    deep = PRESETS["deep"]
    assert 6 <= len(deep.scenario_types) <= 8
    assert set(deep.scenario_types) < set(CONSEQUENTIAL)
    assert deep.num_groups >= 120 * len(deep.scenario_types)


def test_without_other_kinds_a_descriptor_says_nothing_of_them() -> None:
    assert "branches" not in collection_descriptor(1).model_dump(mode="json")["collection"]
