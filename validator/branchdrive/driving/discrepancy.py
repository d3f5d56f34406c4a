"""Replay fidelity: how far a replay lies from its nominal before the branch.

Both executed the same expert from tick 0, so over the window before ``t_b`` they should be one drive.
Variables, each a maximum over the 16 observations ``t_b - 75 .. t_b`` or the 80 controls
``t_b - 80 .. t_b - 1`` unless said otherwise:

* core: distance of positions (m), heading (deg), speed (m/s); steer, throttle, brake; offset of the
  branch ticks (ticks);
* extended: gap to the nearest vehicle (m), its relative speed (m/s); share of the observations at
  which the number of actors differs, and at which the traffic light does; gap to the nearest
  pedestrian (m).

What is missing on one side only is infinitely far; what is missing on both is equal. Every variable
is symmetric in replay and nominal and 0 between a drive and itself.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; the variables are this project's choice.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, HISTORY_OBSERVATIONS
from branchdrive.driving.angle import wrap_rad

__all__ = [
    "CORE",
    "EXTENDED",
    "NO_LIGHT",
    "History",
    "HistoryEvidence",
    "Variable",
    "core_differences",
    "core_discrepancy",
    "difference",
    "extended_discrepancy",
    "nearest_differences",
    "nearest_values",
]

Array = NDArray[np.float64]

NO_LIGHT = -1
"""Code of an observation at which no traffic light governs the ego."""


class Variable(NamedTuple):
    """One variable of replay fidelity: name and unit, the unit empty where there is none."""

    name: str
    unit: str


CORE = (
    Variable("position_m", "m"),
    Variable("heading_deg", "deg"),
    Variable("speed_mps", "m/s"),
    Variable("steer", ""),
    Variable("throttle", ""),
    Variable("brake", ""),
    Variable("tick_offset", "ticks"),
)
"""Core variables, in the order of `core_discrepancy`."""

EXTENDED = (
    Variable("vehicle_gap_m", "m"),
    Variable("vehicle_rel_speed_mps", "m/s"),
    Variable("actor_count_share", ""),
    Variable("traffic_light_share", ""),
    Variable("pedestrian_gap_m", "m"),
)
"""Extended variables, in the order of `extended_discrepancy`."""


class History(NamedTuple):
    """Drives before their branch, NaN where nothing was recorded.

    Attributes:
        x_m: Ego centre ``[drives, 16]``, world frame.
        y_m: Ego centre ``[drives, 16]``, world frame.
        yaw_rad: Heading ``[drives, 16]``, world frame.
        speed_mps: Longitudinal speed ``[drives, 16]``.
        steer: Applied steering ``[drives, 80]``.
        throttle: Applied throttle ``[drives, 80]``.
        brake: Applied brake ``[drives, 80]``.
        branch_tick: ``t_b`` ``[drives]``.
    """

    x_m: Array
    y_m: Array
    yaw_rad: Array
    speed_mps: Array
    steer: Array
    throttle: Array
    brake: Array
    branch_tick: NDArray[Any]


class HistoryEvidence(NamedTuple):
    """What surrounded drives before their branch, each field ``[drives, 16]``.

    Attributes:
        vehicle_available: Whether a vehicle or cycle is in range.
        vehicle_gap_m: Gap to the nearest; any value where unavailable.
        vehicle_rel_speed_mps: Its closing speed; any value where unavailable.
        num_actors: Recorded actors.
        traffic_light: Code of the light that governs the ego, `NO_LIGHT` where none does.
        pedestrian_available: Whether a pedestrian is in range.
        pedestrian_gap_m: Gap to the nearest; any value where unavailable.
    """

    vehicle_available: NDArray[Any]
    vehicle_gap_m: Array
    vehicle_rel_speed_mps: Array
    num_actors: NDArray[Any]
    traffic_light: NDArray[Any]
    pedestrian_available: NDArray[Any]
    pedestrian_gap_m: Array


def core_discrepancy(replay: History, nominal: History) -> Array:
    """Core variables of paired drives, ``[drives, 7]`` in the order of `CORE`.

    Raises:
        ValueError: A field has another shape than `History` says.
    """
    replay, nominal = (History(*_checked(side, _HISTORY_FRAMES)) for side in (replay, nominal))
    columns = [values.max(axis=1) for values in core_differences(replay, nominal).values()]
    return np.stack([*columns, np.abs(replay.branch_tick - nominal.branch_tick)], axis=1)


def core_differences(replay: History, nominal: History) -> dict[str, Array]:
    """Differences of paired drives frame by frame, each ``[drives, 16]`` or ``[drives, 80]``: `CORE` but its last."""
    x, y = (difference(getattr(replay, name), getattr(nominal, name)) for name in ("x_m", "y_m"))
    heading = np.degrees(np.abs(wrap_rad(_without_infinity(replay.yaw_rad) - _without_infinity(nominal.yaw_rad))))
    return {
        "position_m": np.sqrt(x * x + y * y),
        "heading_deg": _with_missing(heading, replay.yaw_rad, nominal.yaw_rad),
        **{
            name: difference(getattr(replay, name), getattr(nominal, name))
            for name in ("speed_mps", "steer", "throttle", "brake")
        },
    }


def extended_discrepancy(replay: HistoryEvidence, nominal: HistoryEvidence) -> Array:
    """Extended variables of paired drives, ``[drives, 5]`` in the order of `EXTENDED`.

    Raises:
        ValueError: A field has another shape than ``[drives, 16]``.
    """
    replay, nominal = (HistoryEvidence(*_checked(side, _EVIDENCE_FRAMES)) for side in (replay, nominal))
    nearest = nearest_differences(replay, nominal)
    columns = [
        nearest["vehicle_gap_m"].max(axis=1),
        nearest["vehicle_rel_speed_mps"].max(axis=1),
        (replay.num_actors != nominal.num_actors).mean(axis=1),
        (replay.traffic_light != nominal.traffic_light).mean(axis=1),
        nearest["pedestrian_gap_m"].max(axis=1),
    ]
    return np.stack(columns, axis=1)


def nearest_differences(replay: HistoryEvidence, nominal: HistoryEvidence) -> dict[str, Array]:
    """Differences of what is nearest, frame by frame ``[drives, 16]``: the `EXTENDED` variables that are no shares."""
    return {
        name: difference(*(nearest_values(side)[name] for side in (replay, nominal)))
        for name in ("vehicle_gap_m", "vehicle_rel_speed_mps", "pedestrian_gap_m")
    }


def nearest_values(evidence: HistoryEvidence) -> dict[str, Array]:
    """Gaps and closing speed of what is nearest ``[drives, 16]``, NaN where nothing is in range."""
    vehicle, pedestrian = (
        np.asarray(there).astype(bool) for there in (evidence.vehicle_available, evidence.pedestrian_available)
    )
    return {
        "vehicle_gap_m": np.where(vehicle, evidence.vehicle_gap_m, np.nan),
        "vehicle_rel_speed_mps": np.where(vehicle, evidence.vehicle_rel_speed_mps, np.nan),
        "pedestrian_gap_m": np.where(pedestrian, evidence.pedestrian_gap_m, np.nan),
    }


_HISTORY_FRAMES = (*[HISTORY_OBSERVATIONS] * 4, *[CONTROL_HISTORY_TICKS] * 3, None)
_EVIDENCE_FRAMES = (HISTORY_OBSERVATIONS,) * len(HistoryEvidence._fields)


def _checked(fields: History | HistoryEvidence, frames: tuple[int | None, ...]) -> list[Array]:
    """Fields in float64, each ``[drives, frames]`` or, without frames, ``[drives]``."""
    arrays = [np.asarray(values, np.float64) for values in fields]
    num_drives = len(arrays[0]) if arrays[0].ndim else 0
    for name, values, num_frames in zip(fields._fields, arrays, frames, strict=True):
        wanted = (num_drives,) if num_frames is None else (num_drives, num_frames)
        if values.shape != wanted:
            raise ValueError(f"`{name}` has shape {list(values.shape)}, not {list(wanted)}")
    return arrays


def _without_infinity(values: Array) -> Array:
    """What is no finite number as NaN."""
    return np.where(np.isfinite(values), values, np.nan)


def _with_missing(difference: Array, a: Array, b: Array) -> Array:
    """`difference`, but ``inf`` where one of `a` and `b` alone is no finite number, and 0 where both are none."""
    there_a, there_b = np.isfinite(a), np.isfinite(b)
    return np.where(there_a & there_b, difference, np.where(there_a == there_b, 0.0, np.inf))


def difference(a: ArrayLike, b: ArrayLike) -> Array:
    """``|a - b|`` under the rule of what is missing."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    return _with_missing(np.abs(_without_infinity(a) - _without_infinity(b)), a, b)
