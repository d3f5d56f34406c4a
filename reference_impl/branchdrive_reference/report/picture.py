"""Pictures of the report's own numbers: the funnel as bars, action responses as means with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from branchdrive.engine.response_summary import Effect, ResponseSummary
from branchdrive.raw.funnel import Funnel

__all__ = ["Bar", "Panel", "forest", "funnel_bars"]

_BAR_WIDTH = 220
_LEFT, _RIGHT = 130, 440
"""Edges of a panel beside the names of the actions."""


class Bar(NamedTuple):
    """One stage of the funnel; lengths in units of the picture."""

    title: str
    groups: str
    lost: int
    kept: int
    gone: int


class Tick(NamedTuple):
    """A line of the grid."""

    x: float
    text: str
    is_zero: bool


class Mark(NamedTuple):
    """A mean with its interval."""

    mean: float
    low: float
    high: float


class Panel(NamedTuple):
    """One quantity, with the mark of every action."""

    title: str
    left: int
    ticks: Sequence[Tick]
    rows: Sequence[tuple[str, Mark]]


def funnel_bars(funnel: Funnel) -> list[Bar]:
    """Bars of the stages, as long as the groups that reach them; what a stage loses stands behind."""
    most = max(funnel.discovered, 1)
    return [
        Bar(
            stage["title"], f"{stage['groups']:,}", stage["lost"],
            round(_BAR_WIDTH * stage["groups"] / most), math.ceil(_BAR_WIDTH * stage["lost"] / most),
        )
        for stage in funnel.to_json()["stages"]
    ]  # fmt: skip


def forest(response: ResponseSummary) -> list[Panel]:
    """Mean effects of all actions on the lateral place and on speed."""
    quantities = {"To the left, m": "lateral_m", "Faster, m/s": "speed_mps"}
    panels = []
    middle = (_LEFT + _RIGHT) / 2
    for title, name in quantities.items():
        effects: list[Effect] = [getattr(action, name) for action in response.actions]
        ends = [
            value for effect in effects for value in (effect.mean, *(effect.interval or ())) if math.isfinite(value)
        ]
        most = max((abs(value) for value in ends), default=1.0) or 1.0
        step = _step(most)
        reach = math.ceil(most / step) * step
        scale = (_RIGHT - _LEFT) / 2 / reach

        def placed(value: float, scale: float = scale) -> float:
            return round(middle + scale * value, 1) if math.isfinite(value) else middle

        num = round(reach / step)
        values = [i * step for i in range(-num, num + 1)]
        ticks = [Tick(placed(v), f"{v:g}", v == 0) for v in values]
        marks = [
            Mark(placed(effect.mean), *map(placed, effect.interval or (effect.mean, effect.mean))) for effect in effects
        ]
        keys = [action.action_key for action in response.actions]
        panels.append(Panel(title, _LEFT, ticks, list(zip(keys, marks, strict=True))))
    return panels


def _step(most: float) -> float:
    """A round step of which two to five reach `most`."""
    power = 10.0 ** math.floor(math.log10(most))
    return next(factor * power for factor in (0.2, 0.5, 1.0, 2.0) if most / (factor * power) <= 5)
