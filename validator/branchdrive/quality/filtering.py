"""What the thresholds of replay fidelity filter, and figures beside them that decide nothing.

For each variable, over the intervention pairs of eligible training groups, from which thresholds are fitted::

    mean_share_above   mean over pairs of the share of frames with a difference above the floor
    share_above        0.99 quantile over groups, higher order statistic, of the largest share of a group
    variation          median over groups of how far the nominal itself moves in its window
    over_variation     threshold / variation

and over all integrity-complete groups how many pairs fail the variable, and how many fail no other judged one.

A threshold that is above its floor filters nothing where no pair fails by it alone, or where it is at least as large
as what the variable moves in a window anyway: a replay that did something else altogether would pass it.

The nearest vehicle matched by actor has figures of the same form, its threshold fitted as the others are, and judges
no pair.

Source: spec/11-fidelity.md#filtering; this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.quality.fidelity import bank_rows, discrepancies_of, thresholds_of
from branchdrive.quality.partition import assignment_of
from branchdrive.quality.replay_frames import FRAMED, MATCHED
from branchdrive.quality.threshold import FLOORS, QUANTILE, VARIABLES
from branchdrive.statistics.split import TRAINING, split_digest
from branchdrive.tables.frame import Frame

__all__ = ["filtering_document"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NAMES = [variable.name for variable in VARIABLES]


def filtering_document(pairs: Frame, groups: Frame, frames: Frame, thresholds: Mapping[str, Any]) -> dict[str, Any]:
    """The document ``filtering.json``.

    Args:
        pairs: Rows of `pairs`.
        groups: Rows of `group_quality` with partitions.
        frames: What `replay_frames.frame_columns` says of each pair, in any order.
        thresholds: Document ``thresholds.json``.

    Raises:
        ValueError: No training group is eligible, a pair has no row in `frames`, or a group lacks a pair that others
            have.
    """
    assignment = assignment_of(groups)
    eligible = groups["group_id"][np.asarray(groups["eligible"], np.bool_)].tolist()
    training = bank_rows(pairs, sorted(group for group in eligible if assignment.get(group) == TRAINING))
    if not len(training):
        raise ValueError("no training group is structurally eligible, so no threshold filters")
    every = bank_rows(pairs, sorted(assignment)).ravel()
    place = {rollout: row for row, rollout in enumerate(frames["rollout_id"].tolist())}
    try:
        at = np.array([place[rollout] for rollout in pairs["rollout_id"].tolist()], np.int64)
    except KeyError as error:
        raise ValueError(f"the pair of {error} has no frames") from error
    fitted, values = thresholds_of(thresholds), discrepancies_of(pairs)
    fails = fitted.judged & ~(np.isfinite(values) & (values <= fitted.values))
    alone = fails & (fails.sum(axis=1) == 1)[:, None]
    variables = []
    for i, name in enumerate(_NAMES):
        found = _figures(frames, at, training, name) | {
            "num_failing": int(fails[every, i].sum()),
            "num_failing_alone": int(alone[every, i].sum()),
            "num_unmatched": None,
        }
        judged = bool(fitted.judged[i])
        stored = thresholds["variables"][i]["value"]
        variables.append(_entry(name, stored, float(FLOORS[i]), found, decides=judged))
    for name, nearest in MATCHED.items():
        largest = np.asarray(frames[f"largest_{name}"], np.float64)[at]
        fitted_m = float(np.quantile(largest[training].max(axis=1), QUANTILE, method="higher"))
        floor = float(FLOORS[_NAMES.index(nearest)])
        threshold = max(fitted_m, floor) if np.isfinite(fitted_m) else None
        beyond = ~(np.isfinite(largest) & (largest <= max(fitted_m, floor)))
        found = _figures(frames, at, training, name) | {
            "num_failing": int(beyond[every].sum()),
            "num_failing_alone": None,
            "num_unmatched": int((~np.isfinite(largest[every])).sum()),
        }
        variables.append(_entry(name, threshold, floor, found, decides=False))
    return {
        "split_digest": split_digest(assignment),
        "num_groups": len(training),
        "num_pairs": len(every),
        "variables": variables,
    }


def _figures(frames: Frame, at: Index, training: Index, name: str) -> dict[str, Any]:
    """Shares of frames above the floor, and the nominal's own variation; null where a variable has no frames."""
    if name not in FRAMED:
        return {"mean_share_above": None, "share_above": None, "variation": None}
    above, moves = (np.asarray(frames[f"{kind}_{name}"], np.float64)[at][training] for kind in ("above", "variation"))
    moves = moves[np.isfinite(moves)]
    return {
        "mean_share_above": float(above.mean()),
        "share_above": float(np.quantile(above.max(axis=1), QUANTILE, method="higher")),
        "variation": float(np.median(moves)) if len(moves) else None,
    }


def _entry(
    name: str, threshold: float | None, floor: float, found: Mapping[str, Any], *, decides: bool
) -> dict[str, Any]:
    variation = found["variation"]
    over = threshold / variation if threshold is not None and variation else None
    return {
        "name": name,
        "unit": LAYER_TABLES["pairs"][MATCHED.get(name, name)].unit,
        "decides": decides,
        "threshold": threshold,
        **found,
        "over_variation": over,
        "filters": _filters(threshold, floor, over, found["num_failing_alone"]) if decides else None,
    }


def _filters(threshold: float | None, floor: float, over: float | None, num_alone: int) -> bool:
    """Whether a threshold filters: it is its floor, or some pair fails by it alone and it is below the variation."""
    if threshold is not None and threshold <= floor:
        return True
    return num_alone > 0 and (over is None or over < 1)
