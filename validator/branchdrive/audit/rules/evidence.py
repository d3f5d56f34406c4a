"""Evidence rules: recorded separation, time to collision and nearest actors recompute from the boxes.

A value within 1e-6 of a cut-off (range, closing speed, corridor) may fall on either side of it.
Source: paper III-D; spec/05-raw-streams.md#evidence.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from branchdrive.audit.check import Mask, SubjectCheck, rollout_rule
from branchdrive.audit.finding import Sighting, quote
from branchdrive.audit.view import ShardView
from branchdrive.derive.box import Boxes
from branchdrive.derive.risk import (
    CUTOFF_SLACK,
    MIN_CLOSING_MPS,
    RANGE_M,
    FrameRisk,
    PairRisk,
    corridor_excess_m,
    frame_risk,
    pair_risk,
)

Array = NDArray[np.float64]


def _pairs(view: ShardView) -> PairRisk:
    """Every actor row near its ego; `PairRisk.frame` indexes the view's observations."""
    observations, actors = view.observations, view.stream("actors")
    frame = observations.find(actors.rollout, actors.tick)
    rows = np.flatnonzero(frame >= 0)
    owner = observations.rollout
    safe = np.maximum(owner, 0)
    extents = (view.rollouts[name].astype(np.float64)[safe] for name in ("ego_length_m", "ego_width_m"))
    ego = Boxes(*(observations[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad")), *extents)
    boxes = Boxes(*(actors[name][rows].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad", "length_m", "width_m")))
    # Pairs whose centres are further apart than range and half diagonals can never matter.
    near = _can_matter(ego.take(frame[rows]), boxes)
    rows, boxes = rows[near], boxes.take(np.flatnonzero(near))
    codes, words = actors.words("actor_class")
    kind = np.array([*words, ""])[codes[rows]]
    return pair_risk(
        ego,
        observations["speed_mps"].astype(np.float64),
        boxes,
        actors["vel_x_mps"][rows].astype(np.float64),
        actors["vel_y_mps"][rows].astype(np.float64),
        actors["actor_id"][rows].astype(np.int64),
        kind,
        frame[rows],
        _corridor(view, actors.rollout[rows], boxes, kind == "static"),
    )


def _can_matter(ego: Boxes, actors: Boxes) -> Mask:
    reach = RANGE_M + 1.0 + (np.hypot(ego.length_m, ego.width_m) + np.hypot(actors.length_m, actors.width_m)) / 2
    return np.asarray((ego.x_m - actors.x_m) ** 2 + (ego.y_m - actors.y_m) ** 2 <= reach**2)


def _corridor(view: ShardView, owner: NDArray[np.int64], boxes: Boxes, is_static: Mask) -> Array:
    """Corridor excess of every pair; attempts that share route and ego width are measured together."""
    excess = np.full(len(owner), -np.inf)
    static = np.flatnonzero(is_static)
    if not len(static):
        return excess
    route_of: dict[tuple[bytes, bytes, float], int] = {}
    keys = []
    for x, y, width in zip(*(view.rollouts[c] for c in ("route_x_m", "route_y_m", "ego_width_m")), strict=True):
        keys.append(route_of.setdefault((x.tobytes(), y.tobytes(), float(width)), len(route_of)))
    route = np.array(keys)[owner[static]]
    for (x_bytes, y_bytes, width), index in route_of.items():
        rows = static[route == index]
        x, y = np.frombuffer(x_bytes), np.frombuffer(y_bytes)
        excess[rows] = corridor_excess_m(boxes.take(rows), np.ones(len(rows), bool), x, y, width)
    return excess


def _on_cutoff(pairs: PairRisk) -> bool:
    distances = (pairs.gap_m - RANGE_M, pairs.closing_mps - MIN_CLOSING_MPS, pairs.corridor_m)
    return any(bool((np.abs(distance) <= CUTOFF_SLACK).any()) for distance in distances)


def _readings(view: ShardView) -> list[dict[str, FrameRisk]]:
    """Recomputed evidence per observation, with the cut-offs as they are and, where it matters, moved by the slack."""
    pairs, num_frames = view.once(_pairs), len(view.observations)
    slacks = (0.0, -CUTOFF_SLACK, CUTOFF_SLACK) if _on_cutoff(pairs) else (0.0,)
    return [frame_risk(pairs, num_frames, slack) for slack in slacks]


def _close(recorded: Array, computed: Array, tolerance: float) -> Mask:
    """``|recorded - computed| <= tolerance (1 + |computed|)``."""
    finite = np.where(np.isfinite(computed), computed, 0.0)
    return np.asarray(np.abs(recorded - finite) <= tolerance * (1 + np.abs(finite)))


def _projected_s(pairs: PairRisk) -> Array:
    """Gap over closing speed of every pair; 0 on overlap, ``inf`` where nothing closes."""
    projected = np.where(pairs.gap_m == 0, 0.0, np.inf)
    return np.divide(pairs.gap_m, pairs.closing_mps, out=projected, where=(pairs.gap_m > 0) & (pairs.closing_mps > 0))


def _actor_value(view: ShardView, value: Array, frame: NDArray[np.int64], actor_id: NDArray[np.int64]) -> Array:
    """`value` of the pair that a frame's recorded actor forms, ``inf`` if there is no such pair."""
    pairs = view.once(_pairs)
    wanted = np.full(len(view.observations), -1, np.int64)
    wanted[frame] = actor_id
    hit = pairs.actor_id == wanted[pairs.frame]
    found = np.full(len(view.observations), np.inf)
    found[pairs.frame[hit]] = value[hit]
    return found[frame]


def _recomputes(view: ShardView, subjects: Mask, name: str, column: str) -> SubjectCheck:
    """Mask, value and actor of a minimum agree with one reading of the boxes."""
    evidence = view.stream("evidence")
    tolerance = view.descriptor.tolerances.evidence
    frame = view.observations.find(evidence.rollout, evidence.tick)
    rows = np.flatnonzero(frame >= 0)
    at = frame[rows]
    there = evidence[f"{name}_available"][rows].astype(bool)
    recorded = evidence[column][rows].astype(np.float64)
    agrees = []
    for reading in view.once(_readings):
        computed = reading[name].value[at]
        available = np.isfinite(computed)
        agrees.append((there == available) & (~there | _close(recorded, computed, tolerance)))
    sound = reduce(np.logical_or, agrees)
    if f"{name}_actor_id" in evidence:
        pairs = view.once(_pairs)
        value = pairs.gap_m if name == "separation" else _projected_s(pairs)
        own = _actor_value(view, value, at, evidence[f"{name}_actor_id"][rows].astype(np.int64))
        sound &= ~there | (np.isfinite(own) & _close(recorded, own, tolerance))
    bad = np.zeros(len(evidence), bool)
    bad[rows] = ~sound
    summary = evidence.by_rollout(bad)

    def text(available: bool, value: float) -> str:
        return quote(float(value)) if available else "unavailable"

    def describe(i: int) -> Sighting:
        row = int(summary.first_row[i])
        computed = view.once(_readings)[0][name]
        k = frame[row]
        expected = text(bool(np.isfinite(computed.value[k])), computed.value[k])
        found = text(bool(evidence[f"{name}_available"][row]), evidence[column][row])
        if f"{name}_actor_id" in evidence and expected == found:
            expected, found = f"actor {computed.actor_id[k]}", f"actor {evidence[f'{name}_actor_id'][row]}"
        return Sighting(
            expected,
            found,
            {"table": "evidence", "column": column, "tick": int(evidence.tick[row])},
            int(summary.count[i]),
        )

    return SubjectCheck(subjects, subjects & summary.any, describe)


@rollout_rule("BD-EVD-001")
def separation_recomputes(view: ShardView, subjects: Mask) -> SubjectCheck:
    """``separation_m`` = smallest gap to a relevant actor in range."""
    return _recomputes(view, subjects, "separation", "separation_m")


@rollout_rule("BD-EVD-002")
def ttc_recomputes(view: ShardView, subjects: Mask) -> SubjectCheck:
    """``ttc_s`` = smallest gap / closing speed over relevant closing actors in range, 0 on overlap."""
    return _recomputes(view, subjects, "ttc", "ttc_s")


@rollout_rule("BD-EVD-003")
def nearest_actors_recompute(view: ShardView, subjects: Mask) -> SubjectCheck:
    """Nearest vehicle and nearest pedestrian gaps recompute, and the vehicle's closing speed with its gap."""
    vehicle = _recomputes(view, subjects, "nearest_vehicle", "nearest_vehicle_gap_m")
    pedestrian = _recomputes(view, subjects, "nearest_pedestrian", "nearest_pedestrian_gap_m")
    speed = _rel_speed_recomputes(view, subjects)

    def describe(i: int) -> Sighting:
        return next(check for check in (vehicle, pedestrian, speed) if check.bad[i]).describe(i)

    return SubjectCheck(subjects, vehicle.bad | pedestrian.bad | speed.bad, describe)


def _rel_speed_recomputes(view: ShardView, subjects: Mask) -> SubjectCheck:
    """The recorded closing speed is that of a vehicle at the recorded gap."""
    evidence, pairs = view.stream("evidence"), view.once(_pairs)
    tolerance = view.descriptor.tolerances.evidence
    frame = view.observations.find(evidence.rollout, evidence.tick)
    row_of = np.full(len(view.observations), -1)
    row_of[frame[frame >= 0]] = np.flatnonzero(frame >= 0)
    owner = row_of[pairs.frame]
    there = evidence["nearest_vehicle_available"].astype(bool)
    fits = (owner >= 0) & pairs.is_vehicle
    fits &= _close(evidence["nearest_vehicle_gap_m"][owner], pairs.gap_m, tolerance)
    speeds = evidence["nearest_vehicle_rel_speed_mps"]
    matched = fits & _close(speeds[owner], pairs.closing_mps, tolerance)
    has_candidate = np.zeros(len(evidence), bool)
    has_candidate[owner[fits]] = True
    sound = np.zeros(len(evidence), bool)
    sound[owner[matched]] = True
    summary = evidence.by_rollout(there & has_candidate & ~sound)

    def describe(i: int) -> Sighting:
        row = int(summary.first_row[i])
        candidates = pairs.closing_mps[fits & (owner == row)]
        place: dict[str, str | int] = {
            "table": "evidence", "column": "nearest_vehicle_rel_speed_mps", "tick": int(evidence.tick[row]),
        }  # fmt: skip
        return Sighting(quote(float(candidates[0])), quote(float(speeds[row])), place, int(summary.count[i]))

    return SubjectCheck(subjects, subjects & summary.any, describe)
