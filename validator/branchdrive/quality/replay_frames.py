"""Replays against the nominal of their group, frame by frame: what stands beside the largest discrepancy of a window.

For each variable with a difference ``d_j`` at the frames ``j`` of the window before the branch::

    above       share of the frames with d_j above the floor of the variable
    variation   how far the nominal itself moves: max_j - min_j of its values, of positions and headings the largest
                distance from those at the branch

The nearest vehicle matched by actor: at each frame the vehicle that is nearest to the ego in the nominal, looked up in
the replay by its recorded identity. So no difference comes from another vehicle being the nearest one; where the
replay does not record that vehicle at that frame, the difference is infinite.

Source: spec/11-fidelity.md#filtering; this project's choice.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import threshold_floors
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.discrepancy import (
    History,
    core_differences,
    difference,
    nearest_differences,
    nearest_values,
)
from branchdrive.driving.risk import RANGE_M
from branchdrive.quality.replay import Pairs, evidence_of, history_of
from branchdrive.raw.motion.pairs import deciding_pairs, pairs_of_rows
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows
from branchdrive.tables.frame import Values
from branchdrive.tables.join import KeyIndex

__all__ = ["FRAMED", "MATCHED", "frame_columns", "matched_vehicle"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MATCHED = {
    "matched_vehicle_gap_m": "vehicle_gap_m",
    "matched_vehicle_rel_speed_mps": "vehicle_rel_speed_mps",
}
"""Variables of the vehicle that is matched by actor, and those of the nearest one that they stand beside."""

FRAMED = (
    "position_m", "heading_deg", "speed_mps", "steer", "throttle", "brake", "vehicle_gap_m", "vehicle_rel_speed_mps",
    "pedestrian_gap_m", *MATCHED,
)  # fmt: skip
"""Variables that have a difference at every frame."""


def frame_columns(view: ShardView, pairs: Pairs) -> dict[str, Values]:
    """What one shard says of its pairs: ``above_NAME`` and ``variation_NAME``, and the largest matched differences.

    Where no evidence or no actors are claimed, nothing is there on either side.

    Args:
        view: The shard.
        pairs: Pairs of replay and nominal with whole windows.
    """
    num_pairs = len(pairs.replay)
    replay, nominal = (
        History(*(np.asarray(values, np.float64) for values in history_of(view, rollouts))) for rollouts in pairs
    )
    found = core_differences(replay, nominal)
    variation = _variations(nominal)
    nothing = np.zeros((num_pairs, len(HISTORY_OFFSETS)))
    if "evidence" in view:
        recorded = evidence_of(view, pairs.nominal)
        found |= nearest_differences(evidence_of(view, pairs.replay), recorded)
        variation |= {name: _extent(values) for name, values in nearest_values(recorded).items()}
    has_actors = "evidence" in view and "actors" in view
    found |= dict(zip(MATCHED, matched_vehicle(view, pairs) if has_actors else (nothing, nothing), strict=True))
    floors = threshold_floors()
    unknown = np.full(num_pairs, np.nan)
    columns: dict[str, Values] = {"rollout_id": np.array(view.rollout_ids, object)[pairs.replay]}
    for name in FRAMED:
        values, nearest = found.get(name, nothing), MATCHED.get(name, name)
        columns[f"above_{name}"] = (values > floors[nearest]).mean(axis=1)
        columns[f"variation_{name}"] = variation.get(nearest, unknown)
    return columns | {f"largest_{name}": found[name].max(axis=1, initial=0.0) for name in MATCHED}


def _variations(nominal: History) -> dict[str, Array]:
    """How far drives move in their windows, by variable ``[drives]``."""
    x, y = (values - values[:, -1:] for values in (nominal.x_m, nominal.y_m))
    heading = np.degrees(np.abs(wrap_rad(nominal.yaw_rad - nominal.yaw_rad[:, -1:])))
    return {
        "position_m": np.sqrt(x * x + y * y).max(axis=1),
        "heading_deg": heading.max(axis=1),
        **{name: _extent(getattr(nominal, name)) for name in ("speed_mps", "steer", "throttle", "brake")},
    }


def _extent(values: Array) -> Array:
    """Largest less smallest value of every row, NaN where a row has none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # rows without a value
        return np.asarray(np.nanmax(values, axis=1) - np.nanmin(values, axis=1), np.float64)


def matched_vehicle(view: ShardView, pairs: Pairs) -> tuple[Array, Array]:
    """Differences of gap and closing speed of the nominal's nearest vehicle ``[pairs, 16]``, 0 where it has none."""
    at_nominal, at_replay = (
        window_rows(view, view.observations, rollouts, HISTORY_OFFSETS) for rollouts in (pairs.nominal, pairs.replay)
    )
    nearest_id, gap_m, closing_mps = _nearest_vehicles(view)
    wanted = nearest_id[at_nominal]
    row = _rows_of_actors(view, at_replay, wanted)
    there, has = row >= 0, np.isfinite(gap_m[at_nominal])
    found = pairs_of_rows(view, row[there])
    differences = []
    for own, other in ((gap_m, found.gap_m), (closing_mps, found.closing_mps)):
        replayed = np.full(row.shape, np.nan)
        replayed[there] = other
        differences.append(difference(np.where(has, replayed, np.nan), own[at_nominal]))
    return differences[0], differences[1]


def _nearest_vehicles(view: ShardView) -> tuple[Index, Array, Array]:
    """Identity, gap and closing speed of the nearest vehicle in range of each observation; NaN where there is none."""
    pairs = view.cached(deciding_pairs)
    rows = np.flatnonzero(pairs.is_vehicle & (pairs.gap_m <= RANGE_M))
    order = rows[np.lexsort((pairs.actor_id[rows], pairs.gap_m[rows], pairs.frame[rows]))]
    first = order[np.flatnonzero(np.diff(pairs.frame[order], prepend=-1))]
    identity = np.full(len(view.observations), -1, np.int64)
    gap_m, closing_mps = np.full((2, len(view.observations)), np.nan)
    frame = pairs.frame[first]
    identity[frame], gap_m[frame], closing_mps[frame] = (
        pairs.actor_id[first], pairs.gap_m[first], pairs.closing_mps[first],
    )  # fmt: skip
    return identity, gap_m, closing_mps


def _rows_of_actors(view: ShardView, observations: Index, identities: Index) -> Index:
    """Row of the actors table of each (observation, identity), the first of them; -1 where there is none."""
    actors = view.stream("actors")
    frame = view.observations.rows_of(actors)
    is_asked = np.zeros(len(view.observations) + 1, bool)
    is_asked[observations] = True
    is_asked[-1] = False
    rows = np.flatnonzero(is_asked[frame])
    found = KeyIndex(frame[rows], actors["actor_id"][rows]).find(observations, identities)
    return np.where(found >= 0, np.append(rows, -1)[found], -1)
