"""Physics, frames and units of a pilot, with numbers: residuals and their bounds, figures of motion, signs and sizes.

Source: spec/05-raw-streams.md#motion, #projection; spec/02-time-frames-units.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import NONE, counted
from branchdrive.contract.timing import TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.route import project
from branchdrive.pilot.diagnosis import diagnose
from branchdrive.pilot.extent import extents
from branchdrive.pilot.heading import headings_read
from branchdrive.pilot.motion import Figure, figure_table, motion_figures
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.raw.motion.contact import is_free
from branchdrive.raw.motion.residual import RELATIONS, Relation, displacement, lateral, longitudinal, turn
from branchdrive.raw.motion.route_state import routes
from branchdrive.raw.motion.tracks import actor_displacements
from branchdrive.raw.rules.responses import MIN_INTERVENTIONS, SHARE_PERCENT
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView
from branchdrive.text.table import Column, Table

__all__ = ["physics"]

Array = NDArray[np.float64]

_OF_COMMANDS = {"steering": "applied_steer", "drive": "applied_throttle"}
"""Figures of the same sign as that of interventions, and its column."""

_OF_MOTION = ("BD-MOT", "BD-ACT", "BD-RTE", "BD-EVD", "BD-RES", "BD-MAP", "BD-RSP-001", "BD-RSP-006", "BD-RSP-007")
_OF_SIZES = ("BD-BOX", "BD-ACT", "BD-EVD", "BD-RES")
"""Rules, by the beginnings of their ids, that wrong motion and wrong sizes make fail."""

_PERIODS = (20, 10, 5, 4, 3, 2)
"""Periods of commands that are looked for, ticks."""

_MIN_CHANGES = 100
"""Changes of commands below which their period says nothing."""


_NAMES: Mapping[Callable[[ShardView], Relation], tuple[str, str]] = {
    displacement: ("ego displacement", "m"),
    turn: ("ego turn", "rad"),
    longitudinal: ("longitudinal acceleration", "m/s2"),
    lateral: ("lateral acceleration", "m/s2"),
}
"""Names and units of the residuals of the ego."""


class _Residual(NamedTuple):
    """A residual of rows of a stream, NaN where none is compared, and the bound of each row."""

    rule: str
    name: str
    unit: str
    stream: StreamView
    values: Array
    bound: Array


def physics(pilot: Pilot) -> Section:
    """Residuals against their bounds, figures that name clock and unit, signs of the actuators, sizes of boxes."""
    title = "Physics, frames and units"
    if not pilot.parts:
        return Section("physics", title, not_examined=[pilot.unread])
    views = [part.view for part in pilot.parts]
    table, residuals = _residual_table(views)
    figures = motion_figures(pilot.parts)
    steering = figures["steering"]
    is_contrary = steering.is_wrong and steering.median < 0
    headings = headings_read(pilot.parts, is_steering_contrary=is_contrary)
    still = [f"{figure.name} ({figure.quantity.text})" for figure in figures.values() if not len(figure.values)]
    unknown = [f"{'; '.join(still)}: no attempt has enough motion of the kind"] if still else []
    sign_facts, sign_concerns, unsure, signs = _signs(pilot)
    contrary = [name for name, column in _OF_COMMANDS.items() if any(column in c.what for c in sign_concerns)]
    motion = diagnose(figures, headings, contrary)
    concerns = list(motion)
    sizes = extents(views)
    periods = _command_period(views)
    facts = [*(() if motion else _lever_facts(figures["lever"])), *sign_facts]
    if not (motion or sign_concerns or sizes.concerns):
        concerns += _in_part(pilot)
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
        [table, figure_table(figures), sizes.table],
        [*unknown, *unsure],
        {
            "residuals": residuals,
            "figures": {
                name: {
                    "attempts": len(figure.values),
                    "median": figure.median if len(figure.values) else None,
                    "outside": figure.num_outside,
                    "limits": [
                        figure.quantity.least,
                        figure.quantity.most if math.isfinite(figure.quantity.most) else None,
                    ],
                }
                for name, figure in figures.items()
            },
            "headings": {who: reading.name for who, reading in headings.items()},
            "signs": signs,
            "extents": sizes.figures,
            "command_period_ticks": periods,
        },
        explains=_explained(has_motion=bool(motion), has_signs=bool(sign_concerns), has_sizes=bool(sizes.concerns)),
    )


def _in_part(pilot: Pilot) -> Iterator[Concern]:
    """What rules find in some attempts alone, so that no figure of the pilot is wrong in nearly all of them."""
    failing = [
        t for t in pilot.report.tallies if t.num_findings and t.rule_id.startswith(("BD-MOT", "BD-ACT", "BD-BOX"))
    ]
    if failing:
        found = ", ".join(f"{tally.rule_id} ({tally.num_findings:,} of {tally.examined:,})" for tally in failing)
        yield Concern(
            f"Not all attempts hold what figures of the whole pilot do: {found}.",
            "Look at the findings of these rules, and for what their attempts have in common: a shard, a drive, a "
            "scenario type. Part of the pilot may have been recorded or exported otherwise than the rest.",
            is_problem=False,
        )


def _explained(*, has_motion: bool, has_signs: bool, has_sizes: bool) -> set[str]:
    """Rules that fail for what concerns of motion, signs and sizes name."""
    areas = (*(_OF_MOTION if has_motion else ()), *(_OF_SIZES if has_sizes else ()))
    rules = {rule_id for rule_id in CATALOGUE if rule_id.startswith(areas)} if areas else set()
    return rules | ({"BD-RSP-001"} if has_signs else set())


def _residuals(view: ShardView) -> Iterator[_Residual]:
    observations, bounds, free = view.observations, physical_bounds(), view.cached(is_free)
    for rule_id, relations in RELATIONS.items():
        for relation in relations:
            name, unit = _NAMES[relation]
            judged = view.cached(relation)
            values = np.where(free, judged.residual, np.nan)
            yield _Residual(rule_id, name, unit, observations, values, judged.most)
    if "actors" in view:
        stream = view.stream("actors")
        steps = view.cached(actor_displacements)
        values, most = np.full(len(stream), np.nan), np.ones(len(stream))
        is_judged = free[observations.rows_of(stream)[steps.row]]
        values[steps.row], most[steps.row] = np.where(is_judged, steps.residual_m, np.nan), steps.most_m
        yield _Residual("BD-ACT-004", "actor displacement", "m", stream, values, most)
    every = np.ones(len(observations))
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
            rows.append([name, rule, *[NONE] * 5, ""])
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


def _lever_facts(lever: Figure) -> list[str]:
    if not len(lever.values):
        return []
    return [
        f"In slow turns the ego's recorded position swings like a point {lever.median:.2f} m ahead of one that does "
        f"not slip (median of {counted(len(lever.values), 'attempt')}). The rear axle is one that does not, and the "
        "centre of a box lies some way ahead of it; 0 m is the axle itself, or a vehicle that is modelled as a point."
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
