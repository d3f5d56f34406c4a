"""What an auditor finds in a leakage document who has the inputs of the audit.

Statistics and places of the gate come out again, and so do scores of regressions, which have one solution;
recurrent tests train networks and are taken as stated.

Permutations are functions of seed and number, so an auditor draws the first of them as the audit did: 199, and on
in doubling numbers until 3 reach every statistic or all are drawn. A p-value that would fail the gate is so
judged on all permutations, and one that is far from it on few. The effect size is judged on the first replicate
at the offsets that decide it.

Source: spec/13-leakage.md#document.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mismatch
from branchdrive.leakage.audit import code_as_json, described_inputs, gate_as_json, place_as_json
from branchdrive.leakage.battery import ways
from branchdrive.leakage.classifier import Unavailable
from branchdrive.leakage.gate import Code, Place, dealt, dealt_streams, leakage_gate, strongest_codes, strongest_places
from branchdrive.leakage.gate_statistics import GateStatistics
from branchdrive.leakage.inputs import ReplayInputs, gate_features
from branchdrive.leakage.protocol import SEQUENCE_TESTS, STATISTICS, AuditProtocol, GateProtocol
from branchdrive.leakage.scan import Layout
from branchdrive.leakage.score import MEASURES
from branchdrive.leakage.sensitivity import PATTERNS, replicate_values
from branchdrive.leakage.table import rows_agree
from branchdrive.leakage.verify import REL, mismatch_at, value_mismatches
from branchdrive.statistics.permutation import critical_rank, is_plausible, reaching

__all__ = ["input_mismatches", "score_mismatches", "statistic_mismatches"]

Array = NDArray[np.float64]

_FIRST = 199
"""Permutations of the gate that are drawn at least."""

_REACHED = 3
"""Permutations that must reach every statistic before no more are drawn."""

_HELD_OUT = 1_999
"""Permutations of a score that are drawn: 20 of them at least reach a p-value that is not near the level."""


def input_mismatches(document: Mapping[str, Any], inputs: ReplayInputs) -> Iterator[Mismatch]:
    """Digest, counts and names of a document against recomputed inputs."""
    yield from value_mismatches("/inputs", described_inputs(inputs), document["inputs"])


def statistic_mismatches(document: Mapping[str, Any], inputs: ReplayInputs) -> Iterator[Mismatch]:
    """Statistics, bandwidth, places, p-values and effect size of the gate against those of recomputed inputs.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    recorded, seed = document["gate"], int(document["seed"])
    protocol = AuditProtocol.from_json(document["protocol"]).gate
    x, columns = gate_features(inputs)
    keys = [inputs.action_keys[index] for index in inputs.interventions]
    layout, streams = Layout.of(columns), inputs.streams
    if not x.size or len(x) < protocol.num_folds or (rows_agree(x) and streams.are_identical):
        nothing_drawn = leakage_gate(x, seed=seed, protocol=protocol, layout=layout, streams=streams)
        gate = gate_as_json(nothing_drawn, columns, streams.columns, keys)
        expected = {name: gate[name] for name in ("bit_identical", "bandwidth", "places", "codes")}
        yield from value_mismatches("/gate", expected, {name: recorded[name] for name in expected})
        if len(recorded["tests"]) != len(gate["tests"]):
            yield from value_mismatches("/gate/tests", gate["tests"], recorded["tests"])
        return
    if len(recorded["tests"]) != len(STATISTICS):
        yield from value_mismatches("/gate/tests", list(STATISTICS), recorded["tests"])
        return
    x = dealt(x, protocol.num_folds)
    dealt_columns = dealt_streams(streams, protocol.num_folds)
    statistics = GateStatistics.of(x, protocol, seed=seed, layout=layout, streams=dealt_columns)
    observed = statistics.observed()
    places = strongest_places(statistics, protocol.num_named)
    codes = strongest_codes(statistics, protocol.num_named)
    expected = {
        "bit_identical": False,
        "bandwidth": statistics.reference.bandwidth,
        "tests": [{"name": n, "observed": v} for n, v in zip(STATISTICS, observed.tolist(), strict=True)],
        "places": [_without_p(place_as_json(place, columns, keys)) for place in places],
        "codes": [_without_p(code_as_json(code, columns, streams.columns)) for code in codes],
    }
    found = {
        "bit_identical": recorded["bit_identical"],
        "bandwidth": recorded["bandwidth"],
        "tests": [{"name": test["name"], "observed": test["observed"]} for test in recorded["tests"]],
        "places": [_without_p(place) for place in recorded["places"]],
        "codes": [_without_p(code) for code in recorded["codes"]],
    }
    yield from value_mismatches("/gate", expected, found)
    null = _redrawn(statistics, observed, protocol, seed)
    yield from _p_mismatches(recorded, null, observed, places, codes, protocol.num_permutations)
    if (effect := recorded["minimum_detectable_effect"]) is not None:
        yield from _critical_mismatches(effect, null, protocol)
        yield from _detection_mismatches(effect, x, statistics, protocol, seed)


