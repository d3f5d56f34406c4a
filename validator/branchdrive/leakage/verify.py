"""What an auditor checks of a leakage document.

From the document alone: verdict and adjusted p-values of the gate, and statuses of the battery, follow from
its numbers. From inputs that were recomputed: digest, counts and names agree, the observed statistics and
places of the gate come out again, with p-values that fit permutations drawn again, and so do the scores of
regressions. Every document here conforms to `schemas/v0.1/leakage.schema.json`.

Source: this project's choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.leakage.agreement import REL, Difference, compared, rows_agree
from branchdrive.leakage.audit import AuditProtocol, described_inputs
from branchdrive.leakage.battery import Battery
from branchdrive.leakage.gate import IDENTICAL, NOTHING, Outcome, dealt, gate_verdict, strongest_places, too_few
from branchdrive.leakage.gate_input import CONTROL_SPANS, gate_features
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.parity import PARTITIONS
from branchdrive.leakage.parity_protocol import SEQUENCE_TESTS, ParityProtocol
from branchdrive.leakage.protocol import STATISTICS, Protocol
from branchdrive.leakage.redraw import redrawn_differences
from branchdrive.leakage.rescore import rescored_differences
from branchdrive.leakage.sensitivity import PATTERNS, Detection, Sensitivity
from branchdrive.leakage.status import judged_battery
from branchdrive.statistics.holm import holm
from branchdrive.statistics.permutation import critical_rank

__all__ = [
    "Difference",
    "battery_differences",
    "count_differences",
    "gate_differences",
    "input_differences",
    "protocol_differences",
    "protocol_of",
    "score_differences",
    "statistic_differences",
]

_PLACES = {
    "discrepancy": 1,
    "ego": HISTORY_OBSERVATIONS,
    "controls": len(CONTROL_SPANS),
    "availability": 1,
}


def protocol_of(document: Mapping[str, Any]) -> AuditProtocol:
    """Protocol that the document names.

    Raises:
        ValueError: A number is outside of its range.
    """
    gate, parity = (_with_whole_counts(document["protocol"][part]) for part in ("gate", "parity"))
    offsets_sd = tuple(gate.pop("offsets_sd"))
    return AuditProtocol(Protocol(offsets_sd=offsets_sd, **gate), ParityProtocol(**parity))


def _with_whole_counts(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Counts as integers, also where the document writes them as ``1.0``."""
    return {name: int(value) if name.startswith("num_") else value for name, value in numbers.items()}


def protocol_differences(document: Mapping[str, Any]) -> list[Difference]:
    """Numbers of the protocol against those of the specification, exactly."""
    said = document["protocol"]
    return [
        Difference(f"/protocol/{part}/{name}", value, said[part][name])
        for part, numbers in AuditProtocol().as_json().items()
        for name, value in numbers.items()
        if said[part][name] != value
    ]


def input_differences(document: Mapping[str, Any], inputs: ReplayInputs) -> list[Difference]:
    """Digest, counts and names against recomputed inputs."""
    return list(compared("/inputs", described_inputs(inputs), document["inputs"]))


def count_differences(document: Mapping[str, Any]) -> list[Difference]:
    """Groups, actions, features and ways of gate and battery against the counts and names of its inputs."""
    said = document["inputs"]
    num_interventions = len(said["action_keys"]) - 1
    num_groups = sum(said["num_groups"].values())
    found = list(compared("/gate/shape/groups", num_groups, document["gate"]["shape"]["groups"]))
    found += compared("/gate/shape/actions", num_interventions, document["gate"]["shape"]["actions"])
    expected = [
        (num_interventions + 1, said["num_nominal_replays"]),
        (num_interventions, said["num_groups"]),
    ]
    for index, (way, (num_actions, counts)) in enumerate(zip(document["battery"]["ways"], expected, strict=True)):
        place = f"/battery/ways/{index}"
        found += compared(f"{place}/name", f"{num_actions}-way", way["name"])
        found += compared(f"{place}/num_actions", num_actions, way["num_actions"])
        used = {name: counts.get(name, 0) for name in way["num_groups"]}
        found += compared(f"{place}/num_groups", used, way["num_groups"])
    num_features = sum(len(said["variables"][source]) * count for source, count in _PLACES.items())
    found += compared("/gate/shape/features", num_features, document["gate"]["shape"]["features"])
    return found


