"""What an auditor checks of a leakage document without repeating its permutations.

From the document alone: verdict and adjusted p-values of the gate, and statuses of the battery, follow from
its numbers. From inputs that were recomputed: digest, counts and names agree, and the observed statistics and
places of the gate come out again. Every document here conforms to `schemas/v0.1/leakage.schema.json`.

Source: this project's choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.derive.leakage.agreement import rows_agree
from branchdrive.derive.leakage.audit import AuditProtocol, described_inputs
from branchdrive.derive.leakage.battery import Battery
from branchdrive.derive.leakage.gate import Outcome, dealt, gate_verdict, strongest_places
from branchdrive.derive.leakage.gate_input import CONTROL_SPANS, gate_features
from branchdrive.derive.leakage.holm import holm
from branchdrive.derive.leakage.inputs import ReplayInputs
from branchdrive.derive.leakage.parity_protocol import ParityProtocol
from branchdrive.derive.leakage.protocol import STATISTICS, Protocol
from branchdrive.derive.leakage.sensitivity import PATTERNS, Detection, Sensitivity
from branchdrive.derive.leakage.status import judged_battery

__all__ = [
    "Difference",
    "battery_differences",
    "count_differences",
    "gate_differences",
    "input_differences",
    "protocol_of",
    "statistic_differences",
]

_PLACES = {
    "discrepancy": 1,
    "ego": HISTORY_OBSERVATIONS,
    "controls": len(CONTROL_SPANS),
    "availability": 1,
}
_REL = 1e-6
_ABS = 1e-9


class Difference(NamedTuple):
    """One place where a document says something else than what follows.

    Attributes:
        pointer: JSON pointer of the place.
        expected: What follows.
        found: What the document says.
    """

    pointer: str
    expected: Any
    found: Any


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


def input_differences(document: Mapping[str, Any], inputs: ReplayInputs) -> list[Difference]:
    """Digest, counts and names against recomputed inputs."""
    return list(_compared("/inputs", described_inputs(inputs), document["inputs"]))


def count_differences(document: Mapping[str, Any]) -> list[Difference]:
    """Groups, actions, features and ways of gate and battery against the counts and names of its inputs."""
    said = document["inputs"]
    num_interventions = len(said["action_keys"]) - 1
    num_groups = sum(said["num_groups"].values())
    found = list(_compared("/gate/shape/groups", num_groups, document["gate"]["shape"]["groups"]))
    found += _compared("/gate/shape/actions", num_interventions, document["gate"]["shape"]["actions"])
    expected = [
        (num_interventions + 1, said["num_nominal_replays"]),
        (num_interventions, said["num_groups"]),
    ]
    for index, (way, (num_actions, counts)) in enumerate(zip(document["battery"]["ways"], expected, strict=True)):
        place = f"/battery/ways/{index}"
        found += _compared(f"{place}/name", f"{num_actions}-way", way["name"])
        found += _compared(f"{place}/num_actions", num_actions, way["num_actions"])
        used = {name: counts.get(name, 0) for name in way["num_groups"]}
        found += _compared(f"{place}/num_groups", used, way["num_groups"])
    num_features = sum(len(said["variables"][source]) * count for source, count in _PLACES.items())
    found += _compared("/gate/shape/features", num_features, document["gate"]["shape"]["features"])
    return found


def statistic_differences(document: Mapping[str, Any], inputs: ReplayInputs) -> list[Difference]:
    """Observed statistics, bandwidth and places of the gate against those of recomputed inputs.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    gate, protocol = document["gate"], protocol_of(document).gate
    x, columns = gate_features(inputs)
    if not x.size or len(x) < protocol.num_folds or rows_agree(x):
        expected: dict[str, Any] = {"bit_identical": bool(x.size) and rows_agree(x), "bandwidth": None, "places": []}
        return list(_compared("/gate", expected, {name: gate[name] for name in expected}))
    battery = Battery.of(dealt(x, protocol.num_folds), protocol, seed=int(document["seed"]))
    found = list(_compared("/gate/bit_identical", False, gate["bit_identical"]))
    found += _compared("/gate/bandwidth", battery.reference.bandwidth, gate["bandwidth"])
    said = [{name: test[name] for name in ("name", "observed")} for test in gate["tests"]]
    observed = [
        {"name": name, "observed": value} for name, value in zip(STATISTICS, battery.observed().tolist(), strict=True)
    ]
    found += _compared("/gate/tests", observed, said)
    keys = [inputs.action_keys[index] for index in inputs.interventions]
    empty = battery.table.values[:0, 0, 0]
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
        for place in strongest_places(battery, empty, protocol.num_named)
    ]
    named = [{name: value for name, value in place.items() if name != "p"} for place in gate["places"]]
    return found + list(_compared("/gate/places", places, named))


