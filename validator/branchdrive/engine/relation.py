"""Which rules may be why another one fails, declared by rule and found by attempt.

What is recomputed from rows at fault differs from what is recorded. So a rule that recomputes may fail in an attempt
because of another one that fails in the same attempt, and where both know their ticks, at ticks of that one; one that
compares an attempt with its nominal may because of what either of the two fails in the rows that it compares. A wrong
unit, sign or clock of most attempts of a group explains the others too, since short and standing ones do not tell it.
Source: spec/07-rules.md#report.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import compress
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask, Stretch
from branchdrive.contract.rule import cause_order
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.raw.shard_view import ShardView

__all__ = ["POSSIBLE", "SIBLINGS", "Failed", "Roots", "repair_first", "roots_of_attempts"]

_UNIT = ("BD-RSP-007", "BD-MOT-006")
"""Rules whose findings name a wrong unit, sign or clock, in the dataset and in an attempt."""

_MOTION = (
    "BD-GRP-009", "BD-GRP-010", "BD-MOT-006", "BD-MOT-001", "BD-BOX-001", "BD-BOX-002", "BD-BOX-003", "BD-RSP-001",
    "BD-RSP-006", "BD-RSP-007",
)  # fmt: skip
"""Rules of which a failure tells of the future of another action, of a wrong unit, sign, clock or size."""

_BOXES = "BD-EVD-001"
"""The rule on separation, which takes boxes alone: where it fails, what takes boxes and velocities does too."""

_EVIDENCE = (_BOXES, "BD-EVD-002", "BD-EVD-003")

POSSIBLE: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "BD-TAB-004": ("BD-LAY-001",),
        "BD-MOT-001": _UNIT,
        "BD-MOT-006": _UNIT[:1],
        "BD-EVD-002": (*_MOTION, _BOXES),
        "BD-EVD-003": (*_MOTION, _BOXES),
        **dict.fromkeys((_BOXES, "BD-MOT-003", "BD-RPN-003", "BD-ACT-004", "BD-RSP-016"), _MOTION),
    }
)
"""Rules that may be why a rule fails in an attempt, whatever the ticks; of a group, and of the dataset, in all."""

SIBLINGS = (_BOXES,)
"""Rules of which what follows is no consequence but recomputed from the same rows."""

_COMPUTED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        **dict.fromkeys(_EVIDENCE, ("BD-WIN-005", "BD-ACT-001", "BD-ACT-003")),
        **dict.fromkeys(("BD-ACT-003", "BD-ACT-005", "BD-ACT-008"), ("BD-WIN-005",)),
        **dict.fromkeys(("BD-RTE-001", "BD-RTE-004", "BD-MAP-005", "BD-MAP-006", "BD-MAP-007"), ("BD-MOT-001",)),
    }
)
"""Rules on rows that a rule computes from at the same ticks: actors who lack or change, a jump of the ego."""

_COMPARED: Mapping[str, tuple[str, ...] | None] = MappingProxyType(
    {"BD-RPN-001": None, "BD-RPN-003": None, "BD-CTL-010": ("BD-CTL-009",)}
)
"""Rules that compare an attempt with its nominal, and those on the rows compared that may be why, ``None`` for all."""

_NO_CAUSES = ("RPN", "GRP")
"""Areas of rules that compare attempts, and explain no comparison."""

Roots = Mapping[str, tuple[str, ...]]
"""Rules that an attempt fails and others may be why, each with those that nothing explains in turn."""


def repair_first(rule_id: str, causes: Sequence[str]) -> str:
    """What to do about a rule that fails where others may be why, instead of its remedy."""
    names = ", ".join(causes)
    if {*causes} <= {*SIBLINGS}:
        return f"See to {names} first: both are recomputed from the same rows, and may have the same cause."
    if rule_id in _EVIDENCE:
        return (
            f"Repair {names} first, and leave evidence as it is: it may be right, and the rows it is held against not."
        )
    return f"Repair {names} first, and change nothing for this rule: it may hold then."


class Failed(NamedTuple):
    """Attempts that fail a rule.

    Attributes:
        attempts: Which ``[rollouts]``.
        stretches: Which rows of them mismatch, as far as that is known.
    """

    attempts: Mask
    stretches: Sequence[Stretch]


class _Link(NamedTuple):
    """In which attempts a rule may fail because of another one, that they or their nominals fail."""

    effect: str
    cause: str
    is_of_nominal: bool
    attempts: Mask


def roots_of_attempts(view: ShardView, failed: Mapping[str, Failed], groups: Mapping[str, Mask]) -> list[Roots]:
    """Of every attempt of a shard, which of the rules that it fails others may explain.

    Args:
        view: The shard.
        failed: Attempts that fail rules.
        groups: Groups that fail rules ``[groups]``.
    """
    links = [link for link in _links(view, failed, groups) if link.attempts.any()]
    if not links:
        return [{}] * view.num_rollouts
    rows = np.packbits(np.stack([link.attempts for link in links], axis=1), axis=1)
    known: dict[tuple[bytes, bytes], Roots] = {}  # most attempts fail the same
    found = []
    for own, nominal in zip(rows, rows[view.nominal], strict=True):
        key = own.tobytes(), nominal.tobytes()
        if key not in known:
            known[key] = _roots(*([*compress(links, np.unpackbits(row))] for row in (own, nominal)))
        found.append(known[key])
    return found


def _links(view: ShardView, failed: Mapping[str, Failed], groups: Mapping[str, Mask]) -> Iterator[_Link]:
    for effect, one in failed.items():
        for cause in POSSIBLE.get(effect, ()):
            if cause in failed:
                yield _Link(effect, cause, False, one.attempts & _with_most(view, failed[cause].attempts))
            elif cause in groups:
                yield _Link(effect, cause, False, one.attempts & groups[cause][view.group])
        for cause in _COMPUTED.get(effect, ()):
            if cause in failed:
                yield _Link(effect, cause, False, one.attempts & _covers(failed[cause], one))
        if effect in _COMPARED:
            for cause, other in failed.items():
                if cause in (_COMPARED[effect] or failed) and cause[3:6] not in _NO_CAUSES:
                    yield _Link(effect, cause, False, one.attempts & _in_place(other, one))
                    yield _Link(effect, cause, True, one.attempts & _in_place(other, one, view.nominal))


def _with_most(view: ShardView, failed: Mask) -> Mask:
    """Attempts that fail, and all of groups of which more than half do."""
    num = np.bincount(view.group, minlength=len(view.group_ids))
    num_failed = np.bincount(view.group[failed], minlength=len(view.group_ids))
    return np.asarray(failed | (2 * num_failed > num)[view.group])


def _covers(cause: Failed, effect: Failed) -> Mask:
    """Attempts in which rows that fail the cause are at all ticks of the effect, or the one before.

    What is said of tracks and rates compares an observation with the one before.
    """
    covers = cause.attempts.copy()
    for stretch in effect.stretches:
        inside = ~stretch.is_there
        for other in cause.stretches:
            is_in = (other.first <= stretch.first) & (stretch.last <= other.last + OBSERVATION_STRIDE_TICKS)
            inside |= other.is_there & is_in
        covers &= inside
    return covers


def _in_place(cause: Failed, effect: Failed, who: NDArray[np.integer] | None = None) -> Mask:
    """Attempts in which the first row of the effect is of the table and ticks of the cause, in the attempt or `who`."""
    chosen = np.arange(len(effect.attempts)) if who is None else who
    found = np.zeros(len(effect.attempts), bool)
    for stretch in effect.stretches:
        for other in cause.stretches:
            if other.table == stretch.table:
                first, last = other.first[chosen], other.last[chosen]
                is_in = (first <= stretch.first) & (stretch.first <= last) | (stretch.first == Stretch.UNKNOWN)
                found |= stretch.is_there & other.is_there[chosen] & cause.attempts[chosen] & (chosen >= 0) & is_in
    return found


def _roots(here: Sequence[_Link], there: Sequence[_Link]) -> Roots:
    """Roots of what an attempt fails, from links of the attempt and of its nominal."""
    own, nominal = (_graph(links) for links in (here, there))
    found: dict[str, set[str]] = {effect: _ends(effect, own) for effect in own}
    for link in here:
        if link.is_of_nominal:
            found.setdefault(link.effect, set()).update(_ends(link.cause, nominal))
    return {effect: tuple(sorted(roots, key=cause_order)) for effect, roots in found.items()}


def _graph(links: Iterable[_Link]) -> dict[str, list[str]]:
    """Rules of one attempt that may fail because of others in it."""
    graph: dict[str, list[str]] = {}
    for link in links:
        if not link.is_of_nominal:
            graph.setdefault(link.effect, []).append(link.cause)
    return graph


def _ends(rule_id: str, graph: Mapping[str, Sequence[str]]) -> set[str]:
    """Rules from which a rule follows and that follow from none."""
    ends, seen, waiting = set(), {rule_id}, [rule_id]
    while waiting:
        other = waiting.pop()
        if other not in graph:
            ends.add(other)
        new = [cause for cause in graph.get(other, ()) if cause not in seen]
        seen.update(new)
        waiting += new
    return ends
