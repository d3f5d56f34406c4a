"""How figures look, and how they become files: the same bytes for the same figure on one machine."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, Literal

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive_reference.drawing.palette import BACKDROP

__all__ = ["HUES", "INK", "QUIET", "WARNING", "axes_of", "new_figure", "render"]

_FORMATS: tuple[Literal["png", "svg"], ...] = ("png", "svg")

INK, QUIET, WARNING = BACKDROP["ink"], BACKDROP["quiet"], "#a33a00"

HUES = ("#0072b2", "#d55e00", "#009e73", "#b5478f", "#e69f00", "#56b4e9", "#8c6d1f", "#6a51a3")
"""Colours that readers with any common colour vision tell apart, Okabe and Ito first."""

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": "#e3e5e8",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "svg.hashsalt": "branchdrive",
    "text.parse_math": False,
}
_METADATA: dict[str, dict[str, str | None]] = {"png": {"Software": None}, "svg": {"Date": None, "Creator": None}}
_DPI = 150
_LINE_IN = 0.18
_BOTTOM_IN = 0.08
_LETTERS_PER_IN = 14.5
"""Of small letters, with some room: the font is not monospaced."""


def new_figure(width_in: float, height_in: float, heading: str, remarks: str, warnings: Sequence[str] = ()) -> Figure:
    """An empty figure with a heading, and remarks in small letters below it, then what every table warns of.

    The figure grows by the lines of the warnings.
    """
    lines = [line for warning in warnings for line in textwrap.wrap(warning, round(_LETTERS_PER_IN * width_in))]
    top_in = 0.72 + _LINE_IN * len(lines)
    height_in += _LINE_IN * len(lines)
    figure = Figure(figsize=(width_in, height_in), dpi=_DPI, facecolor="white", layout="constrained")
    bottom = _BOTTOM_IN / height_in
    inner = (0.01, bottom, 0.98, 1 - bottom - top_in / height_in)
    figure.get_layout_engine().set(rect=inner, wspace=0.06, hspace=0.08)  # type: ignore[union-attr, call-arg]
    figure.text(0.015, 1 - 0.24 / height_in, heading, fontsize=13, fontweight="bold", color=INK, va="center")
    for row, (line, colour) in enumerate([(remarks, QUIET), *((line, WARNING) for line in lines)]):
        place = 1 - (0.5 + _LINE_IN * row) / height_in
        figure.text(0.015, place, line, fontsize=8.6, color=colour, va="center")
    return figure


def axes_of(figure: Figure, num_rows: int, num_columns: int, **options: Any) -> list[Axes]:
    """Axes in a grid, row by row, with a grid of lines behind their values."""
    found = figure.subplots(num_rows, num_columns, squeeze=False, **options)
    for axes in found.ravel():
        axes.set_axisbelow(True)
    return list(found.ravel())


def render(draw: Callable[[], Figure]) -> dict[str, bytes]:
    """The bytes of a figure in every format; they carry no date and no version."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)
        figure, files = draw(), {kind: io.BytesIO() for kind in _FORMATS}
        _settle(figure)
        for kind, content in files.items():
            figure.savefig(content, format=kind, metadata=_METADATA[kind])
        return {kind: content.getvalue() for kind, content in files.items()}


def _settle(figure: Figure) -> None:
    """Lay out once and round: the solver's last bits differ from run to run, and names in an SVG hang on them.

    No layout engine is left, not even the one that does nothing: saving would draw twice for it.
    """
    figure.get_layout_engine().execute(figure)  # type: ignore[union-attr]
    figure.set_layout_engine(None)
    for axes in figure.axes:
        left, bottom, width, height = axes.get_position(original=True).bounds
        axes.set_position((round(left, 5), round(bottom, 5), round(width, 5), round(height, 5)))
