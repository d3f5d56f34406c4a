"""The table of action responses as a value."""

from __future__ import annotations

from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.engine.response_summary import Effect, ResponseSummary
from branchdrive.text.table import Column, Table

__all__ = ["response_table"]

_NOTE = (
    "Means over groups with normal 95 % intervals. Left and faster are positive. The first response is a median over"
    " attempts that equal their nominal up to the branch; replays with noise never do."
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
            f"{action.num_unchanged:,}" if action.num_unchanged else "",
            "" if action.first_response is None else _seconds(action.first_response),
        ]
        for action in response.actions
    ]
    title = f"Action response: against nominal, {ACTIVE_TICKS * TICK_S:g} s after the branch"
    return Table(title, columns, rows, notes=[_NOTE])


def _seconds(first_response: float) -> str:
    return f"{first_response * OBSERVATION_STRIDE_TICKS * TICK_S:.2f}"


def _effect_text(effect: Effect) -> str:
    if effect.interval is None:
        return f"{effect.mean:+.2f}"
    low, high = effect.interval
    return f"{effect.mean:+.2f} [{low:+.2f}, {high:+.2f}]"