def statistic_differences(document: Mapping[str, Any], inputs: ReplayInputs) -> list[Difference]:
    """Statistics, bandwidth, places, p-values and effect size of the gate against those of recomputed inputs.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    gate, protocol = document["gate"], protocol_of(document).gate
    x, columns = gate_features(inputs)
    if not x.size or len(x) < protocol.num_folds or rows_agree(x):
        expected: dict[str, Any] = {"bit_identical": bool(x.size) and rows_agree(x), "bandwidth": None, "places": []}
        found = list(compared("/gate", expected, {name: gate[name] for name in expected}))
        num_tests = len(STATISTICS) if expected["bit_identical"] else 0
        return found + list(compared("/gate/tests", num_tests, len(gate["tests"])))
    if not gate["tests"]:
        return [Difference("/gate/tests", list(STATISTICS), [])]
    x = dealt(x, protocol.num_folds)
    battery = Battery.of(x, protocol, seed=int(document["seed"]))
    found = list(compared("/gate/bit_identical", False, gate["bit_identical"]))
    found += compared("/gate/bandwidth", battery.reference.bandwidth, gate["bandwidth"])
    said = [{name: test[name] for name in ("name", "observed")} for test in gate["tests"]]
    observed = [
        {"name": name, "observed": value} for name, value in zip(STATISTICS, battery.observed().tolist(), strict=True)
    ]
    found += compared("/gate/tests", observed, said)
    keys = [inputs.action_keys[index] for index in inputs.interventions]
    empty = battery.table.values[:0, 0, 0]
    strongest = strongest_places(battery, empty, protocol.num_named)
    places = [
        {
            "source": columns[place.feature].source,
            "variable": columns[place.feature].name,
            "offset_ticks": None if (span := columns[place.feature].offset_ticks) is None else list(span),
            "action": keys[place.action],
            "kind": place.kind,
            "t": place.t,
            "difference": place.difference,
        }
        for place in strongest
    ]
    named = [{name: value for name, value in place.items() if name != "p"} for place in gate["places"]]
    found += compared("/gate/places", places, named)
    return found + redrawn_differences(gate, x, battery, strongest, protocol, int(document["seed"]))


def score_differences(document: Mapping[str, Any], inputs: ReplayInputs) -> list[Difference]:
    """Scores of controls and regressions of the battery against those of recomputed inputs.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    return rescored_differences(document["battery"], inputs, protocol_of(document).parity, int(document["seed"]))


