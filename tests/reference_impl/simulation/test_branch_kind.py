"""Shares of kinds of branch: drawn group by group, and read from what a user writes."""

from __future__ import annotations

from collections import Counter

import pytest

from branchdrive.errors import UsageError
from branchdrive_reference.simulation.branch_kind import BRANCH_SHARES, BranchKind, drawn_kind

SHARES = {"early": 0.2, "quiet": 0.3}


def test_kinds_have_their_shares() -> None:
    drawn = Counter(drawn_kind(SHARES, 3, index) for index in range(4000))
    assert {kind: round(count / 4000, 1) for kind, count in drawn.items()} == {
        BranchKind.ONSET: 0.5, BranchKind.EARLY: 0.2, BranchKind.QUIET: 0.3,
    }  # fmt: skip


def test_without_shares_every_branch_is_an_onset() -> None:
    assert {drawn_kind({}, 3, index) for index in range(100)} == {BranchKind.ONSET}
    assert {drawn_kind({"quiet": 1.0}, 3, index) for index in range(100)} == {BranchKind.QUIET}


def test_a_kind_depends_on_seed_and_place_alone() -> None:
    kinds = [drawn_kind(SHARES, 3, index) for index in range(50)]
    assert kinds == [drawn_kind(dict(reversed(SHARES.items())), 3, index) for index in range(50)]
    assert kinds != [drawn_kind(SHARES, 4, index) for index in range(50)]


@pytest.mark.parametrize(
    ("text", "shares"),
    [("none", {}), ("mixed", SHARES), ("early=0.25", {"early": 0.25}), ("quiet=1, early=0", {"quiet": 1.0})],
)
def test_shares_are_read(text: str, shares: dict[str, float]) -> None:
    assert BRANCH_SHARES.parse(text, {"mixed": SHARES}) == shares


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("onset=0.5", "'onset' is no kind that can be asked for"),
        ("early=0.1,early=0.2", "'early' comes twice"),
        ("early=much", "'much' is no share of 'early'"),
        ("early=1.5", "the share 1.5 of 'early' is not in 0 .. 1"),
        ("early=0.6,quiet=0.6", "the shares add up to 1.2, which is more than 1"),
    ],
)
def test_other_shares_are_refused_with_what_is_possible(text: str, problem: str) -> None:
    with pytest.raises(UsageError) as refused:
        BRANCH_SHARES.parse(text, {"mixed": SHARES})
    assert problem in str(refused.value)
    assert str(refused.value).endswith("give one of none, mixed, or KIND=SHARE,... with the kinds early, quiet")
