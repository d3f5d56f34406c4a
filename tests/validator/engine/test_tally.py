"""Totals of a shard in a compact form are those that went in."""

from __future__ import annotations

import pickle
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
    found = pickle.loads(pickle.dumps(Tallies.of(EVERY)))
    assert dict(found) == EVERY
    assert [*found] == [*EVERY]
    with pytest.raises(KeyError):
        found["BD-BNK-001"]


def test_rules_without_a_finding_take_a_few_bytes() -> None:
    passing = {rule_id: Tally(rule_id, 32, 32) for rule_id in CATALOGUE}
    assert len(pickle.dumps(Tallies.of(passing))) < 40 * len(passing)


@given(
    st.lists(
        st.dictionaries(
            st.sampled_from([*EVERY]), st.sampled_from([*EVERY.values()]) | st.builds(
                Tally, st.just(""), st.integers(0, 9), st.integers(0, 9), st.integers(0, 3), is_claimed=st.booleans()
            )
        ),
        max_size=4,
    )
)  # fmt: skip
def test_totals_of_shards_add_up(parts: list[dict[str, Tally]]) -> None:
    named = [{rule_id: replace(tally, rule_id=rule_id) for rule_id, tally in part.items()} for part in parts]
    expected: dict[str, Tally] = {}
    for part in named:
        for rule_id, tally in part.items():
            expected.setdefault(rule_id, Tally(rule_id)).add(tally)
    assert Tallies.total(map(Tallies.of, named)) == expected
