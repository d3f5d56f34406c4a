"""What a drive came to: events, share of the route, driving score, comfort, interventions.

The driving score has the form of the CARLA leaderboard::

    score = share of the route * (1 - share of the way off road) * product of penalty^count

with the penalties 0.50 for a collision with a pedestrian, 0.60 with a vehicle or cycle, 0.65 with something static,
0.70 for a red light and 0.80 for a stop sign. It is no score of that leaderboard: routes, traffic and rules are others.

Comfort is that of the targets, over the drive from the branch to its end. Source: CARLA leaderboard 1.0, "Evaluation
and metrics".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.target import STEP_S
from branchdrive_reference.closed_loop.course import Driven

__all__ = ["PENALTIES", "driving_score", "outcome_of"]

PENALTIES: Mapping[str, float] = {
    "pedestrian_collisions": 0.50,
    "vehicle_collisions": 0.60,
    "static_collisions": 0.65,
    "red_light_infractions": 0.70,
    "stop_sign_infractions": 0.80,
}
"""Factor of the score for each event, by its count."""


def driving_score(route_fraction: float, off_road_share: float, counts: Mapping[str, int | None]) -> float:
    """The score in ``[0, 1]``; an event that the world does not monitor takes nothing.

    Args:
        route_fraction: Share of the route that was driven.
        off_road_share: Share of the way that was off the road.
        counts: Events by the names of `PENALTIES`.
    """
    score = route_fraction * (1.0 - off_road_share)
    for name, penalty in PENALTIES.items():
        score *= penalty ** (counts.get(name) or 0)
    return score


def outcome_of(driven: Driven, branch_tick: int, bank: ActionBank) -> dict[str, Any]:
    """A drive as JSON data.

    Args:
        driven: The drive.
        branch_tick: Tick of the branch.
        bank: Candidates.

    Raises:
        KeyError: The record has no evidence.
    """
    record, first = driven.record, branch_tick // OBSERVATION_STRIDE_TICKS
    observations, evidence, fields = record.observations, record.evidence, record.fields
    counts = {name: fields.get(f"result_num_{name}") for name in (*PENALTIES, "off_road_infractions")}
    counts = {name: None if count is None else int(count) for name, count in counts.items()}
    x, y, yaw, speed = (np.asarray(observations[name], np.float64) for name in ("x_m", "y_m", "yaw_rad", "speed_mps"))
    way_m = np.hypot(np.diff(x), np.diff(y))
    on_road = np.asarray(evidence["on_road"], np.bool_)
    off_road_share = float(way_m[~on_road[1:]].sum() / way_m.sum()) if way_m.sum() > 0 else 0.0
    hits = np.asarray(evidence["collision"], np.bool_)
    window = first + ACTIVE_TICKS // OBSERVATION_STRIDE_TICKS
    route_fraction = float(fields["result_route_fraction"])
    return {
        "choices": [bank.policies[choice].key for choice in driven.choices],
        "ticks": list(driven.ticks),
        "completion": fields["result_completion"],
        "route_fraction": route_fraction,
        "score": driving_score(route_fraction, off_road_share, counts),
        "counts": counts,
        "off_road_share": off_road_share,
        "collision_in_first_window": bool(hits[first + 1 : window + 1].any()),
        "collision_later": bool(hits[window + 1 :].any()),
        "way_km": float(way_m[first:].sum()) / 1000.0,
        "duration_s": float((len(x) - 1 - first) * OBSERVATION_STRIDE_TICKS * TICK_S),
        "interventions": sum(not bank.policies[choice].is_nominal for choice in driven.choices),
        **_comfort(yaw[first:], speed[first:]),
    }


def _comfort(yaw: Any, speed: Any) -> dict[str, float | None]:
    """Mean jerk, greatest acceleration and yaw rate, as targets have them; ``None`` where a drive is too short."""
    if len(yaw) < 3:
        return {"mean_jerk_mps3": None, "max_accel_mps2": None, "max_yaw_rate_radps": None}
    accel_x, accel_y = (np.diff(speed * part) / STEP_S for part in (np.cos(yaw), np.sin(yaw)))
    jerk = np.hypot(np.diff(accel_x), np.diff(accel_y)) / STEP_S
    return {
        "mean_jerk_mps3": float(jerk.mean()),
        "max_accel_mps2": float(np.hypot(accel_x, accel_y).max()),
        "max_yaw_rate_radps": float(np.abs(wrap_rad(np.diff(yaw))).max() / STEP_S),
    }
