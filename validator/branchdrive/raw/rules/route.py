"""Route rules: progress, offset, heading error and target points recompute from pose and polyline.

The polyline itself is that of a route which the nominal drives near, in its direction.
Source: spec/05-raw-streams.md#routes, #projection, #target-points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.timing import FUTURE_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.route import RoutePosition, project
from branchdrive.raw.motion.commanded_turns import commanded_turns
from branchdrive.raw.motion.route_state import (
    contradicts_route,
    has_judged_rows,
    misplaces_target_points,
    routes,
    target_progress,
)
from branchdrive.raw.motion.target_order import target_order
from branchdrive.raw.shard_view import ShardView

_MIN_DRIVEN = 8
"""Observations of two seconds of driving, below which a direction shows too little."""


def _position(view: ShardView, row: int, x_m: float, y_m: float) -> RoutePosition:
    """Where a world point lies on the route of an observation, each field ``[1]``."""
    lines = view.cached(routes)
    route_x, route_y = lines.polylines[lines.of_rollout[view.observations.rollout[row]]]
    return project(np.array([x_m]), np.array([y_m]), route_x, route_y)


def _of_observations(
    view: ShardView, subjects: Mask, contradicts: Mask, column: str, text: Callable[[int], tuple[str, str]]
) -> Check:
    summary = view.observations.by_rollout(contradicts)

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        place: dict[str, str | int] = {
            "table": "observations", "column": column, "tick": int(view.observations.tick[row]),
        }  # fmt: skip
        return Mismatch(place, *text(row), int(summary.count[i]))

    return Check.of_subjects(subjects, subjects & summary.any, describe, summary.stretch)


@rule("BD-RTE-001")
def route_state_recomputes(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``route_progress_m``, ``route_offset_m`` and ``route_heading_error_rad`` are those of a nearest foot."""
    observations = view.observations

    def text(row: int) -> tuple[str, str]:
        place = _position(view, row, observations["x_m"][row], observations["y_m"][row])
        error = float(wrap_rad(observations["yaw_rad"][row] - place.heading_rad)[0])
        found = (observations[f"route_{name}"][row] for name in ("progress_m", "offset_m", "heading_error_rad"))
        return _state(place.progress_m[0], place.offset_m[0], error), _state(*found)

    subjects = subjects & has_judged_rows(view)
    yield _of_observations(view, subjects, contradicts_route(view), "route_progress_m", text)


def _state(progress_m: float, offset_m: float, error_rad: float) -> str:
    return f"progress {progress_m:.3f} m, offset {offset_m:.3f} m, heading error {error_rad:.4f} rad"


