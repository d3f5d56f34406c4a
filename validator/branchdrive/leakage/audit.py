"""The leakage audit as one document, conforming to `schemas/v0.1/leakage.schema.json`.

It has the gate, which decides what a release may claim, and beside it the paper's battery, a diagnostic. The
work falls into parts, each a function of inputs, seed, protocol and classifier alone, and a caller can keep
every part, so that an audit that was interrupted goes on where it was.

Source: this project's choice; paper, "Collection Integrity, Replay Fidelity, and Leakage" for the battery.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from branchdrive.leakage.battery import Part, Way, WayFacts, way_facts
from branchdrive.leakage.classifier import SequenceClassifier, Unavailable
from branchdrive.leakage.draw import Kept, Workplace, drawn_here
from branchdrive.leakage.gate import Code, Gate, GateSubject, Place, gate_of
from branchdrive.leakage.inputs import GateFeature, ReplayInputs, gate_columns, gate_features
from branchdrive.leakage.protocol import CONTROLS, TESTS, AuditProtocol
from branchdrive.leakage.scan import Layout
from branchdrive.leakage.score import judged_battery
from branchdrive.leakage.sensitivity import PATTERNS, Sensitivity
from branchdrive.leakage.streams import StreamColumn
from branchdrive.quality.threshold import VARIABLES

__all__ = [
    "SeenInputs", "audit_key", "audit_of", "code_as_json", "described_inputs", "gate_as_json",
    "place_as_json",
]  # fmt: skip

Remember = Callable[[str, Callable[[], dict[str, Any]]], dict[str, Any]]
Progress = Callable[[int, int, str], None]


class SeenInputs(NamedTuple):
    """What is known of the inputs of an audit without holding them.

    Attributes:
        described: Digest, counts and names, as the document has them.
        interventions: Keys of the actions of the gate.
        features: What its features are.
        streams: What its columns of streams are.
        ways: Of the battery.
    """

    described: dict[str, Any]
    interventions: list[str]
    features: tuple[GateFeature, ...]
    streams: tuple[StreamColumn, ...]
    ways: tuple[WayFacts, ...]

    @classmethod
    def of(cls, inputs: ReplayInputs) -> SeenInputs:
        """What is known of inputs."""
        keys = [inputs.action_keys[index] for index in inputs.interventions]
        return cls(described_inputs(inputs), keys, gate_columns(inputs), inputs.streams.columns, way_facts(inputs))


@dataclass(frozen=True)
class _GateInputs:
    """What the gate sees of inputs, computed where they are taken."""

    inputs: Kept[ReplayInputs]

    @property
    def value(self) -> GateSubject:
        inputs = self.inputs.value
        features, columns = gate_features(inputs)
        return GateSubject(features, Layout.of(columns), inputs.streams)


def audit_key(
    digest: str,
    *,
    seed: int,
    protocol: AuditProtocol | None = None,
    sequence_classifier: SequenceClassifier | Unavailable,
) -> str:
    """SHA-256 of all that the parts of an audit depend on: what was kept under another key is of another audit.

    Args:
        digest: Of the inputs.
        seed: Of everything random.
        protocol: Numbers of the audit; None is the default.
        sequence_classifier: Of the recurrent tests.
    """
    settings = _settings(sequence_classifier)
    key = [digest, seed, (protocol or AuditProtocol()).as_json(), settings]
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()


def audit_of(
    inputs: Kept[ReplayInputs],
    seen: SeenInputs,
    *,
    seed: int,
    protocol: AuditProtocol | None = None,
    sequence_classifier: SequenceClassifier | Unavailable,
    remember: Remember = lambda _, compute: compute(),
    progress: Progress | None = None,
    draw: Workplace = drawn_here,
) -> dict[str, Any]:
    """Audit of replays that are kept somewhere, as JSON.

    Args:
        inputs: What is seen.
        seen: What is known of it.
        seed: Of everything random, below 2**64.
        protocol: Numbers of the audit; None is the default.
        sequence_classifier: Of the three recurrent tests, as `sequence_classifier()` finds it.
        remember: Called with the name of a part and what computes it; returns the part. It may return what
            it kept of an earlier call under the same `audit_key`.
        progress: Called with parts done, parts in total, and the name of the next or `done`.
        draw: Where classifiers run and statistics are kept, and how ranges of permutations and replicates are computed.

    Raises:
        ValueError: The seed is out of range, or the classifier gives scores of another shape.
    """
    protocol = protocol or AuditProtocol()
    battery = [
        (way, way.parts(seed=seed, protocol=protocol.battery, classifier=sequence_classifier, draw=draw))
        for way in (Way(inputs, *facts) for facts in seen.ways)
    ]
    total = 1 + sum(part.compute is not None for _, parts in battery for part in parts)
    done = 0

    def part(name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        nonlocal done
        if progress:
            progress(done, total, name)
        result = remember(name, compute)
        done += 1
        return result

    def classified(way_name: str, task: Part) -> dict[str, Any]:
        if task.compute is None:
            return {"name": task.name, "score": None, "training": None, "reason": task.reason}
        return {"name": task.name, **part(f"{way_name}/{task.name}", task.compute)}

    def gate() -> dict[str, Any]:
        found = gate_of(_GateInputs(inputs), seed=seed, protocol=protocol.gate, draw=draw)
        return gate_as_json(found, seen.features, seen.streams, seen.interventions)

    gate_part = part("gate", gate)
    recorded: list[dict[str, Any]] = []
    for way, parts in battery:
        results = {task.name: classified(way.name, task) for task in parts}
        recorded.append(
            {
                "name": way.name,
                "num_actions": len(way.actions),
                "num_groups": way.num_groups,
                "controls": [results[name] for name in CONTROLS],
                "tests": [results[name] for name in TESTS],
            }
        )
    if progress:
        progress(total, total, "done")
    return {
        "inputs": seen.described,
        "seed": seed,
        "protocol": {**protocol.as_json(), "sequence_classifier": _settings(sequence_classifier)},
        "gate": gate_part,
        "battery": judged_battery(recorded, protocol.battery),
        "not_run": [
            {"test": f"{way['name']}/{result['name']}", "reason": result["reason"]}
            for way in recorded
            for kind in ("controls", "tests")
            for result in way[kind]
            if result["score"] is None
        ],
    }


def described_inputs(inputs: ReplayInputs) -> dict[str, Any]:
    """What an audit saw: digest, counts and names."""
    partitions = sorted(set(inputs.partitions))
    return {
        "digest": inputs.digest(),
        "num_groups": {name: int(inputs.in_partition(name).sum()) for name in partitions},
        "num_nominal_replays": {
            name: int((inputs.in_partition(name) & inputs.has_nominal_replay).sum()) for name in partitions
        },
        "action_keys": list(inputs.action_keys),
        "nominal": inputs.action_keys[inputs.nominal_index],
        "variables": {
            "discrepancy": [variable.name for variable in VARIABLES],
            "ego": list(inputs.ego_names),
            "controls": list(inputs.control_names),
            "availability": list(inputs.availability_names),
            "streams": list(dict.fromkeys(f"{column.table}/{column.name}" for column in inputs.streams.columns)),
        },
    }


def _settings(classifier: SequenceClassifier | Unavailable) -> dict[str, Any] | None:
    return None if isinstance(classifier, Unavailable) else dict(classifier.settings)


def gate_as_json(
    gate: Gate, columns: tuple[GateFeature, ...], streams: tuple[StreamColumn, ...], action_keys: list[str]
) -> dict[str, Any]:
    """A gate on features `columns` and columns of streams, of the actions `action_keys`."""
    return {
        "verdict": gate.verdict,
        "reason": gate.reason,
        "bit_identical": gate.bit_identical,
        "shape": dict(zip(("groups", "actions", "features", "columns"), (*gate.shape, gate.num_columns), strict=True)),
        "bandwidth": gate.bandwidth,
        "tests": [test._asdict() for test in gate.tests],
        "places": [place_as_json(place, columns, action_keys) for place in gate.places],
        "codes": [code_as_json(code, columns, streams) for code in gate.codes],
        "minimum_detectable_effect": None if gate.sensitivity is None else _effect_as_json(gate.sensitivity),
    }


def place_as_json(place: Place, columns: tuple[GateFeature, ...], action_keys: list[str]) -> dict[str, Any]:
    """A place, its feature and action by name."""
    feature = columns[place.feature]
    return {
        "source": feature.source,
        "variable": feature.name,
        "offset_ticks": None if feature.offset_ticks is None else list(feature.offset_ticks),
        "action": action_keys[place.action],
        "kind": place.kind,
        "t": place.t,
        "difference": place.difference,
        "p": place.p,
    }


def code_as_json(code: Code, columns: tuple[GateFeature, ...], streams: tuple[StreamColumn, ...]) -> dict[str, Any]:
    """A place of the scan, its features and columns by name."""
    return {
        "statistic": code.statistic,
        "columns": [_named(index, columns, streams) for index in code.columns],
        "groups": code.num_groups,
        "value": code.value,
        "p": code.p,
    }


def _named(index: int, columns: tuple[GateFeature, ...], streams: tuple[StreamColumn, ...]) -> dict[str, Any]:
    if index < len(columns):
        feature = columns[index]
        span = None if feature.offset_ticks is None else list(feature.offset_ticks)
        return {"source": feature.source, "variable": feature.name, "offset_ticks": span}
    column = streams[index - len(columns)]
    span = None if column.offset_ticks is None else [column.offset_ticks, column.offset_ticks]
    return {"source": f"recorded_{column.table}", "variable": column.name, "offset_ticks": span}


def _effect_as_json(effect: Sensitivity) -> dict[str, Any]:
    return {
        "alpha": effect.alpha,
        "critical": [value if math.isfinite(value) else None for value in effect.critical],
        "detections": [{**found._asdict(), "shares": list(found.shares)} for found in effect.detections],
        "smallest_sd": {pattern: effect.smallest_sd(pattern) for pattern in PATTERNS},
    }
