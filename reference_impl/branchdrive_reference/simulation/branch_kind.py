"""Kinds of branch, and which of them a planned group gets.

A kind says what is asked of the nominal rollout; where the branch then lies is a matter of `simulation.placement`.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from branchdrive.errors import UsageError
from branchdrive_reference.noise import Purpose, uniform

__all__ = ["DESCRIPTIONS", "EARLY_TICKS", "BranchKind", "drawn_kind", "parse_shares"]


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


def parse_shares(text: str, presets: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Shares of a text: ``none``, a preset's name, or ``KIND=SHARE`` separated by commas.

    Args:
        text: What the user wrote.
        presets: Shares by the name of their preset.

    Returns:
        Shares by the name of the kind; those that are 0 are left out.

    Raises:
        UsageError: A kind is unknown or comes twice, a share is not a number of 0 to 1, or they add up to more than 1.
    """
    if text == "none":
        return {}
    if text in presets:
        return dict(presets[text])
    shares: dict[str, float] = {}
    for part in text.split(","):
        name, _, share = (piece.strip() for piece in part.partition("="))
        if name not in _ASKED:
            raise _refused(text, f"{name!r} is no kind that can be asked for", presets)
        if name in shares:
            raise _refused(text, f"{name!r} comes twice", presets)
        try:
            shares[name] = float(share)
        except ValueError:
            raise _refused(text, f"{share!r} is no share of {name!r}", presets) from None
        if not 0 <= shares[name] <= 1:
            raise _refused(text, f"the share {share} of {name!r} is not in 0 .. 1", presets)
    if sum(shares.values()) > 1:
        raise _refused(text, f"the shares add up to {sum(shares.values()):g}, which is more than 1", presets)
    return {name: share for name, share in shares.items() if share > 0}


_ASKED = tuple(str(kind) for kind in BranchKind if kind is not BranchKind.ONSET)


def _refused(text: str, problem: str, presets: Mapping[str, Mapping[str, float]]) -> UsageError:
    wholes = ", ".join(["none", *presets])
    return UsageError(
        f"--branches {text!r}: {problem}; give one of {wholes}, or KIND=SHARE,... with the kinds {', '.join(_ASKED)}"
    )
