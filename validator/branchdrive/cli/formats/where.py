"""Places of findings in words: attempt, table, column, and ticks from first to last, with seconds to the branch."""

from __future__ import annotations

import re

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.engine.finding import Finding

__all__ = ["further_text", "place_text", "with_short_digests"]

_DIGEST = re.compile(r"\b([0-9a-f]{8})[0-9a-f]{56}\b")


def place_text(finding: Finding) -> str:
    """Where a finding is, and how far it goes on, to stand before what was found there; the dataset is no place."""
    about = finding.location
    who = about.get("rollout_id") or finding.group_id or about.get("file", "")
    what = ".".join(str(about[part]) for part in ("table", "column") if part in about)
    return ", ".join(filter(None, (str(who), what, str(about.get("pointer", "")), _extent_text(finding))))


def _extent_text(finding: Finding) -> str:
    """Ticks of what a finding stands for, how many places that are, and seconds to the branch; empty if all unknown."""
    first, last, count = finding.location.get("tick"), finding.last_tick, finding.count
    if not isinstance(first, int):
        return _num_places(finding)
    if last is None or last == first:
        ticks = f"tick {first}" + (f" ({_num_places(finding)})" if count > 1 else "")
    elif count == 2:
        ticks = f"ticks {first} and {last}"
    else:
        ticks = ", ".join(filter(None, (f"ticks {first} to {last}", _spacing(first, last, finding))))
        ticks += f" ({_num_places(finding)})"
    return ", ".join(filter(None, (ticks, _to_branch(finding))))


def further_text(finding: Finding) -> str:
    """The same without the tick of the location, to stand behind that."""
    first, last = finding.location.get("tick"), finding.last_tick
    if not isinstance(first, int):
        return _num_places(finding)
    end = f"to tick {last}" if last is not None and last > first else ""
    spacing = _spacing(first, last, finding) if end and last is not None else ""
    return ", ".join(filter(None, (end, spacing, _num_places(finding), _to_branch(finding))))


def _num_places(finding: Finding) -> str:
    return f"{finding.count:,} places" if finding.count > 1 else ""


def _spacing(first: int, last: int, finding: Finding) -> str:
    """How far from each other the places are, where they are at all ticks of observations; empty elsewhere.

    Of actors and images an observation has many.
    """
    is_of_many = bool({"actor_id", "camera"} & finding.location.keys()) or finding.location.get("table") == "controls"
    is_every = last - first == OBSERVATION_STRIDE_TICKS * (finding.count - 1) and finding.count > 2
    return f"every {OBSERVATION_STRIDE_TICKS}" if is_every and not is_of_many else ""


def _to_branch(finding: Finding) -> str:
    """Seconds from the first and the last tick to the branch; empty without one."""
    first, branch = finding.location.get("tick"), finding.branch_tick
    if not isinstance(first, int) or branch is None:
        return ""
    last = first if finding.last_tick is None else finding.last_tick
    start_s, end_s = ((tick - branch) * TICK_S for tick in (first, last))
    if first == last:
        return _of_branch(start_s)
    if end_s <= 0 or start_s >= 0:
        side = "before" if end_s <= 0 else "after"
        return f"{abs(start_s):.2f} to {abs(end_s):.2f} s {side} the branch"
    return f"{_of_branch(start_s).removesuffix(' the branch')} to {_of_branch(end_s)}"


def _of_branch(offset_s: float) -> str:
    if offset_s == 0:
        return "at the branch"
    return f"{abs(offset_s):.2f} s {'before' if offset_s < 0 else 'after'} the branch"


def with_short_digests(text: str) -> str:
    """A text in which digests have their first eight digits."""
    return _DIGEST.sub(r"\1..", text)
