"""What follows from the numbers of a leakage document alone.

Counts of gate and battery follow from its inputs, adjusted p-values and verdict of the gate from its p-values, and
statuses of the battery from its scores. Every document here conforms to `schemas/v0.1/leakage.schema.json`.

Source: spec/13-leakage.md#document.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.layers.compare import format_cell
from branchdrive.leakage.battery import PARTITIONS
from branchdrive.leakage.gate import IDENTICAL, NOTHING, Outcome, gate_verdict, too_few
from branchdrive.leakage.inputs import CONTROL_SPANS
from branchdrive.leakage.protocol import SEQUENCE_TESTS, STATISTICS, AuditProtocol, GateProtocol
from branchdrive.leakage.score import MEASURES, judged_battery
from branchdrive.leakage.sensitivity import PATTERNS, Detection, Sensitivity, offsets_of
from branchdrive.leakage.streams import IMAGES, WINDOWS, stream_columns
from branchdrive.statistics.holm import holm
from branchdrive.statistics.permutation import critical_rank

__all__ = [
    "REL",
    "battery_mismatches",
    "count_mismatches",
    "gate_mismatches",
    "mismatch_at",
    "protocol_mismatches",
    "value_mismatches",
]

REL = 1e-6
"""Relative difference of numbers that are equal."""

_ABS = 1e-9

_PLACES = {"discrepancy": 1, "ego": HISTORY_OBSERVATIONS, "controls": len(CONTROL_SPANS), "availability": 1}
"""Features that each variable of a source gives."""


def mismatch_at(pointer: str, expected: Any, found: Any) -> Mismatch:
    """A place of a document, by JSON pointer, that says something else than what follows; text stands as it is."""
    wanted, recorded = (value if isinstance(value, str) else format_cell(value) for value in (expected, found))
    return Mismatch({"pointer": pointer}, wanted, recorded)


def value_mismatches(pointer: str, expected: Any, found: Any) -> Iterator[Mismatch]:
    """Places where two JSON values differ, numbers by more than a relative 1e-6."""
    if isinstance(expected, Mapping) and isinstance(found, Mapping) and expected.keys() == found.keys():
        for key in expected:
            yield from value_mismatches(
                f"{pointer}/{key.replace('~', '~0').replace('/', '~1')}", expected[key], found[key]
            )
    elif isinstance(expected, list) and isinstance(found, list):
        if len(expected) != len(found):
            yield mismatch_at(pointer, f"{len(expected)} entries", f"{len(found)} entries")
            return
        for index, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from value_mismatches(f"{pointer}/{index}", one, other)
    elif isinstance(expected, float) and type(found) in (int, float):
        if not math.isclose(expected, found, rel_tol=REL, abs_tol=_ABS):
            yield mismatch_at(pointer, expected, found)
    elif expected != found:
        yield mismatch_at(pointer, expected, found)


def protocol_mismatches(document: Mapping[str, Any]) -> Iterator[Mismatch]:
    """Numbers of the protocol against those of the specification, exactly."""
    for part, numbers in AuditProtocol().as_json().items():
        for name, value in numbers.items():
            if document["protocol"][part][name] != value:
                yield mismatch_at(f"/protocol/{part}/{name}", value, document["protocol"][part][name])


def count_mismatches(document: Mapping[str, Any]) -> Iterator[Mismatch]:
    """Groups, actions, features and ways of gate and battery against the counts and names of its inputs."""
    inputs = document["inputs"]
    num_actions = len(inputs["action_keys"])
    shape = {
        "groups": sum(inputs["num_groups"].values()),
        "actions": num_actions - 1,
        "features": sum(len(inputs["variables"][source]) * count for source, count in _PLACES.items()),
        "columns": _num_columns(inputs["variables"]["streams"]),
    }
    yield from value_mismatches("/gate/shape", shape, document["gate"]["shape"])
    ways = [(num_actions, inputs["num_nominal_replays"]), (num_actions - 1, inputs["num_groups"])]
    for index, (way, (size, counts)) in enumerate(zip(document["battery"]["ways"], ways, strict=True)):
        num_groups = {name: counts.get(name, 0) for name in way["num_groups"]}
        expected = {"name": f"{size}-way", "num_actions": size, "num_groups": num_groups}
        yield from value_mismatches(f"/battery/ways/{index}", expected, {name: way[name] for name in expected})


def _num_columns(names: Sequence[str]) -> int:
    """Columns that the tables of recorded columns ``TABLE/COLUMN`` give, and the cells of images among them."""
    tables = {name.partition("/")[0] for name in names}
    num_cells = sum(name.startswith(f"{IMAGES}/") for name in names)
    return len(stream_columns(tuple(table for table in WINDOWS if table in tables))) + num_cells * HISTORY_OBSERVATIONS


def gate_mismatches(document: Mapping[str, Any]) -> Iterator[Mismatch]:
    """Adjusted p-values, verdict and effect size of the gate against its p-values, `alpha` and permutations.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    gate, protocol = document["gate"], AuditProtocol.from_json(document["protocol"]).gate
    tests, shape = gate["tests"], gate["shape"]
    for kind in ("places", "codes"):
        for index, place in enumerate(gate[kind]):
            yield from _p_mismatches(f"/gate/{kind}/{index}/p", place["p"], protocol.num_permutations)
    if not tests:
        is_there = all(shape[name] for name in ("groups", "actions", "features"))
        if is_there and shape["groups"] >= protocol.num_folds:
            yield from value_mismatches("/gate/tests", list(STATISTICS), tests)
        else:
            reason = too_few(shape["groups"], protocol) if is_there else NOTHING
            yield from value_mismatches("/gate/reason", reason, gate["reason"])
        yield from value_mismatches("/gate/minimum_detectable_effect", None, gate["minimum_detectable_effect"])
        yield from value_mismatches("/gate/verdict", "inconclusive", gate["verdict"])
        return
    yield from value_mismatches("/gate/tests", list(STATISTICS), [test["name"] for test in tests])
    adjusted = holm([test["p"] for test in tests]).tolist()
    for index, (test, p) in enumerate(zip(tests, adjusted, strict=True)):
        pointer = f"/gate/tests/{index}"
        if gate["bit_identical"]:
            yield from value_mismatches(f"{pointer}/p", 1.0, test["p"])
        else:
            yield from _p_mismatches(f"{pointer}/p", test["p"], protocol.num_permutations)
        yield from value_mismatches(f"{pointer}/p_adjusted", p, test["p_adjusted"])
    outcomes = tuple(Outcome(t["name"], t["observed"], t["p"], p) for t, p in zip(tests, adjusted, strict=True))
    verdict, reason = ("pass", IDENTICAL) if gate["bit_identical"] else gate_verdict(outcomes, protocol)
    yield from value_mismatches("/gate/verdict", verdict, gate["verdict"])
    yield from value_mismatches("/gate/reason", reason, gate["reason"])
    yield from _effect_mismatches(gate, protocol)