def gate_differences(document: Mapping[str, Any]) -> list[Difference]:
    """Adjusted p-values and verdict of the gate against its p-values, `alpha` and permutations.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    gate, protocol = document["gate"], protocol_of(document).gate
    tests = gate["tests"]
    if not tests:
        return list(_compared("/gate/verdict", "inconclusive", gate["verdict"]))
    found = list(_compared("/gate/tests", list(STATISTICS), [test["name"] for test in tests]))
    adjusted = holm([test["p"] for test in tests]).tolist()
    for index, (test, p) in enumerate(zip(tests, adjusted, strict=True)):
        if gate["bit_identical"]:
            found += _compared(f"/gate/tests/{index}/p", 1.0, test["p"])
        else:
            found += _attainable(f"/gate/tests/{index}/p", test["p"], protocol.num_permutations)
        found += _compared(f"/gate/tests/{index}/p_adjusted", p, test["p_adjusted"])
    outcomes = tuple(Outcome(t["name"], t["observed"], t["p"], p) for t, p in zip(tests, adjusted, strict=True))
    verdict, reason = ("pass", gate["reason"]) if gate["bit_identical"] else gate_verdict(outcomes, protocol)
    found += _compared("/gate/verdict", verdict, gate["verdict"])
    found += _compared("/gate/reason", reason, gate["reason"])
    return found + list(_effect_differences(gate, protocol))


def _effect_differences(gate: Mapping[str, Any], protocol: Protocol) -> Iterator[Difference]:
    """Minimum detectable effect against its detections, and critical values against the p-values."""
    said, pointer = gate["minimum_detectable_effect"], "/gate/minimum_detectable_effect"
    if said is None:
        return
    detections = tuple(Detection(**{**found, "shares": tuple(found["shares"])}) for found in said["detections"])
    effect = Sensitivity(protocol.alpha / len(STATISTICS), (), detections)
    yield from _compared(f"{pointer}/alpha", effect.alpha, said["alpha"])
    expected = [[pattern, offset_sd] for pattern in PATTERNS for offset_sd in protocol.offsets_sd]
    yield from _compared(f"{pointer}/detections", expected, [[d.pattern, d.offset_sd] for d in detections])
    smallest = {pattern: effect.smallest_sd(pattern) for pattern in PATTERNS}
    yield from _compared(f"{pointer}/smallest_sd", smallest, said["smallest_sd"])
    for index, (test, critical) in enumerate(zip(gate["tests"], said["critical"], strict=False)):
        beyond = critical is not None and test["observed"] > critical
        tied = critical is not None and math.isclose(test["observed"], critical, rel_tol=_REL)
        if not tied and beyond != (test["p"] <= effect.alpha * (1 + _REL)):
            yield Difference(f"{pointer}/critical/{index}", f"p {test['p']!r} of {test['observed']!r}", critical)


def battery_differences(document: Mapping[str, Any]) -> list[Difference]:
    """Chance, controls, adjusted p-values and statuses of the battery against its scores.

    Raises:
        ValueError: The protocol of the document is out of range.
    """
    battery, protocol = document["battery"], protocol_of(document).parity
    found: list[Difference] = []
    missing = []
    for index, way in enumerate(battery["ways"]):
        for kind in ("controls", "tests"):
            for place, result in enumerate(way[kind]):
                pointer, score = f"/battery/ways/{index}/{kind}/{place}/score", result["score"]
                if score is None:
                    missing.append({"test": f"{way['name']}/{result['name']}", "reason": result["reason"]})
                elif score["identical"]:
                    at_chance = {"accuracy": 1 / way["num_actions"], "p_accuracy": 1.0, "p_log_likelihood": 1.0}
                    found += _compared(pointer, at_chance, {name: score[name] for name in at_chance})
                else:
                    for name in ("p_accuracy", "p_log_likelihood"):
                        found += _attainable(f"{pointer}/{name}", score[name], protocol.num_permutations)
    found += _compared("/not_run", missing, document["not_run"])
    follows = judged_battery(battery["ways"], protocol)
    return found + list(_compared("/battery", follows, battery))


def _attainable(pointer: str, p: float, num_permutations: int) -> Iterator[Difference]:
    """A p-value of `num_permutations` permutations is a whole number of shares."""
    count = p * (num_permutations + 1)
    whole = max(1, round(count))
    if abs(count - whole) > _REL:
        yield Difference(pointer, whole / (num_permutations + 1), p)


def _compared(pointer: str, expected: Any, found: Any) -> Iterator[Difference]:
    """Differences of two JSON values, numbers to a relative 1e-6."""
    if isinstance(expected, Mapping) and isinstance(found, Mapping) and expected.keys() == found.keys():
        for key in expected:
            yield from _compared(f"{pointer}/{key.replace('~', '~0').replace('/', '~1')}", expected[key], found[key])
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for index, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from _compared(f"{pointer}/{index}", one, other)
    elif isinstance(expected, float) and type(found) in (int, float):
        if not math.isclose(expected, found, rel_tol=_REL, abs_tol=_ABS):
            yield Difference(pointer, expected, found)
    elif expected != found:
        yield Difference(pointer, expected, found)
