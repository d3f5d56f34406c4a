"""Collection and sample construction: the two passes, the windows around the branch, and what becomes of them."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.encoding import ENCODING_WIDTH
from branchdrive.contract.timing import (
    ACTIVE_TICKS,
    CONTROL_HISTORY_TICKS,
    FUTURE_OFFSETS,
    HISTORY_OFFSETS,
    PREDECESSOR_OFFSET,
    TICK_S,
)
from branchdrive_reference.benchmark.figure.canvas import HUES, INK, axes_of, new_figure

__all__ = ["draw_construction"]

_FROM, _TO = -112, 92
"""Drawn ticks, relative to the branch."""

_BAR = 7.0


def draw_construction() -> Figure:
    """How one sample is made of a nominal rollout and a replay; it shows the specification and no data."""
    num_interventions = len(load_action_bank().policies) - 1
    figure = new_figure(
        11.4, 5.0, "From two passes to one sample",
        f"Ticks of {TICK_S:g} s, counted from the branch. The nominal's history is shared by all candidates; each "
        "future is that of the candidate's own rollout.",
    )  # fmt: skip
    (axes,) = axes_of(figure, 1, 1)
    rows = {
        "First pass: nominal": _nominal,
        f"Second pass: {num_interventions} replays": _replay,
        "Input: controls": _controls,
        "Input: observations": _observations,
        "Input: action": _action,
        "Targets": _targets,
    }
    for place, draw in enumerate(rows.values()):
        draw(axes, place)
    axes.axvline(0, color=INK, linestyle=(0, (4, 3)), linewidth=1.1, zorder=0)
    axes.text(1.5, -0.72, "branch", fontsize=9, color=INK)
    axes.set(xlim=(_FROM, _TO), ylim=(len(rows) - 0.35, -0.95), yticks=range(len(rows)), xlabel="ticks from the branch")
    axes.set_yticklabels(list(rows))
    axes.set_xticks([-CONTROL_HISTORY_TICKS, HISTORY_OFFSETS[0], -50, -25, 0, 25, ACTIVE_TICKS])
    axes.set_xticklabels([str(-CONTROL_HISTORY_TICKS), "", "-50", "-25", "0", "25", str(ACTIVE_TICKS)])
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return figure


def _bar(axes: Axes, place: int, begin: float, end: float, colour: str, text: str, alpha: float = 1.0) -> None:
    axes.plot([begin, end], [place, place], color=colour, linewidth=_BAR, solid_capstyle="butt", alpha=alpha)
    axes.text((begin + end) / 2, place - 0.26, text, ha="center", va="bottom", fontsize=8.3, color=INK)


def _nominal(axes: Axes, place: int) -> None:
    _bar(axes, place, _FROM, _TO, HUES[0], "")
    axes.text(_FROM + 2, place - 0.26, "the expert drives the whole route", va="bottom", fontsize=8.3, color=INK)


def _replay(axes: Axes, place: int) -> None:
    _bar(axes, place, _FROM, 0, HUES[0], "replayed from tick 0 by the expert", alpha=0.4)
    _bar(axes, place, 0, ACTIVE_TICKS, HUES[1], "intervention acts")
    _bar(axes, place, ACTIVE_TICKS, _TO, HUES[0], "the expert recovers", alpha=0.4)


def _controls(axes: Axes, place: int) -> None:
    text = f"{CONTROL_HISTORY_TICKS} applied controls of the nominal, up to the tick before"
    _bar(axes, place, -CONTROL_HISTORY_TICKS, -1, HUES[2], text)


def _observations(axes: Axes, place: int) -> None:
    axes.plot(HISTORY_OFFSETS, [place] * len(HISTORY_OFFSETS), "o", color=HUES[2], markersize=6)
    axes.plot(PREDECESSOR_OFFSET, place, "o", color=HUES[2], markersize=6, fillstyle="none")
    axes.text(HISTORY_OFFSETS[0] / 2, place - 0.22, f"{len(HISTORY_OFFSETS)} observations of the nominal, one more for "
              "differences", ha="center", va="bottom", fontsize=8.3, color=INK)  # fmt: skip


def _action(axes: Axes, place: int) -> None:
    axes.plot(0, place, "D", color=HUES[1], markersize=8)
    axes.text(5, place, f"{ENCODING_WIDTH} numbers of the candidate's policy", va="center", fontsize=8.3, color=INK)


def _targets(axes: Axes, place: int) -> None:
    axes.plot(FUTURE_OFFSETS, [place] * len(FUTURE_OFFSETS), "o", color=HUES[3], markersize=6)
    text = f"{len(FUTURE_OFFSETS)} observations: six scalars, a trajectory"
    axes.text(FUTURE_OFFSETS[-1] / 2 + 2, place - 0.22, text, ha="center", va="bottom", fontsize=8.3, color=INK)
