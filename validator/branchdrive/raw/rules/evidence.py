"""Evidence rules: recorded separation, time to collision and nearest actors recompute from the boxes.

A pair within 1e-6 of a cut-off (range, closing speed, corridor) may fall on either side of it, each
pair by itself: evidence is sound if it is the value of a pair that may count, and no pair that must
count is nearer.
Source: paper, "Recorded Modalities"; spec/05-raw-streams.md#evidence.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.driving.risk import CUTOFF_SLACK, frame_risk, least_of_frame, risk_candidates
from branchdrive.raw.copies import Copies
from branchdrive.raw.motion.pairs import deciding_pairs, pairs_of_frame
from branchdrive.raw.shard_view import ShardView

Array = NDArray[np.float64]


def _certain(view: ShardView) -> dict[str, Array]:
    """Minimum per observation over the pairs that must count: those that no cut-off leaves open."""
    pairs = view.cached(deciding_pairs)
    candidates = risk_candidates(pairs, -CUTOFF_SLACK)
    return {name: least_of_frame(*chosen, pairs, len(view.observations)) for name, chosen in candidates.items()}


def _open_candidates(view: ShardView) -> dict[str, tuple[Array, Mask]]:
    """Values and pairs that may count, those on a cut-off included."""
    return risk_candidates(view.cached(deciding_pairs), CUTOFF_SLACK)


def _close(recorded: Array, computed: Array, tolerance: float) -> Mask:
    """``|recorded - computed| <= tolerance (1 + |computed|)``."""
    finite = np.where(np.isfinite(computed), computed, 0.0)
    return np.asarray(np.abs(recorded - finite) <= tolerance * (1 + np.abs(finite)))


def _recomputes(view: ShardView, subjects: Mask, name: str, column: str) -> Check:
    """Mask, value and actor of a minimum are those of the recorded boxes."""
    evidence, pairs = view.stream("evidence"), view.cached(deciding_pairs)
    tolerance = view.descriptor.tolerances.evidence
    frame, copied = view.observations.rows_of(evidence), view.cached(Copies).at_moments("evidence")
    rows = np.flatnonzero((frame >= 0) & copied.judged(len(evidence)))
    there = evidence[f"{name}_available"].astype(bool)
    recorded = evidence[column].astype(np.float64)

    value, may_count = view.cached(_open_candidates)[name]
    row_of = np.full(len(view.observations), -1)
    row_of[frame[rows]] = rows
    candidates = np.flatnonzero(may_count & (row_of[pairs.frame] >= 0))
    owner = row_of[pairs.frame[candidates]]
    fits = _close(recorded[owner], value[candidates], tolerance)
    if f"{name}_actor_id" in evidence:
        fits &= evidence[f"{name}_actor_id"][owner] == pairs.actor_id[candidates]
    has_pair = np.zeros(len(evidence), bool)
    has_pair[owner[fits]] = True
    certain = view.cached(_certain)[name][frame[rows]]
    is_least = _close(np.maximum(recorded[rows], certain), certain, tolerance) | ~np.isfinite(certain)
    sound = np.where(there[rows], has_pair[rows] & is_least, ~np.isfinite(certain))
    bad = np.zeros(len(evidence), bool)
    bad[rows] = ~sound
    copied.fill(bad)
    summary = evidence.by_rollout(bad)

    def text(available: bool, value: float) -> str:
        return quote(value) if available else "unavailable"

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        computed = frame_risk(pairs_of_frame(view, int(frame[row])), 1)[name]
        expected = text(bool(np.isfinite(computed.value[0])), computed.value[0])
        found = text(bool(evidence[f"{name}_available"][row]), evidence[column][row])
        if f"{name}_actor_id" in evidence and expected == found:
            expected, found = f"actor {computed.actor_id[0]}", f"actor {evidence[f'{name}_actor_id'][row]}"
        return Mismatch(
            {"table": "evidence", "column": column, "tick": int(evidence.tick[row])},
            expected,
            found,
            int(summary.count[i]),
        )

    subjects = subjects & evidence.by_rollout(frame >= 0).any
    return Check.of_subjects(subjects, subjects & summary.any, describe)


@rule("BD-EVD-001")
def separation_recomputes(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``separation_m`` = smallest gap to a relevant actor in range."""
    yield _recomputes(view, subjects, "separation", "separation_m")


@rule("BD-EVD-002")
def ttc_recomputes(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``ttc_s`` = smallest gap / closing speed over relevant closing actors in range, 0 on overlap."""
    yield _recomputes(view, subjects, "ttc", "ttc_s")


@rule("BD-EVD-003")
def nearest_actors_recompute(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Nearest vehicle and nearest pedestrian gaps recompute, and the vehicle's closing speed with its gap."""
    yield Check.of_any(
        _recomputes(view, subjects, "nearest_vehicle", "nearest_vehicle_gap_m"),
        _recomputes(view, subjects, "nearest_pedestrian", "nearest_pedestrian_gap_m"),
        _rel_speed_recomputes(view, subjects),
    )


def _rel_speed_recomputes(view: ShardView, subjects: Mask) -> Check:
    """The recorded closing speed is that of a vehicle at the recorded gap."""
    evidence, pairs = view.stream("evidence"), view.cached(deciding_pairs)
    tolerance = view.descriptor.tolerances.evidence
    frame, copied = view.observations.rows_of(evidence), view.cached(Copies).at_moments("evidence")
    row_of = np.full(len(view.observations), -1)
    row_of[frame[frame >= 0]] = np.flatnonzero(frame >= 0)
    there = evidence["nearest_vehicle_available"].astype(bool)
    speeds = evidence["nearest_vehicle_rel_speed_mps"]
    vehicles = np.flatnonzero((row_of[pairs.frame] >= 0) & pairs.is_vehicle)
    owner, gap, closing = row_of[pairs.frame[vehicles]], pairs.gap_m[vehicles], pairs.closing_mps[vehicles]
    fits = _close(evidence["nearest_vehicle_gap_m"][owner], gap, tolerance)
    matched = fits & _close(speeds[owner], closing, tolerance)
    has_candidate = np.zeros(len(evidence), bool)
    has_candidate[owner[fits]] = True
    sound = np.zeros(len(evidence), bool)
    sound[owner[matched]] = True
    copied.fill(has_candidate, sound)
    subjects = subjects & evidence.by_rollout(there & has_candidate).any
    summary = evidence.by_rollout(there & has_candidate & ~sound)

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        candidates = closing[fits & (owner == copied.source_of(row))]
        place: Location = {
            "table": "evidence", "column": "nearest_vehicle_rel_speed_mps", "tick": int(evidence.tick[row]),
        }  # fmt: skip
        return Mismatch(place, quote(candidates[0]), quote(speeds[row]), int(summary.count[i]))

    return Check.of_subjects(subjects, subjects & summary.any, describe)
