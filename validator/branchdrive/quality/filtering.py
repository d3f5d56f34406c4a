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

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.quality.fidelity import (
    bank_actions,
    bank_rows,
    discrepancies_of,
    one_bank,
    thresholds_of,
)
from branchdrive.quality.replay_frames import FRAMED, MATCHED
from branchdrive.quality.threshold import FLOORS, QUANTILE, VARIABLES
from branchdrive.tables.frame import Frame

__all__ = [
    "FilterFigures", "filtering_document_of", "mean_share", "shares_above",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NAMES = [variable.name for variable in VARIABLES]
_NO_FIGURES: Mapping[str, None] = dict.fromkeys(("mean_share_above", "share_above", "variation"))


def shares_above(pairs: Frame, frames: Frame, group_ids: list[str]) -> Array:
    """Shares of frames above the floor, by group and variable of `FRAMED` ``[groups, FRAMED, actions]``.

    Raises:
        ValueError: A pair has no row in `frames`, or a group lacks a pair that others have.
    """
    rows = _frame_rows(pairs, frames)[bank_rows(pairs, group_ids)]
    return np.stack([_column(frames, "above", name)[rows] for name in FRAMED], axis=1)


def mean_share(shares: Array) -> float:
    """Mean over the pairs of all training groups ``[groups, actions]``, in sorted order, which decides last bits."""
    return float(np.ascontiguousarray(shares).mean())


class FilterFigures(NamedTuple):
    """What some groups add to the document but for means: counts, and what order statistics are taken of.

    Attributes:
        shares: Largest share of each training group ``[groups, FRAMED]``.
        moves: Values of the variation of training pairs and how often each occurs, by variable of `FRAMED`.
        num_pairs: Interventions of all groups.
        num_failing: Those that fail each variable ``[12]``.
        num_alone: Those that fail no other judged one ``[12]``.
        largest_matched: Largest difference of the vehicle matched by actor of training groups ``[groups, MATCHED]``.
        matched: That difference of each intervention ``[pairs, MATCHED]``.
        actions: Actions of each bank, sorted; none without a group.
    """

    shares: Array
    moves: tuple[tuple[Array, Index], ...]
    num_pairs: int
    num_failing: Index
    num_alone: Index
    largest_matched: Array
    matched: Array
    actions: tuple[str, ...]

    @classmethod
    def of(
        cls,
        pairs: Frame,
        frames: Frame,
        above: Array,
        training: list[str],
        every: list[str],
        thresholds: Mapping[str, Any],
    ) -> FilterFigures:
        """Figures of groups.

        Args:
            pairs: Rows of `pairs`.
            frames: What `replay_frames.frame_columns` says of each pair, in any order.
            above: Of the training groups, as `shares_above` gives them.
            training: Those of the groups that thresholds are fitted on, sorted.
            every: All of them, sorted.
            thresholds: Document ``thresholds.json``.

        Raises:
            ValueError: A pair has no row in `frames`, or a group lacks a pair that others have.
        """
        at = _frame_rows(pairs, frames)
        fitted_on, banks = at[bank_rows(pairs, training)], bank_rows(pairs, every)
        rows = banks.ravel()
        fitted, values = thresholds_of(thresholds), discrepancies_of(pairs)[rows]
        fails = fitted.judged & ~(np.isfinite(values) & (values <= fitted.values))
        differences = np.stack([_column(frames, "largest", name) for name in MATCHED], axis=1)
        moves = [_column(frames, "variation", name)[fitted_on] for name in FRAMED]
        return cls(
            above.max(axis=2, initial=0.0),
            tuple(np.unique(found[np.isfinite(found)], return_counts=True) for found in moves),
            len(rows),
            fails.sum(axis=0),
            fails[fails.sum(axis=1) == 1].sum(axis=0),
            differences[fitted_on].max(axis=1, initial=0.0),
            differences[at[rows]],
            bank_actions(pairs, banks),
        )


def filtering_document_of(
    parts: Sequence[FilterFigures],
    means: Sequence[float],
    thresholds: Mapping[str, Any],
    split_digest: str,
) -> dict[str, Any]:
    """The document ``filtering.json`` of groups that come in parts, at least one in training.

    Args:
        parts: Figures of groups.
        means: `mean_share` of each variable of `FRAMED`.
        thresholds: Document ``thresholds.json``.
        split_digest: Digest of ``split.json``.

    Raises:
        ValueError: Groups of two parts have not the same actions.
    """
    one_bank(part.actions for part in parts)
    figures = _figures(parts, means)
    judged = thresholds_of(thresholds).judged.tolist()
    failing, alone = (
        sum(counts).tolist() for counts in zip(*((part.num_failing, part.num_alone) for part in parts), strict=True)
    )
    matched = _matched_thresholds(parts)
    differences = np.concatenate([part.matched for part in parts])
    there = np.isfinite(differences)
    unmatched = (~there).sum(axis=0).tolist()
    beyond = (~(there & (differences <= np.array([*matched.values()])))).sum(axis=0).tolist()
    variables = []
    for i, name in enumerate(_NAMES):
        found = {**figures.get(name, _NO_FIGURES)} | {
            "num_failing": failing[i],
            "num_failing_alone": alone[i],
            "num_unmatched": None,
        }
        stored = thresholds["variables"][i]["value"]
        variables.append(_entry(name, stored, float(FLOORS[i]), found, decides=judged[i]))
    for i, (name, threshold) in enumerate(matched.items()):
        found = figures[name] | {
            "num_failing": beyond[i],
            "num_failing_alone": None,
            "num_unmatched": unmatched[i],
        }
        limit = threshold if np.isfinite(threshold) else None
        variables.append(_entry(name, limit, _floor(name), found, decides=False))
    return {
        "split_digest": split_digest,
        "num_groups": sum(len(part.shares) for part in parts),
        "num_pairs": sum(part.num_pairs for part in parts),
        "variables": variables,
    }


def _matched_thresholds(parts: Sequence[FilterFigures]) -> Mapping[str, float]:
    """Thresholds of the variables of `MATCHED`: order statistics of training groups, in any order."""
    largest = np.concatenate([part.largest_matched for part in parts])
    fitted = np.quantile(largest, QUANTILE, axis=0, method="higher").tolist()
    return {name: max(value, _floor(name)) for name, value in zip(MATCHED, fitted, strict=True)}


def _figures(parts: Sequence[FilterFigures], means: Sequence[float]) -> dict[str, dict[str, Any]]:
    """Shares of frames above the floor, and the nominal's own variation, by variable that has frames."""
    found = {}
    shares = np.quantile(np.concatenate([part.shares for part in parts]), QUANTILE, axis=0, method="higher")
    for i, name in enumerate(FRAMED):
        values, counts = (np.concatenate(column) for column in zip(*(part.moves[i] for part in parts), strict=True))
        found[name] = {
            "mean_share_above": means[i],
            "share_above": float(shares[i]),
            "variation": float(np.median(np.repeat(values, counts))) if len(values) else None,
        }
    return found


def _frame_rows(pairs: Frame, frames: Frame) -> Index:
    """Row in `frames` of each pair."""
    place = {rollout: row for row, rollout in enumerate(frames["rollout_id"].tolist())}
    try:
        return np.array([place[rollout] for rollout in pairs["rollout_id"].tolist()], np.int64)
    except KeyError as error:
        raise ValueError(f"the pair of {error} has no frames") from error


def _column(frames: Frame, kind: str, name: str) -> Array:
    return np.asarray(frames[f"{kind}_{name}"], np.float64)


def _floor(name: str) -> float:
    return float(FLOORS[_NAMES.index(MATCHED[name])])


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