def _effect_mismatches(gate: Mapping[str, Any], protocol: GateProtocol) -> Iterator[Mismatch]:
    """Minimum detectable effect against its detections, and critical values against the p-values."""
    recorded, pointer = gate["minimum_detectable_effect"], "/gate/minimum_detectable_effect"
    if gate["bit_identical"]:
        yield from value_mismatches(pointer, None, recorded)
        return
    if recorded is None:
        yield mismatch_at(pointer, "an effect size, since rows differ", recorded)
        return
    detections = tuple(Detection(**{**found, "shares": tuple(found["shares"])}) for found in recorded["detections"])
    effect = Sensitivity(protocol.alpha / len(STATISTICS), (), detections)
    yield from value_mismatches(f"{pointer}/alpha", effect.alpha, recorded["alpha"])
    expected = [[pattern, offset_sd] for pattern in PATTERNS for offset_sd in offsets_of(pattern, protocol)]
    yield from value_mismatches(f"{pointer}/detections", expected, [[d.pattern, d.offset_sd] for d in detections])
    smallest = {pattern: effect.smallest_sd(pattern) for pattern in PATTERNS}
    yield from value_mismatches(f"{pointer}/smallest_sd", smallest, recorded["smallest_sd"])
    for index, detection in enumerate(detections):
        yield from _detection_mismatches(f"{pointer}/detections/{index}", detection, protocol.num_replicates)
    is_finite = 1 <= critical_rank(protocol.num_permutations, effect.alpha) <= protocol.num_permutations
    for index, (test, critical) in enumerate(zip(gate["tests"], recorded["critical"], strict=False)):
        if is_finite != (critical is not None):
            yield mismatch_at(f"{pointer}/critical/{index}", "a number" if is_finite else None, critical)
            continue
        beyond = critical is not None and test["observed"] > critical
        tied = critical is not None and math.isclose(test["observed"], critical, rel_tol=REL)
        if not tied and beyond != (test["p"] <= effect.alpha * (1 + REL)):
            yield mismatch_at(f"{pointer}/critical/{index}", f"p {test['p']!r} of {test['observed']!r}", critical)


