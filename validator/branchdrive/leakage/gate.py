"""Gate of a leakage audit: do features from before the branch tell which action follows?

Six statistics share permutations of action labels within groups; Holm's procedure over their p-values keeps
the family-wise error at `alpha`. The verdict is

* ``fail`` where any adjusted p is at most `alpha`;
* ``pass`` where none is, or exactly so where replays are bit-identical: then nothing varies, nothing can
  leak, and an effect size is not applicable;
* ``inconclusive`` where there is nothing to examine, or too little for the gate to be able to fail.

Source: this project's choice; the paper's audit compares accuracies of classifiers ("Collection Integrity, Replay
Fidelity, and Leakage").
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.draw import Draw, drawn_here
from branchdrive.leakage.gate_statistics import GateStatistics
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.leakage.scan import Layout
from branchdrive.leakage.sensitivity import Sensitivity, sensitivity
from branchdrive.leakage.streams import Streams
from branchdrive.leakage.table import Kind, checked, rows_agree
from branchdrive.statistics.holm import holm
from branchdrive.statistics.permutation import identity, labels, p_value

__all__ = [
    "IDENTICAL", "NOTHING", "Code", "Gate", "Outcome", "Place", "Verdict", "dealt", "dealt_streams", "gate_verdict",
    "leakage_gate", "strongest_codes", "strongest_places", "too_few",
]  # fmt: skip

NOTHING = "There is nothing to examine."
IDENTICAL = "All rows of every group are identical."
"""Reasons of a gate without statistics, and of one without differences."""

Array = NDArray[np.float64]
Verdict = Literal["pass", "fail", "inconclusive"]


class Outcome(NamedTuple):
    """One statistic: name of `STATISTICS`, observed value, p-value, and p-value adjusted by Holm."""

    name: str
    observed: float
    p: float
    p_adjusted: float


class Place(NamedTuple):
    """Where an action differs from the others of its group.

    Attributes:
        feature: Index of the feature.
        action: Index of the action.
        kind: What of the feature differs.
        t: Standardised mean, as `max_t` sees it.
        difference: Mean of the action minus mean of the others: standard deviations, or a share where the
            kind is `unavailable`.
        p: p-value of this place, adjusted for all places by the null distribution of `max_t`.
    """

    feature: int
    action: int
    kind: Kind
    t: float
    difference: float
    p: float


class Code(NamedTuple):
    """Where a statistic of the scan is large.

    Attributes:
        statistic: ``concordance`` or ``interaction``.
        columns: Places among features and, behind them, columns of streams.
        num_groups: Groups that it was computed over.
        value: How large it is.
        p: p-value of this place, adjusted for all places of the statistic by its null distribution.
    """

    statistic: str
    columns: tuple[int, ...]
    num_groups: int
    value: float
    p: float


@dataclass(frozen=True)
class Gate:
    """Result of a leakage gate.

    Attributes:
        verdict: Whether the release may claim that nothing leaks.
        reason: One sentence.
        bit_identical: Whether all rows of every group agree; the effect size is then not applicable.
        shape: Groups, actions and features examined.
        num_columns: Columns of streams examined beside them.
        seed: Of permutations, frequencies and replicates.
        protocol: Numbers of the gate.
        bandwidth: Of the kernel, as used; None where nothing was computed.
        tests: In the order of `STATISTICS`; empty where nothing was computed.
        places: Largest first; empty where nothing was computed.
        codes: Of concordance, largest first, and then of interaction; empty where nothing was computed.
        sensitivity: Minimum detectable effect; None where rows are identical or nothing was computed.
    """

    verdict: Verdict
    reason: str
    bit_identical: bool
    shape: tuple[int, int, int]
    num_columns: int
    seed: int
    protocol: GateProtocol
    bandwidth: float | None
    tests: tuple[Outcome, ...]
    places: tuple[Place, ...]
    codes: tuple[Code, ...]
    sensitivity: Sensitivity | None


def leakage_gate(
    features: ArrayLike,
    *,
    seed: int,
    protocol: GateProtocol | None = None,
    layout: Layout | None = None,
    streams: Streams | None = None,
    draw: Draw = drawn_here,
) -> Gate:
    """Judge replay-specific features from before the branch.

    Args:
        features: ``[groups, actions, features]``, exchangeable over actions within a group where nothing leaks, NaN
            where unavailable. The nominal stays out: it differs from replays by design. Groups come in
            an order that has nothing to do with their features, say by id: folds are dealt by it.
        seed: Of permutations, frequencies and replicates.
        protocol: Numbers of the gate; None is the default.
        layout: How features belong together; None keeps them apart and examines no product.
        streams: Recorded columns of the same groups and actions; None is none.
        draw: How ranges of permutations and replicates are computed, with one thread of linear algebra or all
            with as many as here.

    Raises:
        ValueError: The shape or the seed is wrong.
    """
    protocol = protocol or GateProtocol()
    x = checked(features)
    num_groups, num_actions, num_features = x.shape
    streams = streams or Streams.none(num_groups, num_actions)

    def result(
        verdict: Verdict,
        reason: str,
        *,
        bit_identical: bool = False,
        bandwidth: float | None = None,
        tests: tuple[Outcome, ...] = (),
        places: tuple[Place, ...] = (),
        codes: tuple[Code, ...] = (),
        effect: Sensitivity | None = None,
    ) -> Gate:
        shape = (num_groups, num_actions, num_features)
        return Gate(
            verdict, reason, bit_identical, shape, len(streams.columns), seed, protocol, bandwidth, tests, places,
            codes, effect,
        )  # fmt: skip

    if not x.size:
        return result("inconclusive", NOTHING)
    if rows_agree(x) and streams.are_identical:
        tests = tuple(Outcome(name, 0.0, 1.0, 1.0) for name in STATISTICS)
        return result("pass", IDENTICAL, bit_identical=True, tests=tests)
    if num_groups < protocol.num_folds:
        return result("inconclusive", too_few(num_groups, protocol))

    x = dealt(x, protocol.num_folds)
    statistics = GateStatistics.of(
        x, protocol, seed=seed, layout=layout, streams=dealt_streams(streams, protocol.num_folds)
    )
    observed = statistics.observed()
    null = statistics.null(protocol.num_permutations, seed=seed, scratch_bytes=protocol.scratch_bytes, draw=draw)
    p = [p_value(value, column) for value, column in zip(observed.tolist(), null.T, strict=True)]
    tests = tuple(map(Outcome, STATISTICS, observed.tolist(), p, holm(p).tolist()))
    places = strongest_places(statistics, null[:, STATISTICS.index("max_t")], protocol.num_named)
    codes = strongest_codes(statistics, null, protocol.num_named)
    reference = statistics.reference
    del statistics  # makes room for those of the replicates
    effect = sensitivity(x, reference, null, protocol=protocol, seed=seed, draw=draw)
    verdict, reason = gate_verdict(tests, protocol)
    return result(
        verdict, reason, bandwidth=reference.bandwidth, tests=tests, places=places, codes=codes, effect=effect
    )


def dealt(features: Array, num_folds: int) -> Array:
    """Groups dealt in turn, so that folds, which are runs, hold every `num_folds`-th of them."""
    return features[_deal(len(features), num_folds)]


def dealt_streams(streams: Streams, num_folds: int) -> Streams:
    """Columns of the groups in the order of `dealt`."""
    order = _deal(len(streams.ranks), num_folds)
    return Streams(streams.columns, streams.ranks[order], streams.spread[order])


def _deal(num_groups: int, num_folds: int) -> NDArray[np.intp]:
    return np.argsort(np.arange(num_groups) % num_folds, kind="stable")


def too_few(num_groups: int, protocol: GateProtocol) -> str:
    """Reason of a gate on fewer groups than folds."""
    return f"{num_groups} groups cannot fill {protocol.num_folds} folds."


def gate_verdict(tests: tuple[Outcome, ...], protocol: GateProtocol) -> tuple[Verdict, str]:
    """Verdict and reason of the statistics of features that were examined, at least one statistic."""
    strongest = min(tests, key=lambda test: test.p_adjusted)
    least = len(tests) / (protocol.num_permutations + 1)
    if strongest.p_adjusted <= protocol.alpha:
        return "fail", f"`{strongest.name}` has adjusted p {strongest.p_adjusted:.2g}, at most {protocol.alpha:g}."
    if least > protocol.alpha:
        return "inconclusive", (
            f"{protocol.num_permutations} permutations reach an adjusted p of {least:.2g} at best, "
            f"above {protocol.alpha:g}."
        )
    return "pass", f"No adjusted p is at most {protocol.alpha:g}; the smallest is {strongest.p_adjusted:.2g}."


def strongest_places(statistics: GateStatistics, null: Array, num_named: int) -> tuple[Place, ...]:
    """Places of the largest ``|t|``, largest first, with their p under the null distribution ``[B]`` of `max_t`."""
    table = statistics.table
    scores = statistics.max_t.scores(labels(identity(table.num_groups, table.num_actions)))[0]
    values = table.values
    means = values.mean(axis=0) - values.mean(axis=(0, 1))
    means *= table.num_actions / (table.num_actions - 1)
    places = []
    for index in np.argsort(-np.abs(scores), axis=None, kind="stable")[:num_named].tolist():
        action, column = divmod(index, len(table.columns))
        feature, kind = table.columns[column]
        t = float(scores[action, column])
        places.append(Place(feature, action, kind, t, float(means[action, column]), p_value(abs(t), null)))
    return tuple(places)


def strongest_codes(statistics: GateStatistics, null: Array, num_named: int) -> tuple[Code, ...]:
    """Places of the largest concordance, then of the largest interaction, each largest first.

    Args:
        statistics: Statistics.
        null: Their null distribution ``[permutations, statistics]``.
        num_named: Places of each, at most.
    """
    rows = identity(statistics.table.num_groups, statistics.table.num_actions)
    codes: list[Code] = []
    for name, statistic in (("concordance", statistics.concordance), ("interaction", statistics.interaction)):
        column = null[:, STATISTICS.index(name)]
        codes += [Code(name, *place, p_value(place.value, column)) for place in statistic.places(rows, num_named)]
    return tuple(codes)
