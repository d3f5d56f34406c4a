"""Kinds of branch, and which of them a planned group gets.

A kind says what is asked of the nominal rollout; where the branch then lies is a matter of `simulation.placement`.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from branchdrive_reference.noise import Purpose, uniform
from branchdrive_reference.share_list import ShareList

__all__ = ["BRANCH_SHARES", "DESCRIPTIONS", "EARLY_TICKS", "BranchKind", "drawn_kind"]


class BranchKind(StrEnum):
    """Name of a kind, as the descriptor has it."""

    ONSET = "onset"
    EARLY = "early"
    QUIET = "quiet"


EARLY_TICKS = 10
"""Ticks from an early branch to the manoeuvre, at least; an onset's are at most one observation's."""

DESCRIPTIONS: Mapping[BranchKind, str] = {
    BranchKind.ONSET: "the last observation before the expert's manoeuvre",
    BranchKind.EARLY: "an observation 0.5 to 1 s before the manoeuvre, drawn",
    BranchKind.QUIET: "a control: an observation from which the expert holds its commands for 2.5 s, drives straight "
    "on, does not brake, and comes within 2 m of somebody, drawn",
}
"""Where the branch lies."""


def drawn_kind(shares: Mapping[str, float], seed: int, index: int) -> BranchKind:
    """Kind of branch of the planned group at a place: each with its share, an onset with what is left.

    Args:
        shares: Shares by the name of a kind, which add up to at most 1.
        seed: Seed of the collection.
        index: Place of the group.
    """
    drawn = uniform(seed, int(Purpose.PLAN_BRANCH), index)
    for kind in BranchKind:
        share = shares.get(kind, 0.0)
        if drawn < share:
            return kind
        drawn -= share
    return BranchKind.ONSET


BRANCH_SHARES = ShareList(
    "--branches",
    tuple(kind for kind in BranchKind if kind is not BranchKind.ONSET),
    "share",
    "is no kind that can be asked for",
    "KIND=SHARE,... with the kinds",
    is_division=True,
)
"""The option that names kinds of branch, each with its share of the groups."""