def _without_p(place: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in place.items() if name != "p"}


def _redrawn(statistics: GateStatistics, observed: Array, protocol: GateProtocol, seed: int) -> Array:
    """Null distribution of the first permutations, as many as tell the p-values ``[drawn, statistics]``."""
    total = protocol.num_permutations
    null = np.empty((0, len(STATISTICS)))
    stop = min(_FIRST, total)
    while True:
        more = statistics.null(stop, seed=seed, scratch_bytes=protocol.scratch_bytes, start=len(null))
        null = np.concatenate([null, more])
        if stop == total or (reaching(null, observed) >= _REACHED).all():
            return null
        stop = min(2 * stop, total)


def _p_mismatches(
    gate: Mapping[str, Any],
    null: Array,
    observed: Array,
    places: tuple[Place, ...],
    codes: tuple[Code, ...],
    num_permutations: int,
) -> Iterator[Mismatch]:
    """p-values of statistics and places against the permutations drawn again."""
    largest = null[:, STATISTICS.index("max_t")]
    of_tests = [("tests", i, t, null[:, i], v) for i, (t, v) in enumerate(zip(gate["tests"], observed, strict=True))]
    of_places = [
        ("places", i, named, largest, abs(place.t))
        for i, (place, named) in enumerate(zip(places, gate["places"], strict=False))
    ]
    of_codes = [
        ("codes", i, named, null[:, STATISTICS.index(code.statistic)], code.value)
        for i, (code, named) in enumerate(zip(codes, gate["codes"], strict=False))
    ]
    for kind, index, named, column, value in (*of_tests, *of_places, *of_codes):
        reached = int(reaching(column, value))
        yield from _plausible_mismatches(f"/gate/{kind}/{index}/p", reached, len(column), named["p"], num_permutations)


def _plausible_mismatches(
    pointer: str, reached: int, drawn: int, p: float, num_permutations: int
) -> Iterator[Mismatch]:
    if not is_plausible(reached, drawn, p, num_permutations):
        yield mismatch_at(pointer, f"a p-value that fits {reached:,} of {drawn:,} permutations", p)


def _critical_mismatches(effect: Mapping[str, Any], null: Array, protocol: GateProtocol) -> Iterator[Mismatch]:
    """Fewer permutations than the rank of a critical value exceed it, and of all permutations that many reach it."""
    rank = critical_rank(protocol.num_permutations, protocol.alpha / len(STATISTICS))
    for index, (value, column) in enumerate(zip(effect["critical"], null.T, strict=True)):
        if value is None:
            continue
        pointer = f"/gate/minimum_detectable_effect/critical/{index}"
        beyond = int(np.count_nonzero(column > value + REL * abs(value)))
        reached = int(np.count_nonzero(column >= value - REL * abs(value)))
        if beyond >= rank:
            yield mismatch_at(pointer, f"a value that {beyond:,} of {len(column):,} permutations do not exceed", value)
        elif len(column) == protocol.num_permutations and reached < rank:
            yield mismatch_at(pointer, f"a value that {rank} of {len(column):,} permutations reach", value)


