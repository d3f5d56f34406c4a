"""Every scenario type: the expert masters it, and the trigger finds its manoeuvre."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.simulation.worlds import SCENARIO_NAMES, drive_of

from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.simulation.spec import ROUTE_TIMEOUT_TICKS

WORLDS = range(8)
each_scenario = pytest.mark.parametrize("scenario", SCENARIO_NAMES)


@each_scenario
def test_the_expert_finishes_without_infraction(scenario: str) -> None:
    drives = [drive_of(scenario, number) for number in WORLDS]
    assert np.mean([drive.clean for drive in drives]) >= 0.95
    assert all(200 <= drive.num_ticks < ROUTE_TIMEOUT_TICKS for drive in drives if drive.clean)


@each_scenario
def test_a_branch_is_found(scenario: str) -> None:
    drives = [drive_of(scenario, number) for number in WORLDS]
    assert np.mean([drive.branch is not None for drive in drives]) >= 0.8


def test_over_all_types_the_expert_is_clean_and_branches() -> None:
    drives = [drive_of(scenario, number) for scenario in SCENARIO_NAMES for number in WORLDS]
    assert np.mean([drive.clean for drive in drives]) >= 0.95
    assert np.mean([drive.branch is not None for drive in drives]) >= 0.93


@each_scenario
def test_branches_give_their_evidence(scenario: str) -> None:
    for number in WORLDS:
        branch = drive_of(scenario, number).branch
        if branch is not None:
            assert 0.0 <= branch.confidence <= 1.0
            assert branch.definition == SCENARIOS[scenario].trigger.definition
            assert branch.signal in {signal.name for signal in SCENARIOS[scenario].trigger.signals}
            assert branch.branch_tick < branch.tick <= branch.branch_tick + 5


def test_worlds_of_a_type_differ() -> None:
    for scenario in SCENARIO_NAMES:
        specs = [drive_of(scenario, number).spec for number in WORLDS]
        assert len({spec.seed for spec in specs}) == len(specs)
        assert len({spec.route_id for spec in specs}) > 3
        assert len({spec.environment for spec in specs}) > 1
