"""The table of action responses as a value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from branchdrive.contract.rule import cause_order
from branchdrive.contract.text import NONE, counted
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.engine.response_summary import Effect, ResponseSummary
from branchdrive.text.table import Column, Table

if TYPE_CHECKING:
    from branchdrive.engine.report import Report

__all__ = ["IN_DOUBT", "response_doubt", "response_table"]

IN_DOUBT = "In doubt: "
"""What a doubt begins with, where nothing before it says that it is a warning."""

_DOUBTS = ("BD-MOT-001", "BD-MOT-002", "BD-MOT-006", "BD-RSP-006", "BD-RSP-007")
"""Rules whose failure says that positions, speeds or headings, which effects are computed from, may be wrong."""

_NOTES = (
    "Means with normal 95 % intervals over all groups in which the action and the nominal are whole up to then, also"
    " those that do not qualify. Left and faster are positive.",
    "Unchanged are groups in which the action changed no pose and no speed. The first response is a median over"
    " attempts that equal their nominal up to the branch; replays with noise never do.",
)


def response_table(response: ResponseSummary) -> Table:
    """What each action did against the nominal."""
    columns = [
        Column.name("Action", is_code=True), Column("Groups"), Column("To the left, m"), Column("Faster, m/s"),
        Column("Unchanged"), Column("First response, s"),
    ]  # fmt: skip
    rows = [
        [
            action.action_key,
            f"{action.num_groups:,}",
            _effect_text(action.lateral_m),
            _effect_text(action.speed_mps),
            f"{action.num_unchanged:,}",
            NONE if action.first_response is None else _seconds(action.first_response),
        ]
        for action in response.actions
    ]
    title = f"Action response: against nominal, {ACTIVE_TICKS * TICK_S:g} s after the branch"
    return Table(title, columns, rows, notes=[*_NOTES])


def response_doubt(report: Report) -> str:
    """Why the columns that effects are computed from are themselves in doubt, one sentence; empty where they are not.

    Args:
        report: The report that the responses are of.
    """
    failed = {tally.rule_id for tally in report.tallies if tally.num_findings and tally.rule_id in _DOUBTS}
    outcomes = () if report.funnel is None else report.funnel.outcomes
    doubtful = [failed.intersection(rule_id for rule_id, _ in outcome.failed) for outcome in outcomes]
    num_groups = len(doubtful) if any(r.startswith("BD-RSP") for r in failed) else sum(map(bool, doubtful))
    if not num_groups:
        return ""
    verb = "fails" if len(failed) == 1 else "fail"
    return (
        f"{IN_DOUBT}{', '.join(sorted(failed, key=cause_order))} {verb} in {num_groups:,} of "
        f"{counted(len(doubtful), 'group')}, so their positions, speeds or headings may be in other units or of other "
        "ticks, and these means mix them with what is right."
    )


def _seconds(first_response: float) -> str:
    return f"{first_response * OBSERVATION_STRIDE_TICKS * TICK_S:.2f}"


def _effect_text(effect: Effect) -> str:
    if effect.interval is None:
        return f"{effect.mean:+.2f}"
    low, high = effect.interval
    return f"{effect.mean:+.2f} [{low:+.2f}, {high:+.2f}]"
