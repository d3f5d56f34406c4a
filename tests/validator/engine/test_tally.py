"""Totals of a shard in a compact form are those that went in."""

from __future__ import annotations

import pickle

import pytest

from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.finding import Finding
from branchdrive.engine.tally import Tallies, Tally

FOUND = Finding("BD-KEY-001", {"table": "rollouts"}, 1, "one", "two")
EVERY = {
    "BD-KEY-001": Tally("BD-KEY-001", 5, 6, 1, [FOUND]),
    "BD-KEY-003": Tally("BD-KEY-003", 2, 3),
    "BD-CTL-001": Tally("BD-CTL-001", is_claimed=False),
    "BD-CTL-002": Tally("BD-CTL-002", unjudged="no rows"),
    "BD-CTL-005": Tally("BD-CTL-005", is_exceeded=True),
    "BD-CTL-014": Tally("BD-CTL-014", 1, 1, errors=["bug"]),
}


def test_what_went_in_comes_out() -> None:
    found = pickle.loads(pickle.dumps(Tallies(EVERY)))
    assert dict(found) == EVERY
    assert [*found] == [*EVERY]
    with pytest.raises(KeyError):
        found["BD-BNK-001"]


def test_rules_without_a_finding_take_a_few_bytes() -> None:
    passing = {rule_id: Tally(rule_id, 32, 32) for rule_id in CATALOGUE}
    assert len(pickle.dumps(Tallies(passing))) < 40 * len(passing)
