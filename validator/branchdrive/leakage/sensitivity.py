"""Minimum detectable effect: which offsets the gate would have found in these very data.

A replicate first permutes the rows within groups, so that nothing leaks, and then adds an offset:

* ``one``: ``offset * sd`` on one feature of one action, both drawn;
* ``dense``: ``offset * sd * dose_a`` on a drawn quarter of the features, ``dose`` evenly spaced over the actions
  from -1 to 1;
* ``tenth`` and ``thirtieth``: the same in a drawn tenth or thirtieth of the groups alone, rounded up, with offsets
  of their own.

A replicate in which an offset is missed counts as missed at all smaller ones.

Features of the gate are moved and examined, recorded streams are not: what is found in features is found in a stream
as well. Its statistics are compared with the critical values of the one null distribution, which permuting leaves
as it is, at ``alpha / 6``: the level at which Holm's procedure rejects first, so that the gate fails
exactly where any statistic is beyond its own.

Source: this project's choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.draw import Draw, Kept, drawn_here, ranges_of
from branchdrive.leakage.gate_statistics import GateStatistics, Reference
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.leakage.table import checked
from branchdrive.statistics.permutation import critical_value
from branchdrive.statistics.random_words import below, group_orders, orders, words

__all__ = ["PATTERNS", "Detection", "Pattern", "Sensitivity", "inject", "offsets_of", "replicate_values", "sensitivity"]

Array = NDArray[np.float64]
Pattern = Literal["one", "dense", "tenth", "thirtieth"]

PATTERNS: tuple[Pattern, ...] = ("one", "dense", "tenth", "thirtieth")
"""Patterns of an offset."""

_DENSE_SHARE = 4
_PART_OF_GROUPS: dict[Pattern, int] = {"one": 1, "dense": 1, "tenth": 10, "thirtieth": 30}

_ROWS = "leakage/replicate/rows"
_FEATURES = "leakage/replicate/features"
_ACTION = "leakage/replicate/action"
_GROUPS = "leakage/replicate/groups"


class Detection(NamedTuple):
    """How often one offset was found.

    Attributes:
        pattern: Where the offset was added.
        offset_sd: Its size, standard deviations.
        shares: Share of replicates in which a statistic found it, in the order of `STATISTICS`.
        gate_share: Share in which any did.
    """

    pattern: Pattern
    offset_sd: float
    shares: tuple[float, ...]
    gate_share: float


@dataclass(frozen=True)
class Sensitivity:
    """Minimum detectable effect of a gate.

    Attributes:
        alpha: Level of every single statistic.
        critical: Values that they must exceed, in the order of `STATISTICS`; ``inf`` where no value would do.
        detections: One for every pattern and offset.
    """

    alpha: float
    critical: tuple[float, ...]
    detections: tuple[Detection, ...]

    def smallest_sd(self, pattern: Pattern) -> float | None:
        """Smallest offset that the gate found in every replicate, and all larger ones too; None where none is."""
        smallest = None
        for found in sorted((d for d in self.detections if d.pattern == pattern), key=lambda d: -d.offset_sd):
            if found.gate_share < 1:
                break
            smallest = found.offset_sd
        return smallest


def offsets_of(pattern: Pattern, protocol: GateProtocol) -> tuple[float, ...]:
    """Offsets of a pattern, standard deviations, ascending."""
    return protocol.offsets_sd if _PART_OF_GROUPS[pattern] == 1 else protocol.sparse_offsets_sd


def sensitivity(
    features: Kept[Array],
    reference: Reference,
    null: Array,
    *,
    protocol: GateProtocol,
    seed: int,
    draw: Draw = drawn_here,
) -> Sensitivity:
    """Minimum detectable effect in features ``[groups, actions, features]``; nothing is found where nothing can move.

    Args:
        features: As the gate saw them.
        reference: Of the gate statistics that gave `null`.
        null: Null distribution ``[permutations, statistics]``.
        protocol: Numbers of the gate.
        seed: Of the replicates.
        draw: How ranges of replicates are computed.
    """
    alpha = protocol.alpha / len(STATISTICS)
    critical = np.array([critical_value(column, alpha) for column in null.T])
    replicates = _Replicates(features, reference, critical, protocol, seed)
    # A number for every replicate of every pattern: pattern by pattern.
    every = draw(_found_in, replicates, ranges_of(len(PATTERNS) * protocol.num_replicates, 1))
    flat = [found for part in every for found in part]
    detections = []
    for index, pattern in enumerate(PATTERNS):
        own = flat[index * protocol.num_replicates : (index + 1) * protocol.num_replicates]
        for offset_sd, of_offset in zip(offsets_of(pattern, protocol), np.stack(own, axis=1), strict=True):
            shares = tuple(of_offset.mean(axis=0).tolist())
            detections.append(Detection(pattern, offset_sd, shares, float(of_offset.any(axis=1).mean())))
    return Sensitivity(alpha, tuple(critical.tolist()), tuple(detections))


class _Replicates(NamedTuple):
    """What the replicates are a function of beside their numbers."""

    features: Kept[Array]
    reference: Reference
    critical: Array
    protocol: GateProtocol
    seed: int


def _found_in(subject: _Replicates, numbers: range) -> list[NDArray[np.bool_]]:
    """Which statistics find each offset of replicates, ``[offsets, statistics]`` each."""
    kept, reference, critical, protocol, seed = subject
    x = kept.value
    every = []
    for number in numbers:
        pattern, replicate = PATTERNS[number // protocol.num_replicates], number % protocol.num_replicates
        offsets = offsets_of(pattern, protocol)
        found = np.zeros((len(offsets), len(STATISTICS)), np.bool_)
        for place in range(len(offsets))[::-1]:
            moved = replicate_values(x, reference, pattern, offsets[place], replicate, seed=seed)
            if moved is not None:
                found[place] = GateStatistics.like(reference, moved, protocol).observed() > critical
            if not found[place].any():
                break
        every.append(found)
    return every


def replicate_values(
    features: ArrayLike, reference: Reference, pattern: Pattern, offset_sd: float, replicate: int, *, seed: int
) -> Array | None:
    """Features of a replicate with an offset ``[groups, actions, features]``; None where no feature can move.

    Args:
        features: As the gate saw them ``[groups, actions, features]``.
        reference: Of the gate statistics of these features.
        pattern: Where the offset is added.
        offset_sd: Its size, standard deviations.
        replicate: Its number, from 0.
        seed: Of the audit.
    """
    x = checked(features)
    num_groups, num_actions, _ = x.shape
    movable = np.array([c.feature for c in reference.columns if c.kind == "value"], np.intp)
    if not movable.size:
        return None
    rows = group_orders(seed, _ROWS, 1, num_groups, num_actions, first_row=replicate)[0]
    order = movable[orders(words(seed, _FEATURES, 1, len(movable), first_row=replicate))[0]]
    action = int(below(words(seed, _ACTION, 1, 1, first_row=replicate), num_actions)[0, 0])
    moved = np.take_along_axis(x, rows[:, :, None], axis=1)
    num_moved = -(-num_groups // _PART_OF_GROUPS[pattern])
    groups = np.sort(orders(words(seed, _GROUPS, 1, num_groups, first_row=replicate))[0][:num_moved])
    chosen = moved[groups]
    with np.errstate(over="ignore"):
        offset = offset_sd * reference.sd
    inject(chosen, pattern, offset, order, action)
    moved[groups] = chosen
    return moved


def inject(features: Array, pattern: Pattern, offset: Array, order: NDArray[np.intp], action: int) -> None:
    """Add an offset to features, in place.

    Args:
        features: ``[groups, actions, features]``.
        pattern: Where to add it.
        offset: Size for every feature ``[features]``, in the feature's unit.
        order: Features to choose from; the first, or the first quarter and at least one, are moved.
        action: Action that is moved where the pattern is of one.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        if pattern == "one":
            features[:, action, order[0]] += offset[order[0]]
        else:
            chosen = order[: max(1, len(order) // _DENSE_SHARE)]
            last = features.shape[1] - 1
            dose = np.arange(-last, last + 1, 2) / last
            features[:, :, chosen] += dose[:, None] * offset[chosen]
