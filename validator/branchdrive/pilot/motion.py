"""How recorded motion and recorded rates fit together, as ratios that name a wrong clock, unit or frame.

Over neighbouring observations before the first contact, with displacement ``d``, mean speed ``v``, mean yaw rate
``w``, mean longitudinal acceleration ``a`` and time ``dt``::

    ego displacement    |d| / (|v| dt)          where v moves
    ego turn            wrap(yaw_1 - yaw_0) / (w dt)
    ego speed change    (v_1 - v_0) / (a dt)
    actor displacement  d . u / |u|^2           with u the mean velocity times dt

All medians are 1 where clock, units and frames are right. A wrong clock moves all of them by one factor; a wrong unit
of a column moves those alone that read it; a mirrored axis turns the turn to -1.

Source: spec/02-time-frames-units.md, spec/05-raw-streams.md#motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.pilot.section import Concern
from branchdrive.raw.motion import OBSERVATION_S, before_contact, follows
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.tracks import tracks

__all__ = ["Direction", "Ratio", "diagnose", "direction_of", "motion_ratios"]

Array = NDArray[np.float64]

MIN_STEPS = 20
"""Steps between observations below which a ratio says nothing."""

_TOLERANCE = 0.1
"""Two ratios are one where their logarithms differ by less."""

_MOVING_MPS = 1.0
_TURNING_RADPS = 0.05
_ACCELERATING_MPS2 = 0.5

_UNITS = {
    3.6: ("km/h", "divide by 3.6"),
    2.236936: ("miles per hour", "divide by 2.237"),
    3.28084: ("feet per second", "divide by 3.281"),
    100.0: ("centimetres per second", "divide by 100"),
}
"""Units of speed that are taken for metres per second, by their number in one of these."""

_DEGREES = 180 / math.pi

_FOLLOWS = 0.95
"""Agreement from which motion follows a heading; cars slide and turn between observations."""

_STRAIGHT_RAD = 0.2


class Ratio(NamedTuple):
    """Median of a ratio that is 1 in a right recording.

    Attributes:
        name: What is compared.
        num_steps: Steps between observations that count.
        median: NaN where there are too few.
        low: First quartile, NaN alike.
        high: Third quartile, NaN alike.
    """

    name: str
    num_steps: int
    median: float
    low: float
    high: float

    @classmethod
    def of(cls, name: str, values: Array) -> Ratio:
        """Ratio of all steps."""
        values = values[np.isfinite(values)]
        if len(values) < MIN_STEPS:
            return cls(name, len(values), math.nan, math.nan, math.nan)
        low, median, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
        return cls(name, len(values), median, low, high)

    @property
    def is_known(self) -> bool:
        """Whether there were enough steps."""
        return math.isfinite(self.median)

    @property
    def is_mostly_wrong(self) -> bool:
        """Whether three quarters of the steps lie on one side of 1, beyond noise."""
        slack = math.exp(_TOLERANCE)
        return self.is_known and not self.low / slack <= 1 <= self.high * slack

    def near(self, value: float) -> bool:
        """Whether the median is `value` but for noise."""
        return self.is_known and self.median * value > 0 and abs(math.log(self.median / value)) < _TOLERANCE


class Direction(NamedTuple):
    """How the direction of motion relates to the heading.

    Attributes:
        num_steps: Steps that moved.
        off_rad: Mean angle from heading to motion.
        with_heading: How well motion follows the heading, 0 .. 1.
        against_heading: How well it follows the mirrored heading, 0 .. 1.
    """

    num_steps: int
    off_rad: float
    with_heading: float
    against_heading: float


@np.errstate(all="ignore")  # what overflows or is divided by zero is no number, and is left out
def motion_ratios(views: Sequence[ShardView]) -> dict[str, Ratio]:
    """Ratios over all shards, by name."""
    found: dict[str, list[Array]] = {"displacement": [], "turn": [], "speed change": [], "actor displacement": []}
    for view in views:
        for name, values in _ego_ratios(view).items():
            found[name].append(values)
        if "actors" in view:
            found["actor displacement"].append(_actor_ratios(view))
    return {name: Ratio.of(name, np.concatenate([np.zeros(0), *parts])) for name, parts in found.items()}


def _ego_ratios(view: ShardView) -> dict[str, Array]:
    x, y, yaw, speed, rate, accel = (
        view.observations[name].astype(np.float64)
        for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "yaw_rate_radps", "accel_longitudinal_mps2")
    )
    row = np.flatnonzero(_compared(view))
    way, turn = np.hypot(x[row] - x[row - 1], y[row] - y[row - 1]), wrap_rad(yaw[row] - yaw[row - 1])
    v, w, a = ((values[row] + values[row - 1]) / 2 for values in (speed, rate, accel))
    moves = np.abs(v) > _MOVING_MPS
    turns = moves & (np.abs(w) > _TURNING_RADPS)
    accelerates = np.abs(a) > _ACCELERATING_MPS2
    return {
        "displacement": (way / (np.abs(v) * OBSERVATION_S))[moves],
        "turn": (turn / (w * OBSERVATION_S))[turns],
        "speed change": ((speed[row] - speed[row - 1]) / (a * OBSERVATION_S))[accelerates],
    }


def _actor_ratios(view: ShardView) -> Array:
    stream = view.stream("actors")
    row, before, *_ = view.cached(tracks)
    free = _compared(view)[view.observations.rows_of(stream)[row]]
    row, before = row[(before >= 0) & free], before[(before >= 0) & free]
    moved = [stream[name][row] - stream[name][before] for name in ("x_m", "y_m")]
    recorded = [
        (stream[name][row].astype(np.float64) + stream[name][before]) / 2 * OBSERVATION_S
        for name in ("vel_x_mps", "vel_y_mps")
    ]
    squared = recorded[0] ** 2 + recorded[1] ** 2
    ratio = (moved[0] * recorded[0] + moved[1] * recorded[1]) / squared
    return np.asarray(ratio[squared > (_MOVING_MPS * OBSERVATION_S) ** 2])


def _compared(view: ShardView) -> NDArray[np.bool_]:
    """Observations that follow another one, both before any contact."""
    return follows(view.observations) & view.cached(before_contact)


@np.errstate(all="ignore")
def direction_of(views: Sequence[ShardView]) -> Direction:
    """Direction of motion against heading over all shards."""
    off, mirrored = [np.zeros(0)], [np.zeros(0)]
    for view in views:
        x, y, yaw = (view.observations[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad"))
        row = np.flatnonzero(_compared(view))
        dx, dy = x[row] - x[row - 1], y[row] - y[row - 1]
        middle = yaw[row - 1] + wrap_rad(yaw[row] - yaw[row - 1]) / 2
        there = (np.hypot(dx, dy) > _MOVING_MPS * OBSERVATION_S) & np.isfinite(middle)
        motion = np.arctan2(dy, dx)
        off.append((motion - middle)[there])
        mirrored.append((motion + middle)[there])
    sums = [np.exp(1j * np.concatenate(parts)) for parts in (off, mirrored)]
    if len(sums[0]) < MIN_STEPS:
        return Direction(len(sums[0]), math.nan, math.nan, math.nan)
    mean, other = (complex(part.mean()) for part in sums)
    return Direction(len(sums[0]), math.atan2(mean.imag, mean.real), abs(mean), abs(other))


def diagnose(ratios: dict[str, Ratio], direction: Direction) -> list[Concern]:
    """What ratios and direction together say is wrong."""
    way, turn, change, actor = (ratios[name] for name in ("displacement", "turn", "speed change", "actor displacement"))
    concerns = []
    others = [ratio for ratio in (turn, actor) if ratio.is_known]
    if way.is_known and not way.near(1):
        if others and all(other.near(way.median) for other in others):
            concerns.append(_wrong_clock(way.median))
        else:
            concerns.append(_wrong_speed("ego", "speed_mps", way))
            if actor.is_known and not actor.near(1):
                concerns.append(_wrong_speed("actors", "vel_x_mps and vel_y_mps", actor))
    elif actor.is_known and not actor.near(1):
        concerns.append(_wrong_speed("actors", "vel_x_mps and vel_y_mps", actor))
    if turn.is_known and not turn.near(1) and not (concerns and turn.near(way.median)):
        concerns.append(_wrong_turn(turn))
    is_off = abs(math.log(max(abs(change.median), 1e-9))) > math.log(1.5)
    if change.is_mostly_wrong and is_off and way.near(1):
        concerns.append(
            Concern(
                f"Speed changes by {change.median:.3g} times what accel_longitudinal_mps2 says.",
                "Record the acceleration of the last tick along the heading in m/s2, positive forwards: "
                f"(v_t - v_(t-1)) / {TICK_S:g} s.",
            )
        )
    return concerns + _wrong_direction(direction)


def _wrong_clock(factor: float) -> Concern:
    return Concern(
        f"Ego and actors move {factor:.3g} times as far as their speeds say, and turn {factor:.3g} times as far as "
        f"their yaw rates say: a recorded tick is {factor * TICK_S:.3g} s of the simulator, "
        f"{1 / (factor * TICK_S):.3g} Hz recorded as {1 / TICK_S:.0f} Hz.",
        f"Step the simulator by {TICK_S:g} s and write a control row for every step and an observation for every "
        "fifth; chapter 2 of the specification says what a simulator at another rate must do.",
    )


def _wrong_speed(who: str, columns: str, ratio: Ratio) -> Concern:
    unit = next(((name, how) for factor, (name, how) in _UNITS.items() if ratio.near(1 / factor)), None)
    verb = "say" if " and " in columns else "says"
    found = f"The displacement of {who} is {ratio.median:.3g} times what {columns} {verb}"
    if unit is not None:
        return Concern(f"{found}: the speed is in {unit[0]}, not m/s.", f"Record {columns} in m/s: {unit[1]}.")
    return Concern(
        f"{found}.",
        f"Record positions in metres and {columns} in m/s, both of the same tick; a factor of 2 or 0.5 is a clock "
        f"that does not run at {1 / TICK_S:.0f} Hz.",
    )


def _wrong_turn(turn: Ratio) -> Concern:
    if turn.median < 0:
        return Concern(
            f"The ego turns {turn.median:.3g} times as far as yaw_rate_radps says: one of heading and yaw rate has "
            "the contrary sign, as in a left-handed frame.",
            "Record both counter-clockwise positive, seen from above: negate the one that the simulator gives "
            "clockwise.",
        )
    if turn.near(1 / _DEGREES):
        return Concern(
            "The ego turns 1/57.3 of what yaw_rate_radps says: the yaw rate is in degrees per second.",
            "Record yaw_rate_radps in rad/s: multiply by pi / 180.",
        )
    if turn.near(_DEGREES):
        return Concern(
            "The ego turns 57.3 times as far as yaw_rate_radps says: the heading is in degrees.",
            "Record yaw_rad in radians in [-pi, pi]: multiply by pi / 180 and wrap.",
        )
    return Concern(
        f"The ego turns {turn.median:.3g} times as far as yaw_rate_radps says.",
        "Record yaw_rad in rad and yaw_rate_radps in rad/s, both of the same tick.",
    )


def _wrong_direction(direction: Direction) -> list[Concern]:
    if not math.isfinite(direction.with_heading):
        return []
    if direction.with_heading > _FOLLOWS:
        if abs(direction.off_rad) < _STRAIGHT_RAD:
            return []
        off = math.degrees(direction.off_rad)
        return [
            Concern(
                f"The ego moves {off:+.0f} degrees away from its heading throughout.",
                f"Record yaw_rad counter-clockwise from the x axis: add {off:+.0f} degrees, then wrap to [-pi, pi].",
            )
        ]
    if direction.against_heading > _FOLLOWS:
        return [
            Concern(
                "The ego moves along its heading mirrored at the x axis: positions and headings have contrary "
                "handedness.",
                "Mirror both or none: of a left-handed simulator negate y, yaw, yaw rate and lateral acceleration "
                "of the ego, of actors, of the route and of the map.",
            )
        ]
    return [
        Concern(
            f"The direction in which the ego moves has little to do with its heading (they agree by "
            f"{direction.with_heading:.2f} of 1).",
            "Record yaw_rad in radians, counter-clockwise from the x axis, of the same tick as the position.",
        )
    ]
