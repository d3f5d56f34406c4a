"""Physics, frames and units of a pilot, with numbers: residuals and their bounds, clock, signs and sizes.

Source: spec/05-raw-streams.md#motion, #projection; spec/02-time-frames-units.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.text import NONE, counted
from branchdrive.contract.timing import TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.route import project
from branchdrive.pilot.extent import extents
from branchdrive.pilot.motion import Direction, Ratio, diagnose, direction_of, motion_ratios
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.raw.motion import displacement_m, lateral_mps2, longitudinal_mps2, max_displacement_m, turn_rad
from branchdrive.raw.route_state import routes
from branchdrive.raw.rules.responses import MIN_INTERVENTIONS, SHARE_PERCENT
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.tracks import actor_displacement_m
from branchdrive.tables.view import StreamView
from branchdrive.text.table import Column, Table

__all__ = ["physics"]

Array = NDArray[np.float64]

_PERIODS = (20, 10, 5, 4, 3, 2)
"""Periods of commands that are looked for, ticks."""

_MIN_CHANGES = 100
"""Changes of commands below which their period says nothing."""


class _Residual(NamedTuple):
    """A residual of rows of a stream, NaN where none is compared, and the bound of each row."""

    rule: str
    name: str
    unit: str
    stream: StreamView
    values: Array
    bound: Array


def physics(pilot: Pilot) -> Section:
    """Residuals against their bounds, ratios that name clock and unit, signs of the actuators, sizes of boxes."""
    title = "Physics, frames and units"
    if not pilot.parts:
        return Section("physics", title, not_examined=[pilot.unread])
    views = [part.view for part in pilot.parts]
    table, residuals = _residual_table(views)
    ratios, direction = motion_ratios(views), direction_of(views)
    concerns = diagnose(ratios, direction)
    unknown = [
        f"{ratio.name}: {counted(ratio.num_steps, 'step')} in motion, too few to compare"
        for ratio in ratios.values()
        if not ratio.is_known
    ]
    sign_facts, sign_concerns, unsure, signs = _signs(pilot)
    sizes = extents(views)
    periods = _command_period(views)
    facts = [*_direction_facts(direction), *sign_facts]
    if periods > 1:
        concerns.append(
            Concern(
                f"The expert's commands change at every {periods}th tick only: {1 / (periods * TICK_S):g} Hz in a "
                f"table of {1 / TICK_S:.0f} Hz.",
                f"Nothing, where the expert decides at that rate by design. Otherwise the simulator runs at "
                f"{1 / (periods * TICK_S):g} Hz and its rows were repeated: step it by {TICK_S:g} s.",
                is_problem=False,
            )
        )
    return Section(
        "physics",
        title,
        facts,
        [*concerns, *sign_concerns, *sizes.concerns],
        [table, _ratio_table(ratios), sizes.table],
        [*unknown, *unsure],
        {
            "residuals": residuals,
            "ratios": {ratio.name: ratio.median if ratio.is_known else None for ratio in ratios.values()},
            "off_heading_rad": direction.off_rad if math.isfinite(direction.off_rad) else None,
            "signs": signs,
            "extents": sizes.figures,
            "command_period_ticks": periods,
        },
    )


def _residuals(view: ShardView) -> Iterator[_Residual]:
    observations, bounds = view.observations, physical_bounds()
    every = np.ones(len(observations))
    speed = observations["speed_mps"].astype(np.float64)
    yield _Residual(
        "BD-MOT-001", "ego displacement", "m", observations, displacement_m(view),
        max_displacement_m(speed, np.roll(speed, 1)),
    )  # fmt: skip
    yield _Residual("BD-MOT-002", "ego turn", "rad", observations, turn_rad(view), every * bounds.turn_rad)
    for name, values in (
        ("longitudinal acceleration", longitudinal_mps2(view)),
        ("lateral acceleration", lateral_mps2(view)),
    ):
        yield _Residual("BD-MOT-003", name, "m/s2", observations, values, every * bounds.acceleration_mps2)
    if "actors" in view:
        stream = view.stream("actors")
        rows, residual, way = actor_displacement_m(view)
        values, most = np.full(len(stream), np.nan), np.ones(len(stream))
        values[rows], most[rows] = residual, bounds.displacement_m + bounds.displacement_share * way
        yield _Residual("BD-ACT-004", "actor displacement", "m", stream, values, most)
    progress, offset, heading = _route_residuals(view)
    yield _Residual("BD-RTE-001", "route progress", "m", observations, progress, every * bounds.route_tolerance_m)
    yield _Residual("BD-RTE-001", "route offset", "m", observations, offset, every * bounds.route_tolerance_m)
    yield _Residual("BD-RTE-001", "heading error", "rad", observations, heading, every * bounds.route_tolerance_rad)


def _route_residuals(view: ShardView) -> tuple[Array, Array, Array]:
    """How far recorded route states are from the nearest foot, ``[observations]``, NaN without a route.

    Where another foot is as near, as where a route crosses itself, the larger residual may be of no fault.
    """
    observations, lines = view.observations, view.cached(routes)
    of_row = np.append(np.where(view.branched, lines.of_rollout, -1), -1)[observations.rollout]
    x, y, yaw, progress, offset, error = (
        observations[name].astype(np.float64)
        for name in ("x_m", "y_m", "yaw_rad", "route_progress_m", "route_offset_m", "route_heading_error_rad")
    )
    found = [np.full(len(observations), np.nan) for _ in range(3)]
    for number, (route_x, route_y) in enumerate(lines.polylines):
        rows = np.flatnonzero((of_row == number) & np.isfinite(x) & np.isfinite(y))
        if not len(rows):
            continue
        foot = project(x[rows], y[rows], route_x, route_y)
        for values, residual in zip(
            found,
            (
                foot.progress_m - progress[rows],
                foot.offset_m - offset[rows],
                wrap_rad(yaw[rows] - foot.heading_rad - error[rows]),
            ),
            strict=True,
        ):
            values[rows] = np.abs(residual)
    return found[0], found[1], found[2]


@np.errstate(all="ignore")  # what overflows is beyond any bound
def _residual_table(views: list[ShardView]) -> tuple[Table, dict[str, dict[str, Any]]]:
    found: dict[tuple[str, str, str], list[tuple[ShardView, _Residual]]] = {}
    for view in views:
        for residual in _residuals(view):
            found.setdefault((residual.rule, residual.name, residual.unit), []).append((view, residual))
    rows = []
    figures: dict[str, dict[str, Any]] = {}
    for (rule, name, unit), parts in found.items():
        values = np.concatenate([residual.values for _, residual in parts])
        bound = np.concatenate([residual.bound for _, residual in parts])
        there = ~np.isnan(values)
        if not there.any():
            rows.append([name, rule, *[NONE] * 4, ""])
            figures[name] = {"rule": rule, "unit": unit, "compared": 0}
            continue
        worst = int(np.nanargmax(values / bound))
        beyond = int((values > bound).sum())
        median, upper = np.quantile(values[there], (0.5, 0.99)).tolist()
        rows.append(
            [
                f"{name}, {unit}", rule, f"{there.sum():,}", _short(median), _short(upper), _short(values[worst]),
                _short(bound[worst]), f"{beyond:,}" if beyond else "",
            ]
        )  # fmt: skip
        figures[name] = {
            "rule": rule,
            "unit": unit,
            "compared": int(there.sum()),
            "median": median,
            "q99": upper,
            "largest": float(values[worst]),
            "bound": float(bound[worst]),
            "beyond": beyond,
            "at": _place(parts, worst),
        }
    columns = [
        Column.name("Residual"), Column("Rule", is_text=True), *map(Column, ("Compared", "Median", "99 %", "Largest")),
        Column("Bound"), Column("Beyond"),
    ]  # fmt: skip
    note = (
        "How far recorded columns are from what the others say; the bound is that of the rule. Route states are"
        " compared with the nearest point of the polyline over whole attempts, the rule judges the window."
    )
    return Table("Residuals", columns, rows, [note]), figures


def _place(parts: list[tuple[ShardView, _Residual]], row: int) -> str:
    for view, residual in parts:
        if row < len(residual.values):
            owner = int(residual.stream.rollout[row])
            return f"{view.rollout_ids[owner]} tick {int(residual.stream.tick[row])}" if owner >= 0 else NONE
        row -= len(residual.values)
    return NONE


def _short(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else NONE


def _ratio_table(ratios: dict[str, Ratio]) -> Table:
    columns = [
        Column.name("Recorded motion / what rates say"), Column("Steps"), Column("Median"), Column("Middle half"),
    ]  # fmt: skip
    rows = [
        [
            f"{'ego ' if 'actor' not in ratio.name else ''}{ratio.name}",
            f"{ratio.num_steps:,}",
            f"{ratio.median:.3f}" if ratio.is_known else NONE,
            f"{ratio.low:.3f} to {ratio.high:.3f}" if ratio.is_known else NONE,
        ]
        for ratio in ratios.values()
    ]
    note = (
        "1 where clock, units and frames are right. 2 in all rows: 10 Hz recorded as 20 Hz. 0.278 in displacement"
        " alone: km/h. -1 in turn: a mirrored heading or yaw rate."
    )
    return Table("Clock and units", columns, rows, [note])


def _direction_facts(direction: Direction) -> list[str]:
    if not math.isfinite(direction.with_heading):
        return []
    return [
        f"The ego moves {math.degrees(direction.off_rad):+.1f} degrees off its heading on average over "
        f"{counted(direction.num_steps, 'step')}; directions agree by {direction.with_heading:.3f} of 1."
    ]


class _Sign(NamedTuple):
    column: str
    effect: str
    agreement: Array
    mistake: str
    remedy: str


def _signs(pilot: Pilot) -> tuple[list[str], list[Concern], list[str], dict[str, dict[str, int]]]:
    """Facts, concerns, what is unsure, and counts of the signs of steering and of throttle."""
    every = pilot.responses()
    facts, concerns, unsure, figures = [], [], [], {}
    for sign in (
        _Sign(
            "applied_steer", "steering to the right moves the vehicle to the right", every.steering,
            "the world is mirrored, or steering has the contrary sign",
            "If x, y and yaw come from a left-handed simulator, negate y, yaw, yaw rate and lateral acceleration of "
            "ego, actors, route and map, and nothing else. If the frame is right-handed, negate the steering: "
            "positive steers to the right.",
        ),
        _Sign(
            "applied_throttle", "more throttle or less brake makes it faster", every.driving,
            "throttle and brake are exchanged, or have the contrary sign",
            "Record throttle and brake in [0, 1], throttle as what accelerates and brake as what slows down.",
        ),
    ):  # fmt: skip
        agree, contrary = int((sign.agreement > 0).sum()), int((sign.agreement < 0).sum())
        figures[sign.column] = {"agree": agree, "contrary": contrary}
        if agree + contrary < MIN_INTERVENTIONS:
            unsure.append(
                f"sign of {sign.column}: {counted(agree + contrary, 'intervention')} with an effect of that actuator "
                f"alone, fewer than {MIN_INTERVENTIONS}"
            )
            continue
        facts.append(f"{sign.column}: {sign.effect} in {agree} of {agree + contrary} interventions.")
        if 100 * contrary >= SHARE_PERCENT * (agree + contrary):
            what = f"{sign.column} acts in the contrary direction in {contrary} of {agree + contrary} interventions"
            concerns.append(Concern(f"{what}: {sign.mistake}.", sign.remedy))
        elif 100 * agree < SHARE_PERCENT * (agree + contrary):
            concerns.append(
                Concern(
                    f"{sign.column} acts in the contrary direction in {contrary} of {agree + contrary} interventions, "
                    "and as it should in the others.",
                    "Look at one of each: an effect that something else decides, such as a collision or a controller "
                    "beside the commands, hides what the action does.",
                    is_problem=False,
                )
            )
    return facts, concerns, unsure, figures


def _command_period(views: list[ShardView]) -> int:
    """The longest period of which all changes of the expert's commands are a multiple apart, in ticks; 1 for none."""
    changes = []
    for view in views:
        stream = view.controls
        columns = [stream[f"expert_{name}"] for name in ("steer", "throttle", "brake")]
        changed = np.logical_or.reduce([np.diff(values, prepend=values[:1]) != 0 for values in columns])
        changed &= np.diff(stream.rollout, prepend=-1) == 0
        changes.append((stream.rollout[changed], stream.tick[changed]))
    return next((period for period in _PERIODS if _fits(changes, period)), 1)


def _fits(changes: list[tuple[NDArray[np.int64], NDArray[np.int64]]], period: int) -> bool:
    num_changes = sum(len(ticks) for _, ticks in changes)
    modal = 0
    for owners, ticks in changes:
        counts = np.zeros((int(owners.max(initial=0)) + 1, period), np.int64)
        np.add.at(counts, (owners, ticks % period), 1)
        modal += int(counts.max(axis=1).sum())
    return num_changes >= _MIN_CHANGES and modal == num_changes