def _detection_mismatches(
    effect: Mapping[str, Any], features: Array, statistics: GateStatistics, protocol: GateProtocol, seed: int
) -> Iterator[Mismatch]:
    """Shares of 0 and 1 against the first replicate, at the smallest offset stated and the largest that was missed."""
    critical = np.array([np.inf if value is None else value for value in effect["critical"]])
    for pattern in PATTERNS:
        of_pattern = [(i, d) for i, d in enumerate(effect["detections"]) if d["pattern"] == pattern]
        missed = [(i, d) for i, d in of_pattern if d["gate_share"] < 1]
        smallest = [(i, d) for i, d in of_pattern if d["offset_sd"] == effect["smallest_sd"][pattern]]
        for index, recorded in (*smallest[:1], *missed[-1:]):
            pointer = f"/gate/minimum_detectable_effect/detections/{index}"
            moved = replicate_values(features, statistics.reference, pattern, recorded["offset_sd"], 0, seed=seed)
            values = np.full(len(critical), -np.inf)
            if moved is not None:
                values = GateStatistics.like(statistics.reference, moved, protocol).observed()
            found, tied = values > critical, np.isclose(values, critical, rtol=REL, atol=0.0)
            for i, share in enumerate(recorded["shares"]):
                yield from _share_mismatches(f"{pointer}/shares/{i}", share, found[i], tied[i])
            yield from _share_mismatches(f"{pointer}/gate_share", recorded["gate_share"], found.any(), tied.any())


def _share_mismatches(pointer: str, share: float, is_found: np.bool_, is_tied: np.bool_) -> Iterator[Mismatch]:
    """A share of all replicates, or of none, against the first of them."""
    if not is_tied and share == (0.0 if is_found else 1.0):
        expected = "above 0: the first replicate is found" if is_found else "below 1: it is missed"
        yield mismatch_at(pointer, expected, share)


def score_mismatches(document: Mapping[str, Any], inputs: ReplayInputs) -> Iterator[Mismatch]:
    """Scores of controls and regressions of the battery against those of recomputed inputs.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    protocol = AuditProtocol.from_json(document["protocol"]).battery
    quick = replace(protocol, num_permutations=min(_HELD_OUT, protocol.num_permutations))
    for index, (way, recorded) in enumerate(zip(ways(inputs), document["battery"]["ways"], strict=True)):
        parts = way.parts(seed=int(document["seed"]), protocol=quick, classifier=Unavailable("not repeated"))
        computed = {part.name: part.compute for part in parts if part.name not in SEQUENCE_TESTS}
        for kind in ("controls", "tests"):
            for place, result in enumerate(recorded[kind]):
                compute = computed.get(result["name"])
                if compute is not None and result["score"] is not None:
                    yield from _score_mismatches(
                        f"/battery/ways/{index}/{kind}/{place}/score",
                        compute()["score"],
                        result["score"],
                        quick.num_permutations,
                        protocol.num_permutations,
                    )


def _score_mismatches(
    pointer: str, score: Mapping[str, Any], recorded: Mapping[str, Any], drawn: int, num_permutations: int
) -> Iterator[Mismatch]:
    """A stated score against one of fewer permutations."""
    names = ("accuracy", "accuracy_interval", "log_likelihood", "identical")
    yield from value_mismatches(pointer, {n: score[n] for n in names}, {n: recorded[n] for n in names})
    for name in () if score["identical"] else (f"p_{measure}" for measure in MEASURES):
        reached = round(score[name] * (drawn + 1)) - 1
        yield from _plausible_mismatches(f"{pointer}/{name}", reached, drawn, recorded[name], num_permutations)
