"""How recorded motion and recorded rates fit together: the validator's figures of sign, unit and clock, over a pilot.

A figure has a value for every attempt that says something of it, and is wrong where nearly all of them lie outside of
the limits of the rule; in a pilot a single attempt counts. Where no turn is large enough for the figure of yaw rates,
steps with a large yaw rate are taken. One figure is of no rule: how far ahead of the point that does not slip the
recorded position lies. With the way ``s`` across the mean heading and the turn ``q`` of a step, it is the slope
``sum(s q) / sum(q q)`` of an attempt: 0 at a rear axle, and some way ahead of it at the centre of a box.

Source: spec/07-rules.md#calibration, spec/05-raw-streams.md#motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.pilot.pilot import Part
from branchdrive.raw.motion.calibration import MIN_RATE_RADPS, MIN_SPEED_MPS, MIN_STEPS, calibration
from branchdrive.raw.motion.contact import is_free
from branchdrive.raw.motion.quantity import OF_VEHICLE, QUANTITIES, Quantity
from branchdrive.raw.motion.residual import OBSERVATION_S, follows
from branchdrive.raw.rules.responses import prevails
from branchdrive.raw.shard_view import ShardView
from branchdrive.text.table import Column, Table

__all__ = ["Figure", "figure_table", "motion_figures"]

Array = NDArray[np.float64]

_LEVER = Quantity(
    "observations", "x_m", -0.3, math.inf, "metres from the point that does not slip ahead to the recorded position"
)
"""A position behind the axle that does not slip is of no box: 0.3 m leave room for slip and for noise."""

_MAX_ROLLING_MPS = 8.0
"""Speed up to which a rear axle does not slip; slip grows with the square of the speed."""


class Figure(NamedTuple):
    """What the attempts of a pilot say of a quantity.

    Attributes:
        quantity: What it is, and its limits.
        values: One for each attempt that says something.
    """

    quantity: Quantity
    values: Array

    @property
    def median(self) -> float:
        """NaN without attempts."""
        return float(np.median(self.values)) if len(self.values) else math.nan

    @property
    def num_outside(self) -> int:
        """Attempts outside of the limits."""
        return int(((self.values < self.quantity.least) | (self.values > self.quantity.most)).sum())

    @property
    def is_wrong(self) -> bool:
        """Whether nearly all attempts are outside."""
        return prevails(self.num_outside, len(self.values), least=1)

    @property
    def name(self) -> str:
        """The column that it is of."""
        return self.quantity.column + (" of actors" if self.quantity.table == "actors" else "")

    @property
    def outside(self) -> str:
        """How many attempts are outside, in words."""
        return f"{self.num_outside} of {len(self.values)} attempts"

    @property
    def limits(self) -> str:
        """Its limits, in words."""
        least, most = self.quantity.least, self.quantity.most
        return f"{least:g} or more" if math.isinf(most) else f"{least:g} to {most:g}"


def motion_figures(parts: Sequence[Part]) -> dict[str, Figure]:
    """Every figure of the validator, and the lever."""
    quantities = QUANTITIES | OF_VEHICLE
    found: dict[str, list[Array]] = {name: [] for name in quantities}
    for part in parts:
        whole = part.view.complete & ~part.examination.broken
        for name, values in part.view.cached(calibration).items():
            found[name].append(values[whole & np.isfinite(values)])
    if not sum(map(len, found["yaw_rate"])):
        found["yaw_rate"] = [_yaw_rate(part.view) for part in parts]
    levers = [_lever_m(part.view) for part in parts]
    figures = {name: (quantities[name], values) for name, values in found.items()} | {"lever": (_LEVER, levers)}
    return {name: Figure(quantity, np.concatenate([np.zeros(0), *v])) for name, (quantity, v) in figures.items()}


@np.errstate(all="ignore")  # what overflows is no number, and says nothing
def _yaw_rate(view: ShardView) -> Array:
    """Slope of the yaw rate on the turn, of attempts with large yaw rates."""
    stream, row = view.observations, _steps(view)
    yaw, rate = (stream[name].astype(np.float64) for name in ("yaw_rad", "yaw_rate_radps"))
    recorded = (rate[row] + rate[row - 1]) / 2
    turning = wrap_rad(yaw[row] - yaw[row - 1]) / OBSERVATION_S
    return _slope(view, row, recorded * turning, turning**2, np.abs(recorded) >= MIN_RATE_RADPS)


@np.errstate(all="ignore")
def _lever_m(view: ShardView) -> Array:
    """How far ahead of the point that does not slip the position lies, of attempts that turn slowly."""
    stream, row = view.observations, _steps(view)
    x, y, yaw = (stream[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad"))
    way_x, way_y, turn = x[row] - x[row - 1], y[row] - y[row - 1], wrap_rad(yaw[row] - yaw[row - 1])
    heading, speed_mps = yaw[row] - turn / 2, np.hypot(way_x, way_y) / OBSERVATION_S
    across = np.cos(heading) * way_y - np.sin(heading) * way_x
    turns = (speed_mps >= MIN_SPEED_MPS) & (speed_mps <= _MAX_ROLLING_MPS)
    return _slope(view, row, across * turn, turn**2, turns & (np.abs(turn) >= MIN_RATE_RADPS * OBSERVATION_S))


def _steps(view: ShardView) -> NDArray[np.intp]:
    """Rows of observations that follow another one, that no contact breaks."""
    return np.flatnonzero(follows(view.observations) & view.cached(is_free))


def _slope(view: ShardView, row: NDArray[np.intp], above: Array, below: Array, counts: NDArray[np.bool_]) -> Array:
    """Ratio of two sums over the steps that count, of the attempts with enough of them; at most six decimals."""
    counts = counts & np.isfinite(above) & np.isfinite(below)
    owner = view.observations.rollout[row][counts]
    steps = np.bincount(owner)
    upper, lower = (np.bincount(owner, values[counts])[steps >= MIN_STEPS] for values in (above, below))
    ratio = upper / lower
    return np.asarray(np.round(ratio[np.isfinite(ratio)], 6))


def figure_table(figures: Mapping[str, Figure]) -> Table:
    """All figures that attempts say something of."""
    rows = [
        [
            figure.name, figure.quantity.text, f"{len(figure.values):,}", f"{figure.median:.3f}",
            "{:.3f} to {:.3f}".format(*np.quantile(figure.values, (0.25, 0.75))), figure.limits,
            f"{figure.num_outside:,}" if figure.num_outside else "",
        ]
        for figure in figures.values() if len(figure.values)
    ]  # fmt: skip
    columns = [
        Column.name("Column"), Column("What is compared", is_text=True), Column("Attempts"),
        Column("Median"), Column("Middle half"), Column("Limits"), Column("Outside"),
    ]  # fmt: skip
    note = (
        "Medians over attempts, and the limits of the validator. Right is 1 of ways, of slopes on motion and of "
        "shares, 0 of angles, and what is above 0 of slopes on commands. 3.6 of the ways of a speed is km/h, "
        f"0.5 is {0.5 / TICK_S:g} Hz recorded as {1 / TICK_S:g} Hz; a negative slope is a contrary sign."
    )
    return Table("Sign, unit and clock", columns, rows, [note])
