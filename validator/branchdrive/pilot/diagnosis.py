"""What wrong figures of motion mean: the unit, sign, clock or frame that a collector has wrong, and what to do.

Causes come before what follows from them: who moves along a wrong heading turns and slips wrongly, too.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping

from branchdrive.contract.timing import TICK_S
from branchdrive.driving.unit import WrongUnit, is_near, wrong_unit
from branchdrive.pilot.heading import Reading
from branchdrive.pilot.motion import Figure
from branchdrive.pilot.section import Concern
from branchdrive.raw.motion.quantity import OF_VEHICLE

__all__ = ["diagnose"]

_TOLERANCE = 0.1
"""Two ratios are one where their logarithms differ by less."""

_RATE_TOLERANCE = 0.4
"""The same of yaw rates, which change inside of a step: their slopes are smaller where steering is abrupt."""

_CLOCK_TOLERANCE = 0.02
"""The same of a clock, which moves all speeds by one factor."""

_SPEEDS = {
    "speed": ("the ego", "speed_mps"),
    "actor_speed": ("vehicles", "vel_x_mps and vel_y_mps"),
    "pedestrian_speed": ("pedestrians", "vel_x_mps and vel_y_mps"),
}
"""Whose speed a figure is of, and its columns."""

_OF_HEADING = {
    "heading": "the ego", "actor_heading": "vehicles", "actor_sense": "vehicles", "pedestrian_sense": "vehicles",
}  # fmt: skip
"""Whose heading a figure is of."""

_AFTER_HEADING = ("yaw_rate", "lateral", "lever", "pivot", "steering")
"""Figures that a wrong heading of the ego makes wrong, too."""


def diagnose(figures: Mapping[str, Figure], headings: Mapping[str, Reading], named: Collection[str]) -> list[Concern]:
    """What figures of motion, and readings of headings, say is wrong.

    Args:
        figures: Figures of motion by name.
        headings: Wrong readings of headings, by whose they are.
        named: Figures whose cause has been named.
    """
    wrong = {name: figure for name, figure in figures.items() if figure.is_wrong}
    concerns = [*_wrong_headings(headings), *_wrong_speeds(figures, wrong)]
    known = {*named, *_SPEEDS, *(name for name, who in _OF_HEADING.items() if who in headings)}
    if "the ego" in headings:
        known |= {*_AFTER_HEADING}
    if "pivot" in figures and len(figures["pivot"].values):
        known |= {"lever"}
    for name, figure in wrong.items():
        if name not in known and name not in OF_VEHICLE and not _is_of_clock(name, figure, wrong):
            concerns.append(_of_figure(name, figure))
    if not concerns and not named:  # a vehicle is compared by motion and commands, whose signs and units come first
        concerns += [_of_figure(name, figure) for name, figure in wrong.items() if name in OF_VEHICLE]
    return concerns


def _wrong_headings(headings: Mapping[str, Reading]) -> Iterator[Concern]:
    for reading in {reading.name: reading for reading in headings.values()}.values():
        whose = " and ".join(who for who, other in headings.items() if other.name == reading.name)
        yield Concern(
            f"Headings (yaw_rad) of {whose} are {reading.name}: read so, they fit the motion.",
            f"Record yaw_rad in radians, counter-clockwise from the x axis: {reading.remedy}; rates and accelerations "
            "that follow from it as well.",
        )


def _wrong_speeds(figures: Mapping[str, Figure], wrong: Mapping[str, Figure]) -> Iterator[Concern]:
    """Concerns of speeds, those of one cause together."""
    off = {name: wrong[name].median for name in _SPEEDS if name in wrong}
    by_unit: dict[WrongUnit | None, list[str]] = {}
    for name, ratio in off.items():
        by_unit.setdefault(wrong_unit(name, ratio), []).append(name)
    for unit, names in by_unit.items():
        found = " and ".join(f"{ratio:.3g} times those of the positions of {who}" for ratio, who in _ratios(off, names))
        columns = " and ".join(dict.fromkeys(_SPEEDS[name][1] for name in names))
        if unit is not None:
            verb = "are" if len(names) > 1 or " and " in columns else "is"
            yield Concern(
                f"Speeds are {found}: {columns} {verb} {unit.text}.",
                f"Record {columns} in m/s and positions in metres: {unit.remedy}.",
            )  # fmt: skip
        else:
            yield _wrong_clock(figures, {name: off[name] for name in names}, found, columns)


def _ratios(off: Mapping[str, float], names: list[str]) -> Iterator[tuple[float, str]]:
    return ((off[name], _SPEEDS[name][0]) for name in names)


def _wrong_clock(figures: Mapping[str, Figure], off: Mapping[str, float], found: str, columns: str) -> Concern:
    """Concern of speeds that differ from those of positions by no unit."""
    ratio = next(iter(off.values()))
    others = [figures[name].median for name in _SPEEDS if name in figures and len(figures[name].values)]
    if "speed" in off and ratio > 0 and all(is_near(other, ratio, 3 * _CLOCK_TOLERANCE) for other in others):
        tick_s, rate = TICK_S / ratio, figures["yaw_rate"].median
        turns = not is_near(1, ratio, _RATE_TOLERANCE) and is_near(rate, ratio, _RATE_TOLERANCE / 2)
        return Concern(
            f"Speeds are {found}: a recorded tick is {tick_s:.3g} s of the simulator, {1 / tick_s:.3g} Hz recorded as "
            f"{1 / TICK_S:g} Hz{', as turns say, too' if turns else ''}"
            + ("." if turns else f", or positions are {1 / ratio:.3g} times too large."),
            f"Step the simulator by {TICK_S:g} s for every recorded tick, and write a control row for each of them and "
            "an observation for every fifth; chapter 2 of the specification says what a simulator at another rate must "
            "do. Record positions in metres.",
        )
    return Concern(
        f"Speeds are {found}.",
        f"Record {columns} in m/s and positions in metres, both of the same body and of the same tick.",
    )


def _is_of_clock(name: str, figure: Figure, wrong: Mapping[str, Figure]) -> bool:
    """Whether a figure is off by the factor of a wrong clock, or of a wrong unit of speed."""
    speed = wrong.get("speed")
    if speed is None or name not in ("yaw_rate", "longitudinal", "lateral", "steering", "drive", "step"):
        return False
    return name == "step" or any(is_near(figure.median, speed.median**power, _TOLERANCE) for power in (-2, -1, 1, 2))


def _of_figure(name: str, figure: Figure) -> Concern:
    median, count = figure.median, figure.outside
    if name == "yaw_rate":
        return _wrong_yaw_rate(median, count)
    if name in ("longitudinal", "lateral"):
        return _wrong_acceleration(name, figure)
    if name == "heading":
        return Concern(
            f"The ego moves {median:+.0f} degrees away from its heading on straight ways, in {count}.",
            f"Record yaw_rad counter-clockwise from the x axis: add {math.radians(median):+.3g} rad, then wrap to "
            "[-pi, pi].",
        )
    if name in ("lever", "pivot"):
        return _wrong_point(name, figure)
    if name == "step":
        return Concern(
            f"Single steps are {100 * median:.0f} % of the way longer or shorter than their speeds say, though their "
            f"mean may be right, in {count}: the pose and the speed of an observation are of two moments, or the "
            "simulator goes on by another time at some ticks than at others.",
            f"Read pose and speed in one step of the simulator, and step it by {TICK_S:g} s for every recorded tick.",
        )
    if name in ("steering", "drive") and median < 0:
        what, how = {
            "steering": ("applied_steer", "positive steers to the right: negate the steering, or mirror the world"),
            "drive": ("applied_throttle", "throttle is what accelerates, brake what slows down"),
        }[name]
        return Concern(
            f"{what} acts in the contrary direction while the expert drives, in {count}.",
            f"Record commands so that {how}.",
        )
    quantity = figure.quantity
    return Concern(
        f"{quantity.table}.{quantity.column}: {quantity.text} is {median:.3g} in the median and outside of "
        f"{figure.limits} in {count}.",
        f"Look at unit, sign, frame and tick of {quantity.column}, and of what it is compared with (chapter 2 of the "
        "specification).",
    )


def _wrong_yaw_rate(ratio: float, count: str) -> Concern:
    unit = wrong_unit("yaw_rate", ratio)
    if ratio < 0:
        return Concern(
            f"yaw_rate_radps has the contrary sign of the turns of yaw_rad (slope {ratio:.3g}, in {count}); headings "
            "fit the motion, so that the yaw rate is clockwise.",
            "Record yaw_rate_radps counter-clockwise positive, seen from above: negate it.",
        )
    if unit is not None:
        return Concern(
            f"yaw_rate_radps is {ratio:.3g} times the turns of yaw_rad: it is {unit.text}.",
            f"Record yaw_rate_radps in rad/s: {unit.remedy}.",
        )
    return Concern(
        f"yaw_rate_radps is {ratio:.3g} times the turns of yaw_rad, in {count}.",
        "Record yaw_rad in rad and yaw_rate_radps in rad/s, both of the same tick.",
    )


def _wrong_acceleration(name: str, figure: Figure) -> Concern:
    column, ratio, count = figure.quantity.column, figure.median, figure.outside
    unit = wrong_unit(name, ratio)
    along = name == "longitudinal"
    of_what = "the change of speed" if along else "speed times turn"
    right = "(v_t - v_(t-1)) / 0.05 s, positive forwards" if along else "speed times yaw rate, positive to the left"
    if ratio < 0:
        return Concern(
            f"{column} has the contrary sign of {of_what} (slope {ratio:.3g}, in {count}).",
            f"Record {column} as {right}: negate it.",
        )
    if unit is not None:
        return Concern(
            f"{column} is {ratio:.3g} times {of_what}: it is {unit.text}.", f"Record {column} in m/s2: {unit.remedy}."
        )
    return Concern(
        f"{column} is {ratio:.3g} times {of_what}, in {count}.",
        f"Record {column} in m/s2, of the last tick: {right}.",
    )


def _wrong_point(name: str, figure: Figure) -> Concern:
    """Concern of a position that is not that of the centre of the box."""
    median, unit = figure.median, "m" if name == "lever" else "of the wheelbase"
    remedy = "Record the centre of the ego's box: `branchdrive.box_centre` moves a position there along the heading."
    if median > figure.quantity.most:
        place = (
            f"{median:.2f} {unit} ahead of the axle that does not slip: it is that of the front axle, or ahead of it"
        )
    elif median < -0.1:
        place = f"{-median:.2f} {unit} behind the point that does not slip, so that it is no centre of a box"
    else:
        place = f"at the axle that does not slip, {median:+.2f} {unit} ahead of it: it is that of the rear axle"
    return Concern(f"The recorded position of the ego lies {place} (in {figure.outside}).", remedy)