@rule("BD-RTE-002")
def target_points_lie_ahead(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Target points are points of the polyline, in driving order from the ego's progress on."""
    observations = view.observations

    def text(row: int) -> tuple[str, str]:
        yaw = float(observations["yaw_rad"][row])
        parts = []
        for number in (1, 2):
            ahead, left = (float(observations[f"target_point_{number}_{axis}_m"][row]) for axis in ("x", "y"))
            x = observations["x_m"][row] + np.cos(yaw) * ahead - np.sin(yaw) * left
            y = observations["y_m"][row] + np.sin(yaw) * ahead + np.cos(yaw) * left
            place = _position(view, row, x, y)
            parts.append(f"{number} at {place.progress_m[0]:.3f} m, {abs(place.offset_m[0]):.3f} m off it")
        progress = float(observations["route_progress_m"][row])
        return f"points of the polyline, in order from {progress:.3f} m on", f"target point {', '.join(parts)}"

    subjects = subjects & has_judged_rows(view)
    yield _of_observations(view, subjects, misplaces_target_points(view), "target_point_1_x_m", text)


@rule("BD-RTE-004")
def target_points_follow_from_progress(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where an attempt, or its nominal, has come further, or is at the same place, target points are not behind."""
    order, progress = view.cached(target_order), view.cached(target_progress)
    observations, marked = view.observations, np.zeros(len(view.observations), bool)
    marked[order.row] = True
    place = dict(zip(order.row.tolist(), zip(order.other.tolist(), order.number.tolist(), strict=True), strict=True))

    def text(row: int) -> tuple[str, str]:
        other, number = place[row]
        at, target = (
            [float(values[i]) for i in (other, row)]
            for values in (observations["route_progress_m"], progress.least_m[number])
        )
        expected = (
            f"target point {number + 1} at progress {at[1]:.3f} m in order with {target[0]:.3f} m at {at[0]:.3f} m"
        )
        return expected, f"{target[1]:.3f} m"

    yield _of_observations(view, subjects & order.compared, marked, "target_point_1_x_m", text)


MIN_AWAY_RAD, MAX_NAMED_RAD = np.deg2rad(45.0), np.deg2rad(15.0)
"""How far a route turns that was not commanded, and how far one that was: forks and bends lie between them."""


@rule("BD-RTE-005")
def commands_are_those_of_the_route(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where the navigation commands left, the route does not turn right, and nowhere near to the left; or reverse."""
    observations, turns = view.observations, view.cached(commanded_turns)
    is_wrong = (turns.away_rad >= MIN_AWAY_RAD) & (turns.named_rad < MAX_NAMED_RAD)
    commanded, contradicts = (np.zeros(len(observations), bool) for _ in range(2))
    commanded[turns.first], contradicts[turns.first[is_wrong]] = True, True
    away_rad = dict(zip(turns.first.tolist(), turns.away_rad.tolist(), strict=True))
    other = {"left": "right", "right": "left"}

    def text(row: int) -> tuple[str, str]:
        side = str(observations["command"][row])
        return (
            f"a route that turns {side}, as commanded",
            f"{np.rad2deg(away_rad[row]):.0f} degrees to the {other[side]}",
        )

    subjects = subjects & observations.by_rollout(commanded).any
    yield _of_observations(view, subjects, contradicts, "command", text)


@rule("BD-RTE-003")
def nominal_drives_near_its_route(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The nominal is near the polyline around its branch, and does not drive against it."""
    observations, bounds = view.observations, physical_bounds()
    subjects = subjects & view.role("nominal") & has_judged_rows(view)
    offset_ticks = observations.tick - np.append(view.branch_tick, 0)[observations.rollout]
    rows = np.flatnonzero(
        np.append(subjects, False)[observations.rollout]
        & (offset_ticks >= PREDECESSOR_OFFSET)
        & (offset_ticks <= FUTURE_OFFSETS[-1])
    )
    is_far, drives, goes_along = (np.zeros(len(observations), bool) for _ in range(3))
    is_far[rows] = np.abs(observations["route_offset_m"][rows]) > bounds.route_distance_m
    drives[rows] = observations["speed_mps"][rows] > bounds.driving_mps
    goes_along[rows] = np.abs(observations["route_heading_error_rad"][rows]) < np.pi / 2
    far = _of_observations(
        view, subjects, is_far, "route_offset_m",
        lambda row: (
            f"the nominal within {bounds.route_distance_m:g} m of its route",
            f"{abs(float(observations['route_offset_m'][row])):.1f} m away from it",
        ),
    )  # fmt: skip
    against = observations.by_rollout(drives & ~goes_along)
    is_against = (against.count >= _MIN_DRIVEN) & ~observations.by_rollout(drives & goes_along).any

    def describe(i: int) -> Mismatch:
        place: dict[str, str | int] = {
            "table": "observations", "column": "route_heading_error_rad",
            "tick": int(observations.tick[against.first_row[i]]),
        }  # fmt: skip
        expected = "a nominal that drives in the direction of its route"
        found = f"heading errors above a right angle at all {against.count[i]} observations at which it drives"
        return Mismatch(place, expected, found, int(against.count[i]))

    yield Check.of_any(far, Check.of_subjects(subjects, subjects & is_against, describe))
