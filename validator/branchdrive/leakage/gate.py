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

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.draw import ONCE, Kept, KeptHere, Workplace, drawn_here
from branchdrive.leakage.gate_statistics import GateStatistics, Reference, null_distribution
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.leakage.scan import Layout
from branchdrive.leakage.sensitivity import Sensitivity, sensitivity
from branchdrive.leakage.streams import Streams
from branchdrive.leakage.table import Kind, checked, rows_agree
from branchdrive.statistics.holm import holm
from branchdrive.statistics.permutation import identity, labels, p_value

__all__ = [
    "IDENTICAL", "NOTHING", "Code", "Gate", "GateSubject", "Outcome", "Place", "Verdict", "dealt", "dealt_streams",
    "gate_of", "gate_verdict", "leakage_gate", "strongest_codes", "strongest_places", "too_few",
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

    Raises:
        ValueError: The shape or the seed is wrong.
    """
    x = checked(features)
    subject = GateSubject(x, layout, streams or Streams.none(*x.shape[:2]))
    return gate_of(KeptHere(subject), seed=seed, protocol=protocol or GateProtocol(), draw=drawn_here)


class GateSubject(NamedTuple):
    """What a gate judges.

    Attributes:
        features: ``[groups, actions, features]``.
        layout: How features belong together; None keeps them apart.
        streams: Recorded columns of the same groups and actions.
    """

    features: Array
    layout: Layout | None
    streams: Streams


class _Look(NamedTuple):
    """What is known of a subject at once: its shape, number of columns of streams, and whether all rows agree."""

    shape: tuple[int, int, int]
    num_columns: int
    are_identical: bool


def _looked_at(subject: Kept[GateSubject], _: range) -> _Look:
    x, _layout, streams = subject.value
    return _Look(x.shape, len(streams.columns), bool(x.size) and rows_agree(x) and streams.are_identical)


def _dealt(subject: tuple[Kept[GateSubject], int]) -> tuple[Array, None]:
    """Features in folds, which replicates change."""
    kept, num_folds = subject
    return dealt(kept.value.features, num_folds), None


class _Observed(NamedTuple):
    """What statistics say of the labels as recorded, and what permutations and replicates take from them.

    Attributes:
        values: In the order of `STATISTICS`.
        places: Largest first, without p.
        codes: Of concordance and then of interaction, largest first, without p.
        reference: What statistics took from the data once.
        length: Permutations of one chunk.
    """

    values: Array
    places: tuple[Place, ...]
    codes: tuple[Code, ...]
    reference: Reference
    length: int


def _statistics(subject: tuple[Kept[GateSubject], GateProtocol, int]) -> tuple[GateStatistics, _Observed]:
    """Statistics ready for any labels."""
    kept, protocol, seed = subject
    x, layout, streams = kept.value
    made = GateStatistics.of(
        dealt(x, protocol.num_folds),
        protocol,
        seed=seed,
        layout=layout,
        streams=dealt_streams(streams, protocol.num_folds),
    )
    places, codes = strongest_places(made, protocol.num_named), strongest_codes(made, protocol.num_named)
    observed = _Observed(made.observed(), places, codes, made.reference, made.chunk_length(protocol.scratch_bytes))
    return made, observed


def gate_of(subject: Kept[GateSubject], *, seed: int, protocol: GateProtocol, draw: Workplace) -> Gate:
    """Judge features and streams that are kept somewhere; see `leakage_gate`.

    Args:
        subject: Features and streams.
        seed: Of permutations, frequencies and replicates.
        protocol: Numbers of the gate.
        draw: Where statistics are kept and ranges of permutations and replicates are computed, with one thread of
            linear algebra or all with as many as here.
    """
    [(shape, num_columns, are_identical)] = draw(_looked_at, subject, ONCE)
    num_groups = shape[0]

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
        return Gate(
            verdict, reason, bit_identical, shape, num_columns, bandwidth, tests, places, codes, effect,
        )  # fmt: skip

    if not np.prod(shape):
        return result("inconclusive", NOTHING)
    if are_identical:
        tests = tuple(Outcome(name, 0.0, 1.0, 1.0) for name in STATISTICS)
        return result("pass", IDENTICAL, bit_identical=True, tests=tests)
    if num_groups < protocol.num_folds:
        return result("inconclusive", too_few(num_groups, protocol))

    features, _ = draw.keep(_dealt, (subject, protocol.num_folds))
    statistics, observed = draw.keep(_statistics, (subject, protocol, seed))
    null = null_distribution(statistics, protocol.num_permutations, seed=seed, length=observed.length, draw=draw)
    del statistics  # makes room for those of the replicates
    p = [p_value(value, column) for value, column in zip(observed.values.tolist(), null.T, strict=True)]
    tests = tuple(map(Outcome, STATISTICS, observed.values.tolist(), p, holm(p).tolist()))
    largest = null[:, STATISTICS.index("max_t")]
    places = tuple(place._replace(p=p_value(abs(place.t), largest)) for place in observed.places)
    codes = tuple(
        code._replace(p=p_value(code.value, null[:, STATISTICS.index(code.statistic)])) for code in observed.codes
    )
    reference = observed.reference
    effect = sensitivity(features, reference, null, protocol=protocol, seed=seed, draw=draw)
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


def strongest_places(statistics: GateStatistics, num_named: int) -> tuple[Place, ...]:
    """Places of the largest ``|t|``, largest first, whose p is not known yet."""
    table = statistics.table
    scores = statistics.max_t.scores(labels(identity(table.num_groups, table.num_actions)))[0]
    values = table.values
    means = values.mean(axis=0) - values.mean(axis=(0, 1))
    means *= table.num_actions / (table.num_actions - 1)
    places = []
    for index in np.argsort(-np.abs(scores), axis=None, kind="stable")[:num_named].tolist():
        action, column = divmod(index, len(table.columns))
        feature, kind = table.columns[column]
        places.append(
            Place(feature, action, kind, float(scores[action, column]), float(means[action, column]), math.nan)
        )
    return tuple(places)


def strongest_codes(statistics: GateStatistics, num_named: int) -> tuple[Code, ...]:
    """Places of the largest concordance, then of the largest interaction, each largest first, without p.

    Args:
        statistics: Statistics.
        num_named: Places of each, at most.
    """
    rows = identity(statistics.table.num_groups, statistics.table.num_actions)
    codes: list[Code] = []
    for name, statistic in (("concordance", statistics.concordance), ("interaction", statistics.interaction)):
        codes += [Code(name, *place, math.nan) for place in statistic.places(rows, num_named)]
    return tuple(codes)