def _detection_mismatches(pointer: str, found: Detection, num_replicates: int) -> Iterator[Mismatch]:
    """Shares are of whole replicates, and the gate finds what a statistic finds, and no more."""
    for name, share in (*((f"shares/{i}", s) for i, s in enumerate(found.shares)), ("gate_share", found.gate_share)):
        yield from value_mismatches(f"{pointer}/{name}", round(share * num_replicates) / num_replicates, share)
    least, most = max(found.shares), min(1.0, sum(found.shares))
    if not least - REL <= found.gate_share <= most + REL:
        yield mismatch_at(f"{pointer}/gate_share", f"{least:g} .. {most:g}", found.gate_share)


def battery_mismatches(document: Mapping[str, Any]) -> Iterator[Mismatch]:
    """Chance, controls, adjusted p-values and statuses of the battery against its scores.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    battery, protocol = document["battery"], AuditProtocol.from_json(document["protocol"]).battery
    has_classifier = document["protocol"]["sequence_classifier"] is not None
    not_run = []
    for index, way in enumerate(battery["ways"]):
        for kind in ("controls", "tests"):
            for place, result in enumerate(way[kind]):
                pointer, score = f"/battery/ways/{index}/{kind}/{place}/score", result["score"]
                if _can_run(way, result["name"], has_classifier) != (score is not None):
                    yield mismatch_at(pointer, "a score" if score is None else None, score)
                if score is None:
                    not_run.append({"test": f"{way['name']}/{result['name']}", "reason": result["reason"]})
                else:
                    yield from _range_mismatches(pointer, score, way["num_actions"], protocol.num_permutations)
    yield from value_mismatches("/not_run", not_run, document["not_run"])
    yield from value_mismatches("/battery", judged_battery(battery["ways"], protocol), battery)


def _can_run(way: Mapping[str, Any], name: str, has_classifier: bool) -> bool:
    """A part runs where its partitions have groups and, if it is recurrent, there is a classifier."""
    is_recurrent = name in SEQUENCE_TESTS
    needed = PARTITIONS if is_recurrent else ("train", "test")
    return all(way["num_groups"].get(partition, 0) for partition in needed) and (has_classifier or not is_recurrent)


def _range_mismatches(
    pointer: str, score: Mapping[str, Any], num_actions: int, num_permutations: int
) -> Iterator[Mismatch]:
    """A score is one that can be: in its interval, at most 0 as a log-likelihood, and at chance where identical."""
    low, high = score["accuracy_interval"]
    if not low - REL <= score["accuracy"] <= high + REL:
        yield mismatch_at(f"{pointer}/accuracy", f"{low!r} .. {high!r}", score["accuracy"])
    if score["log_likelihood"] > 0:
        yield mismatch_at(f"{pointer}/log_likelihood", "at most 0", score["log_likelihood"])
    if score["identical"]:
        at_chance = {"accuracy": 1 / num_actions, "p_accuracy": 1.0, "p_log_likelihood": 1.0}
        yield from value_mismatches(pointer, at_chance, {name: score[name] for name in at_chance})
    else:
        for measure in MEASURES:
            yield from _p_mismatches(f"{pointer}/p_{measure}", score[f"p_{measure}"], num_permutations)


def _p_mismatches(pointer: str, p: float, num_permutations: int) -> Iterator[Mismatch]:
    """A p-value of `num_permutations` permutations is a whole number of shares."""
    count = p * (num_permutations + 1)
    whole = max(1, round(count))
    if abs(count - whole) > REL:
        yield mismatch_at(pointer, whole / (num_permutations + 1), p)
