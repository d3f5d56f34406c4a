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
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.driving.risk import CUTOFF_SLACK, frame_risk, least_of_frame, risk_candidates
from branchdrive.raw.copies import Copies
from branchdrive.raw.motion.pairs import deciding_pairs, pairs_of_frame
from branchdrive.raw.shard_view import ShardView

Array = NDArray[np.float64]

_MINIMA = {
    "separation": "separation_m", "ttc": "ttc_s", "nearest_vehicle": "nearest_vehicle_gap_m",
    "nearest_pedestrian": "nearest_pedestrian_gap_m",
}  # fmt: skip
"""Minima over the pairs of an observation, and the column of each."""

_LEAST_COMPARED, _MOST_COMPARED = 3, 4
"""Observations of an attempt that tell whether poses of its actors come late."""


def _close(recorded: Array, computed: Array, tolerance: float) -> Mask:
    """``|recorded - computed| <= tolerance (1 + |computed|)``."""
    finite = np.where(np.isfinite(computed), computed, 0.0)
    return np.asarray(np.abs(recorded - finite) <= tolerance * (1 + np.abs(finite)))


def _unsound(view: ShardView) -> dict[str, Mask]:
    """Rows of evidence at which mask, value or actor of a minimum is not that of the recorded boxes, by its name."""
    pairs = view.cached(deciding_pairs)
    must_count, may_count = (risk_candidates(pairs, slack) for slack in (-CUTOFF_SLACK, CUTOFF_SLACK))
    found = {}
    for name, column in _MINIMA.items():
        certain = least_of_frame(*must_count[name], pairs, len(view.observations))
        found[name] = _unsound_rows(view, name, column, certain, *may_count[name])
    return found


def _unsound_rows(view: ShardView, name: str, column: str, certain_of: Array, value: Array, may_count: Mask) -> Mask:
    """The same of one minimum, from that over the pairs that no cut-off leaves open, and from all that may count."""
    evidence, pairs = view.stream("evidence"), view.cached(deciding_pairs)
    tolerance = view.descriptor.tolerances.evidence
    frame, copied = view.observations.rows_of(evidence), view.cached(Copies).at_moments("evidence")
    rows = np.flatnonzero((frame >= 0) & copied.judged(len(evidence)))
    there = evidence[f"{name}_available"].astype(bool)
    recorded = evidence[column].astype(np.float64)

    row_of = np.full(len(view.observations), -1)
    row_of[frame[rows]] = rows
    candidates = np.flatnonzero(may_count & (row_of[pairs.frame] >= 0))
    owner = row_of[pairs.frame[candidates]]
    fits = _close(recorded[owner], value[candidates], tolerance)
    if f"{name}_actor_id" in evidence:
        fits &= evidence[f"{name}_actor_id"][owner] == pairs.actor_id[candidates]
    has_pair = np.zeros(len(evidence), bool)
    has_pair[owner[fits]] = True
    certain = certain_of[frame[rows]]
    is_least = _close(np.maximum(recorded[rows], certain), certain, tolerance) | ~np.isfinite(certain)
    sound = np.where(there[rows], has_pair[rows] & is_least, ~np.isfinite(certain))
    bad = np.zeros(len(evidence), bool)
    bad[rows] = ~sound
    copied.fill(bad)
    return bad


def _recomputes(view: ShardView, subjects: Mask, name: str) -> Check:
    """Mask, value and actor of a minimum are those of the recorded boxes."""
    evidence, column = view.stream("evidence"), _MINIMA[name]
    frame = view.observations.rows_of(evidence)
    summary = evidence.by_rollout(view.cached(_unsound)[name])

    def text(available: bool, value: float) -> str:
        return quote(value) if available else "unavailable"

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        computed = frame_risk(pairs_of_frame(view, int(frame[row])), 1)[name]
        is_near, is_there = bool(np.isfinite(computed.value[0])), bool(evidence[f"{name}_available"][row])
        expected, found = text(is_near, computed.value[0]), text(is_there, evidence[column][row])
        recorded, actor = evidence[column][row : row + 1].astype(np.float64), f"{name}_actor_id"
        fits = is_near and is_there and _close(recorded, computed.value, view.descriptor.tolerances.evidence)[0]
        if fits and actor in evidence:
            expected, found = f"actor {computed.actor_id[0]}", f"actor {evidence[actor][row]}"
        elif name == "separation":
            first, stop = int(evidence.start[i]), int(evidence.stop[i])
            found += _delay(view, first + np.flatnonzero(view.cached(_unsound)[name][first:stop]))
        return Mismatch(
            {"table": "evidence", "column": column, "tick": int(evidence.tick[row])},
            expected,
            found,
            int(summary.count[i]),
        )

    subjects = subjects & evidence.by_rollout(frame >= 0).any
    return Check.of_subjects(subjects, subjects & summary.any, describe, summary.stretch)


def _delay(view: ShardView, rows: NDArray[np.intp]) -> str:
    """What a finding adds where the separations of an attempt are those of actors at the observation after or before.

    Args:
        view: The shard.
        rows: Rows of its evidence at which the separation is not that of the recorded boxes.
    """
    evidence, observations = view.stream("evidence"), view.observations
    rows = rows[evidence["separation_available"][rows].astype(bool)]
    frame = observations.rows_of(evidence)[rows]
    for step, text in ((1, "after: theirs are late"), (-1, "before: theirs are early")):
        other = np.clip(frame + step, 0, len(observations) - 1)
        apart = observations.tick[other] - observations.tick[frame] == step * OBSERVATION_STRIDE_TICKS
        some = np.flatnonzero(apart & (observations.rollout[other] == observations.rollout[frame]))[:_MOST_COMPARED]
        if len(some) < _LEAST_COMPARED:
            continue
        pairs = [pairs_of_frame(view, int(frame[k]), int(other[k])) for k in some]
        found = np.array([frame_risk(of_frame, 1)["separation"].value[0] for of_frame in pairs])
        fits = _close(evidence["separation_m"][rows[some]], found, view.descriptor.tolerances.evidence)
        if (fits & np.isfinite(found)).all():
            return f", as by the poses that actors have in the observation {text}"
    return ""


@rule("BD-EVD-001")
def separation_recomputes(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``separation_m`` = smallest gap to a relevant actor in range."""
    yield _recomputes(view, subjects, "separation")


@rule("BD-EVD-002")
def ttc_recomputes(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``ttc_s`` = smallest gap / closing speed over relevant closing actors in range, 0 on overlap."""
    yield _recomputes(view, subjects, "ttc")


@rule("BD-EVD-003")
def nearest_actors_recompute(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Nearest vehicle and nearest pedestrian gaps recompute, and the vehicle's closing speed with its gap."""
    yield Check.of_any(
        _recomputes(view, subjects, "nearest_vehicle"),
        _recomputes(view, subjects, "nearest_pedestrian"),
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

    return Check.of_subjects(subjects, subjects & summary.any, describe, summary.stretch)
