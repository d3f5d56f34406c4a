"""Risk evidence: separation and projected time to collision from recorded boxes.

For an observation with ego box ``e`` and velocity ``v_e = v (cos yaw, sin yaw)``, and an actor ``a``:

* gap ``g_a``: oriented-box gap, 0 on overlap; in range where ``g_a <= 50 m``;
* relevant: vehicle, cycle, pedestrian; a static object where it meets the route corridor
  (ego half-width + 0.5 m around the route polyline);
* closing speed ``c_a = -(v_a - v_e) . n`` along the unit vector ``n`` between closest points;
* separation = min ``g_a``; time to collision = min ``g_a / c_a`` where ``c_a > 0.1 m/s``, 0 on overlap.

Both minima run over relevant actors in range and are unavailable where there is none.
Source: paper, "Recorded Modalities" and "Model Inputs and Targets"; spec/05-raw-streams.md#evidence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.box import Boxes, box_gap
from branchdrive.driving.route import polyline_box_distance_m

__all__ = [
    "CUTOFF_SLACK",
    "MIN_CLOSING_MPS",
    "RANGE_M",
    "FrameRisk",
    "PairRisk",
    "corridor_excess_m",
    "frame_risk",
    "least_of_frame",
    "pair_risk",
    "risk_candidates",
    "risk_evidence",
]

RANGE_M = 50.0
MIN_CLOSING_MPS = 0.1
CORRIDOR_MARGIN_M = 0.5
CUTOFF_SLACK = 1e-6
"""Distance from a cut-off within which either side of it is right."""
TOUCH_M = 1e-9
"""Gap that is 0 within rounding: boxes that are this near may count as touching."""

_PAIRS_AT_ONCE = 1 << 13
"""Pairs that are compared at once: intermediate arrays of 64 KiB stay in the cache."""

NO_ACTOR = np.iinfo(np.int64).max

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class PairRisk:
    """Every recorded pair of an observation and an actor, each field ``[pairs]``.

    Attributes:
        frame: Row of the pair's observation.
        actor_id: Recorded identity of the actor.
        gap_m: Oriented-box gap.
        closing_mps: Closing speed, 0 on overlap.
        corridor_m: Distance by which a static object stays outside the route corridor,
            negative inside and for every other class: relevant where ``<= 0``.
        is_vehicle: Vehicle or cycle.
        is_pedestrian: Pedestrian.
    """

    frame: Index
    actor_id: NDArray[np.int64]
    gap_m: Array
    closing_mps: Array
    corridor_m: Array
    is_vehicle: NDArray[np.bool_]
    is_pedestrian: NDArray[np.bool_]


@dataclass(frozen=True)
class FrameRisk:
    """A minimum over the pairs of each frame: value ``inf`` and `NO_ACTOR` where there is none."""

    value: Array
    actor_id: NDArray[np.int64]


def pair_risk(
    ego: Boxes,
    ego_speed_mps: Array,
    actors: Boxes,
    actor_vel_x_mps: Array,
    actor_vel_y_mps: Array,
    actor_id: NDArray[np.int64],
    is_vehicle: NDArray[np.bool_],
    is_pedestrian: NDArray[np.bool_],
    frame: Index,
    corridor_m: Array,
) -> PairRisk:
    """Gap and closing speed of every pair; `ego` has one row per frame, `actors` one per pair."""
    ego_vel_x, ego_vel_y = ego_speed_mps * np.cos(ego.yaw_rad), ego_speed_mps * np.sin(ego.yaw_rad)
    gap_m, closing_mps = np.empty(len(frame)), np.empty(len(frame))
    for start in range(0, len(frame), _PAIRS_AT_ONCE):
        here = slice(start, start + _PAIRS_AT_ONCE)
        at = frame[here]
        gap = box_gap(ego.take(at), actors.take(here))
        rel_x, rel_y = actor_vel_x_mps[here] - ego_vel_x[at], actor_vel_y_mps[here] - ego_vel_y[at]
        gap_m[here] = gap.gap_m
        closing_mps[here] = -(rel_x * gap.normal_x + rel_y * gap.normal_y)
    return PairRisk(frame, actor_id, gap_m, closing_mps, corridor_m, is_vehicle, is_pedestrian)


def corridor_excess_m(objects: Boxes, route_x_m: Array, route_y_m: Array, ego_width_m: Array | float) -> Array:
    """`PairRisk.corridor_m` of static objects along one route."""
    return polyline_box_distance_m(objects, route_x_m, route_y_m) - (ego_width_m / 2 + CORRIDOR_MARGIN_M)


def least_of_frame(value: Array, rows: NDArray[np.bool_], pairs: PairRisk, num_frames: int) -> Array:
    """Smallest value per frame over `rows`, ``inf`` where there is none."""
    least = np.full(num_frames, np.inf)
    np.minimum.at(least, pairs.frame[rows], value[rows])
    return least


def _minimum(value: Array, rows: NDArray[np.bool_], pairs: PairRisk, num_frames: int) -> FrameRisk:
    """Smallest value per frame over `rows`, with the lowest actor id among equal values."""
    best = least_of_frame(value, rows, pairs, num_frames)
    who = np.full(num_frames, NO_ACTOR)
    tied = rows & (value == best[pairs.frame])
    np.minimum.at(who, pairs.frame[tied], pairs.actor_id[tied])
    return FrameRisk(best, who)


def risk_candidates(pairs: PairRisk, slack: float = 0.0) -> dict[str, tuple[Array, NDArray[np.bool_]]]:
    """Value of every pair, and the pairs over which the minimum runs, for each kind of evidence.

    Kinds are ``separation``, ``ttc``, ``nearest_vehicle`` and ``nearest_pedestrian``.

    Args:
        pairs: All pairs.
        slack: Widens every cut-off by this much (negative narrows), to tell what lies on one.
    """
    in_range = pairs.gap_m <= RANGE_M + slack
    relevant = in_range & (pairs.corridor_m <= slack)
    closing = pairs.closing_mps > MIN_CLOSING_MPS - slack
    overlap = (pairs.gap_m == 0) | ((slack > 0) & (pairs.gap_m <= TOUCH_M) & ~closing)
    ttc = np.divide(pairs.gap_m, pairs.closing_mps, out=np.zeros_like(pairs.gap_m), where=closing & ~overlap)
    return {
        "separation": (pairs.gap_m, relevant),
        "ttc": (ttc, relevant & (closing | overlap)),
        "nearest_vehicle": (pairs.gap_m, in_range & pairs.is_vehicle),
        "nearest_pedestrian": (pairs.gap_m, in_range & pairs.is_pedestrian),
    }


def frame_risk(pairs: PairRisk, num_frames: int) -> dict[str, FrameRisk]:
    """Minimum over the candidates of each frame, for each kind of evidence; see `risk_candidates`.

    Args:
        pairs: All pairs.
        num_frames: Frames that `pairs.frame` indexes.
    """
    candidates = risk_candidates(pairs)
    return {name: _minimum(value, rows, pairs, num_frames) for name, (value, rows) in candidates.items()}


def closing_of(risk: FrameRisk, pairs: PairRisk) -> Array:
    """Closing speed of each frame's actor in `risk`, 0 where there is none."""
    closing = np.zeros(len(risk.value))
    chosen = pairs.actor_id == risk.actor_id[pairs.frame]
    closing[pairs.frame[chosen]] = pairs.closing_mps[chosen]
    return closing


