"""Branches of every kind lie where their kind says, by what the nominal rollout logged."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.simulation.worlds import branch_of, nominal_of

from branchdrive.collector.trigger import Branch
from branchdrive.contract.timing import ACTIVE_TICKS
from branchdrive_reference.simulation.branch_kind import EARLY_TICKS, BranchKind
from branchdrive_reference.simulation.placement import (
    MOST_EARLY_TICKS,
    QUIET_CHANGE,
    QUIET_DEFINITION,
    QUIET_SEPARATION_M,
    QUIET_SHIFT_M,
    QUIET_STEER,
    place_branch,
)
from branchdrive_reference.simulation.record import record

SCENARIO = "StaticCutIn"
"""A type in which the expert passes a queue closely before its manoeuvre."""


def placed(kind: BranchKind) -> Branch:
    branch = place_branch(nominal_of(SCENARIO), kind)
    assert branch is not None
    return branch


def test_an_onset_is_where_the_trigger_finds_it() -> None:
    assert placed(BranchKind.ONSET) == branch_of(SCENARIO)


def test_an_early_branch_lies_half_a_second_to_one_before_the_same_manoeuvre() -> None:
    early, onset = placed(BranchKind.EARLY), branch_of(SCENARIO)
    assert early.branch_tick % 5 == 0
    assert EARLY_TICKS <= early.tick - early.branch_tick <= MOST_EARLY_TICKS
    assert (early.tick, early.signal, early.value) == (onset.tick, onset.signal, onset.value)
    assert early.definition == onset.definition.replace("onset", "early") != onset.definition


def test_at_a_quiet_branch_the_expert_holds_its_commands_while_somebody_comes_near() -> None:
    quiet, nominal = placed(BranchKind.QUIET), nominal_of(SCENARIO)
    window = slice(quiet.branch_tick, quiet.branch_tick + ACTIVE_TICKS)
    commands = nominal.log.expert[window].astype(np.float64)
    assert (quiet.tick, quiet.signal, quiet.definition) == (quiet.branch_tick, "steady", QUIET_DEFINITION)
    assert quiet.value == max(abs(row[place] - commands[0][place]) for row in commands for place in range(3))
    assert quiet.value <= quiet.threshold == QUIET_CHANGE
    assert not commands[:, 2].any()
    assert np.abs(commands[:, 0]).max() <= QUIET_STEER
    assert np.abs(nominal.log.lane_shift_m[window]).max() <= QUIET_SHIFT_M
    evidence = record(nominal).evidence
    future = (evidence["tick"] > quiet.branch_tick) & (evidence["tick"] <= quiet.branch_tick + ACTIVE_TICKS)
    assert np.ma.min(evidence["separation_m"][future]) <= QUIET_SEPARATION_M


def test_nobody_near_is_no_quiet_branch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive_reference.simulation.placement.QUIET_SEPARATION_M", 0.0)
    assert place_branch(nominal_of(SCENARIO), BranchKind.QUIET) is None