def gate_differences(document: Mapping[str, Any]) -> list[Difference]:
    """Adjusted p-values and verdict of the gate against its p-values, `alpha` and permutations.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    gate, protocol = document["gate"], protocol_of(document).gate
    tests = gate["tests"]
    found: list[Difference] = []
    for index, place in enumerate(gate["places"]):
        found += _attainable(f"/gate/places/{index}/p", place["p"], protocol.num_permutations)
    if not tests:
        shape = gate["shape"]
        if all(shape.values()) and shape["groups"] >= protocol.num_folds:
            found += compared("/gate/tests", list(STATISTICS), [])
        else:
            reason = too_few(shape["groups"], protocol) if all(shape.values()) else NOTHING
            found += compared("/gate/reason", reason, gate["reason"])
        found += compared("/gate/minimum_detectable_effect", None, gate["minimum_detectable_effect"])
        return found + list(compared("/gate/verdict", "inconclusive", gate["verdict"]))
    found += compared("/gate/tests", list(STATISTICS), [test["name"] for test in tests])
    adjusted = holm([test["p"] for test in tests]).tolist()
    for index, (test, p) in enumerate(zip(tests, adjusted, strict=True)):
        if gate["bit_identical"]:
            found += compared(f"/gate/tests/{index}/p", 1.0, test["p"])
        else:
            found += _attainable(f"/gate/tests/{index}/p", test["p"], protocol.num_permutations)
        found += compared(f"/gate/tests/{index}/p_adjusted", p, test["p_adjusted"])
    outcomes = tuple(Outcome(t["name"], t["observed"], t["p"], p) for t, p in zip(tests, adjusted, strict=True))
    verdict, reason = ("pass", IDENTICAL) if gate["bit_identical"] else gate_verdict(outcomes, protocol)
    found += compared("/gate/verdict", verdict, gate["verdict"])
    found += compared("/gate/reason", reason, gate["reason"])
    return found + list(_effect_differences(gate, protocol))


def _effect_differences(gate: Mapping[str, Any], protocol: Protocol) -> Iterator[Difference]:
    """Minimum detectable effect against its detections, and critical values against the p-values."""
    said, pointer = gate["minimum_detectable_effect"], "/gate/minimum_detectable_effect"
    if gate["bit_identical"]:
        yield from compared(pointer, None, said)
        return
    if said is None:
        yield Difference(pointer, "an effect size, since rows differ", said)
        return
    detections = tuple(Detection(**{**found, "shares": tuple(found["shares"])}) for found in said["detections"])
    effect = Sensitivity(protocol.alpha / len(STATISTICS), (), detections)
    yield from compared(f"{pointer}/alpha", effect.alpha, said["alpha"])
    expected = [[pattern, offset_sd] for pattern in PATTERNS for offset_sd in protocol.offsets_sd]
    yield from compared(f"{pointer}/detections", expected, [[d.pattern, d.offset_sd] for d in detections])
    smallest = {pattern: effect.smallest_sd(pattern) for pattern in PATTERNS}
    yield from compared(f"{pointer}/smallest_sd", smallest, said["smallest_sd"])
    for index, detection in enumerate(detections):
        yield from _share_differences(f"{pointer}/detections/{index}", detection, protocol.num_replicates)
    is_finite = 1 <= critical_rank(protocol.num_permutations, effect.alpha) <= protocol.num_permutations
    for index, (test, critical) in enumerate(zip(gate["tests"], said["critical"], strict=False)):
        if is_finite != (critical is not None):
            yield Difference(f"{pointer}/critical/{index}", "a number" if is_finite else None, critical)
            continue
        beyond = critical is not None and test["observed"] > critical
        tied = critical is not None and math.isclose(test["observed"], critical, rel_tol=REL)
        if not tied and beyond != (test["p"] <= effect.alpha * (1 + REL)):
            yield Difference(f"{pointer}/critical/{index}", f"p {test['p']!r} of {test['observed']!r}", critical)


def _share_differences(pointer: str, found: Detection, num_replicates: int) -> Iterator[Difference]:
    """Shares are of whole replicates, and the gate finds what a statistic finds, and no more."""
    for name, share in (*((f"shares/{i}", s) for i, s in enumerate(found.shares)), ("gate_share", found.gate_share)):
        yield from compared(f"{pointer}/{name}", round(share * num_replicates) / num_replicates, share)
    least, most = max(found.shares), min(1.0, sum(found.shares))
    if not least - REL <= found.gate_share <= most + REL:
        yield Difference(f"{pointer}/gate_share", f"{least:g} .. {most:g}", found.gate_share)


def battery_differences(document: Mapping[str, Any]) -> list[Difference]:
    """Chance, controls, adjusted p-values and statuses of the battery against its scores.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    battery, protocol = document["battery"], protocol_of(document).parity
    found: list[Difference] = []
    missing = []
    has_classifier = document["protocol"]["sequence_classifier"] is not None
    for index, way in enumerate(battery["ways"]):
        for kind in ("controls", "tests"):
            for place, result in enumerate(way[kind]):
                pointer, score = f"/battery/ways/{index}/{kind}/{place}/score", result["score"]
                found += _run_differences(pointer, way, result, has_classifier)
                if score is None:
                    missing.append({"test": f"{way['name']}/{result['name']}", "reason": result["reason"]})
                    continue
                found += _range_differences(pointer, score)
                if score["identical"]:
                    at_chance = {"accuracy": 1 / way["num_actions"], "p_accuracy": 1.0, "p_log_likelihood": 1.0}
                    found += compared(pointer, at_chance, {name: score[name] for name in at_chance})
                else:
                    for name in ("p_accuracy", "p_log_likelihood"):
                        found += _attainable(f"{pointer}/{name}", score[name], protocol.num_permutations)
    found += compared("/not_run", missing, document["not_run"])
    follows = judged_battery(battery["ways"], protocol)
    return found + list(compared("/battery", follows, battery))


def _run_differences(
    pointer: str, way: Mapping[str, Any], result: Mapping[str, Any], has_classifier: bool
) -> Iterator[Difference]:
    """A part runs where its partitions have groups and, if it is recurrent, there is a classifier; else it cannot."""
    is_recurrent = result["name"] in SEQUENCE_TESTS
    needed = PARTITIONS if is_recurrent else ("train", "test")
    can_run = all(way["num_groups"].get(name, 0) for name in needed) and (has_classifier or not is_recurrent)
    if can_run != (result["score"] is not None):
        yield Difference(pointer, "a score" if can_run else None, result["score"])


def _range_differences(pointer: str, score: Mapping[str, Any]) -> Iterator[Difference]:
    """An accuracy is within its interval, which ascends, and a log-likelihood is at most 0."""
    low, high = score["accuracy_interval"]
    if not low - REL <= score["accuracy"] <= high + REL:
        yield Difference(f"{pointer}/accuracy", f"{low!r} .. {high!r}", score["accuracy"])
    if score["log_likelihood"] > 0:
        yield Difference(f"{pointer}/log_likelihood", "at most 0", score["log_likelihood"])


def _attainable(pointer: str, p: float, num_permutations: int) -> Iterator[Difference]:
    """A p-value of `num_permutations` permutations is a whole number of shares."""
    count = p * (num_permutations + 1)
    whole = max(1, round(count))
    if abs(count - whole) > REL:
        yield Difference(pointer, whole / (num_permutations + 1), p)