def risk_evidence(
    observations: Mapping[str, NDArray[Any]],
    actors: Mapping[str, NDArray[Any]],
    *,
    ego_length_m: float,
    ego_width_m: float,
    route_x_m: NDArray[np.float64],
    route_y_m: NDArray[np.float64],
) -> dict[str, NDArray[Any] | np.ma.MaskedArray[Any, Any]]:
    """Evidence columns of one rollout, computed from its recorded columns.

    Args:
        observations: Columns ``tick``, ``x_m``, ``y_m``, ``yaw_rad``, ``speed_mps``, ticks unique.
        actors: Columns of the actors table; every tick is an observation's.
        ego_length_m: Ego box length as recorded.
        ego_width_m: Ego box width as recorded.
        route_x_m: Route polyline ``[vertices]``.
        route_y_m: Route polyline ``[vertices]``.

    Returns:
        Columns of the evidence table by name, one row per observation; masked where unavailable.

    Raises:
        ValueError: An actor row names a tick that has no observation.
    """
    ticks = np.asarray(observations["tick"], np.int64)
    order = np.argsort(ticks, kind="stable")
    num_frames = len(ticks)
    actor_ticks = np.asarray(actors["tick"], np.int64)
    position = np.searchsorted(ticks[order], actor_ticks)
    if num_frames == 0 or (ticks[order][np.minimum(position, num_frames - 1)] != actor_ticks).any():
        if len(actor_ticks):
            raise ValueError("every actor row needs an observation of the same tick")
        position = np.zeros(0, np.intp)
    frame = order[position]

    def double(columns: Mapping[str, NDArray[Any]], *names: str) -> list[Array]:
        return [np.asarray(columns[name], np.float64) for name in names]

    extents = [np.full(num_frames, float(extent_m)) for extent_m in (ego_length_m, ego_width_m)]
    ego = Boxes(*double(observations, "x_m", "y_m", "yaw_rad"), *extents)
    others = Boxes(*double(actors, "x_m", "y_m", "yaw_rad", "length_m", "width_m"))
    kind = np.asarray(actors["actor_class"], np.str_)
    vel_x_mps, vel_y_mps = double(actors, "vel_x_mps", "vel_y_mps")
    corridor_m = np.full(len(kind), -np.inf)
    if (kind == "static").any():
        # Static objects keep their place: equal boxes are measured once.
        objects, inverse = np.unique(np.stack(others, axis=1)[kind == "static"], axis=0, return_inverse=True)
        excess_m = corridor_excess_m(Boxes(*objects.T), np.asarray(route_x_m), np.asarray(route_y_m), ego_width_m)
        corridor_m[kind == "static"] = excess_m[inverse.ravel()]
    pairs = pair_risk(
        ego,
        np.asarray(observations["speed_mps"], np.float64),
        others,
        vel_x_mps,
        vel_y_mps,
        np.asarray(actors["actor_id"], np.int64),
        (kind == "vehicle") | (kind == "cycle"),
        kind == "pedestrian",
        frame,
        corridor_m,
    )
    risks = frame_risk(pairs, num_frames)
    columns: dict[str, NDArray[Any] | np.ma.MaskedArray[Any, Any]] = {
        "num_actors": np.bincount(frame, minlength=num_frames).astype(np.int32)
    }
    for name, suffix in (
        ("separation", "m"),
        ("ttc", "s"),
        ("nearest_vehicle", "gap_m"),
        ("nearest_pedestrian", "gap_m"),
    ):
        risk = risks[name]
        absent = ~np.isfinite(risk.value)
        columns[f"{name}_available"] = ~absent
        columns[f"{name}_{suffix}"] = np.ma.masked_array(np.where(absent, 0.0, risk.value), absent)
        if suffix != "gap_m":
            columns[f"{name}_actor_id"] = np.ma.masked_array(
                np.where(absent, 0, risk.actor_id).astype(np.int32), absent
            )
        if name == "nearest_vehicle":
            columns["nearest_vehicle_rel_speed_mps"] = np.ma.masked_array(closing_of(risk, pairs), absent)
    return columns
