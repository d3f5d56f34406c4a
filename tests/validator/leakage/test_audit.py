"""The whole audit: its document, what it finds and names, and how it resumes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from tests.content_cache import kept
from tests.sampling import sampled
from tests.validator.leakage.classifiers import Regression, Undecided
from tests.validator.leakage.replays import changed, replay_inputs

from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.leakage.audit import SeenInputs, audit_key, audit_of
from branchdrive.leakage.classifier import SequenceClassifier, Unavailable
from branchdrive.leakage.draw import KeptHere
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.protocol import CONTROLS, SEQUENCE_TESTS, TESTS, AuditProtocol, BatteryProtocol, GateProtocol

QUICK = AuditProtocol(
    GateProtocol(alpha=0.01, num_permutations=799, num_frequencies=32, offsets_sd=(0.5, 2.0), num_replicates=2),
    BatteryProtocol(num_permutations=1_999, num_resamples=100),
)
CLEAN = replay_inputs(60, seed=2)


def audited(
    inputs: ReplayInputs, classifier: SequenceClassifier | Unavailable | None = None, **options: Any
) -> dict[str, Any]:
    options = {
        "seed": 4,
        "protocol": QUICK,
        "sequence_classifier": classifier or Regression(),
    } | options
    return audit_of(KeptHere(inputs), SeenInputs.of(inputs), **options)


def statuses(document: dict[str, Any]) -> set[str]:
    return {test["status"] for way in document["battery"]["ways"] for test in way["tests"]}


def clean_parts() -> dict[str, Any]:
    """Parts of the audit of `CLEAN`, by name."""

    def made() -> dict[str, Any]:
        found: dict[str, Any] = {}
        audited(CLEAN, remember=lambda name, compute: found.setdefault(name, compute()))
        return found

    return kept("audit-parts", made)


@pytest.fixture(scope="module")
def parts() -> dict[str, Any]:
    return clean_parts()


def clean_document() -> dict[str, Any]:
    """What the audit of `CLEAN` says."""
    return audited(CLEAN, remember=only(clean_parts()))


@pytest.fixture(scope="module")
def clean() -> dict[str, Any]:
    return clean_document()


def only(parts: Mapping[str, Any], *beginnings: str) -> Callable[[str, Callable[[], Any]], Any]:
    """Computes the parts whose names begin so, and takes the others from `parts`."""
    return lambda name, compute: compute() if name.startswith(beginnings) else parts[name]


def test_clean_replays_pass(clean: dict[str, Any]) -> None:
    assert clean["gate"]["verdict"] == "pass"
    assert clean["battery"]["trusted"]
    assert statuses(clean) == {"pass"}
    assert clean["not_run"] == []
    assert clean["gate"]["shape"] == {"groups": 60, "actions": 4, "features": 158, "columns": 0}


def test_the_document_conforms(clean: dict[str, Any]) -> None:
    assert schema_mismatches(parse_json(dump_json(clean)), "leakage.schema.json") == []
    assert parse_json(dump_json(clean)) == clean


def test_the_document_says_what_was_seen(clean: dict[str, Any]) -> None:
    assert clean["inputs"]["digest"] == CLEAN.digest()
    assert clean["inputs"]["num_groups"] == {"test": 12, "train": 36, "val": 12}
    assert clean["inputs"]["nominal"] == "action-0"
    assert clean["protocol"]["sequence_classifier"] == {"name": "regression", "penalty": 30.0}
    assert clean["protocol"]["gate"]["num_permutations"] == 799
    assert "scratch_bytes" not in clean["protocol"]["gate"]


def test_it_is_repeatable(clean: dict[str, Any], parts: dict[str, Any]) -> None:
    # All of it in the next test, which computes every part again.
    assert audited(CLEAN, remember=only(parts, "gate")) == clean
    other = audited(CLEAN, seed=5, remember=only(parts, "gate", "5-way/discrepancy"))
    assert other["gate"] != clean["gate"]
    assert other["battery"]["ways"][0] != clean["battery"]["ways"][0]
    assert other["battery"]["ways"][1] == clean["battery"]["ways"][1]


def test_an_interrupted_audit_goes_on_where_it_was(clean: dict[str, Any]) -> None:
    kept: dict[str, str] = {}
    computed: list[str] = []

    def remember(name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        if name not in kept:
            if len(computed) == 7:
                raise KeyboardInterrupt
            computed.append(name)
            kept[name] = json.dumps(compute())
        result: dict[str, Any] = json.loads(kept[name])
        return result

    with pytest.raises(KeyboardInterrupt):
        audited(CLEAN, remember=remember)
    first = computed.copy()
    computed.clear()
    with pytest.raises(KeyboardInterrupt):
        audited(CLEAN, remember=remember)
    second = computed.copy()
    computed.clear()
    assert audited(CLEAN, remember=remember) == clean
    everything = ["gate", *(f"{way}/{name}" for way in ("5-way", "4-way") for name in (*CONTROLS, *TESTS))]
    assert first + second + computed == everything


def test_it_says_how_far_it_is(parts: dict[str, Any]) -> None:
    said: list[tuple[int, int, str]] = []
    audited(CLEAN, remember=only(parts), progress=lambda *values: said.append(values))
    assert said[0] == (0, 17, "gate")
    assert [done for done, _, _ in said] == list(range(18))
    assert said[-1] == (17, 17, "done")


def test_the_key_of_parts_changes_with_all_that_they_depend_on() -> None:
    def key(inputs: ReplayInputs = CLEAN, seed: int = 1, protocol: AuditProtocol = QUICK, other: bool = False) -> str:
        classifier = Undecided() if other else Regression()
        return audit_key(inputs.digest(), seed=seed, protocol=protocol, sequence_classifier=classifier)

    keys = [
        key(),
        key(replay_inputs(60, seed=1)),
        key(seed=2),
        key(protocol=AuditProtocol(QUICK.gate)),
        key(protocol=AuditProtocol(battery=QUICK.battery)),
        key(other=True),
        audit_key(CLEAN.digest(), seed=1, protocol=QUICK, sequence_classifier=Unavailable("because")),
    ]
    assert len(set(keys)) == len(keys)
    same = GateProtocol(**{**vars(QUICK.gate), "scratch_bytes": 1})
    assert key(protocol=AuditProtocol(same, QUICK.battery)) == key()


def test_without_a_classifier_it_says_what_could_not_run(parts: dict[str, Any]) -> None:
    reason = "needs the package `torch`, which the extra `models` brings"
    document = audited(CLEAN, Unavailable(reason), remember=only(parts, "5-way", "4-way"))
    assert document["not_run"] == [
        {"test": f"{way}/{name}", "reason": reason} for way in ("5-way", "4-way") for name in SEQUENCE_TESTS
    ]
    assert document["gate"]["verdict"] == "pass"
    assert statuses(document) == {"pass", "not_run"}
    assert document["protocol"]["sequence_classifier"] is None
    assert schema_mismatches(document, "leakage.schema.json") == []


def test_scores_identical_within_groups_are_inconclusive(parts: dict[str, Any]) -> None:
    document = audited(CLEAN, Undecided(), remember=only(parts, "5-way"))
    found = {test["name"]: test["status"] for test in document["battery"]["ways"][0]["tests"]}
    assert found == {name: "inconclusive" if name in SEQUENCE_TESTS else "pass" for name in TESTS}


def test_bit_identical_replays_pass_exactly() -> None:
    inputs = replay_inputs(30, seed=0, noise=0.0)
    document = audited(inputs)
    gate = document["gate"]
    assert (gate["verdict"], gate["bit_identical"]) == ("pass", True)
    assert [(test["p"], test["p_adjusted"]) for test in gate["tests"]] == [(1.0, 1.0)] * 6
    assert gate["minimum_detectable_effect"] is None
    assert document["battery"]["trusted"]
    assert statuses(document) == {"inconclusive"}
    assert schema_mismatches(document, "leakage.schema.json") == []


@pytest.mark.parametrize(
    ("source", "place", "variable", "span"),
    sampled([
        ("ego", (13, 3), "speed_mps", [-10, -10]),
        ("ego", (2, 0), "x_m", [-65, -65]),
        ("discrepancy", (7,), "vehicle_gap_m", None),
    ], every=2),
)  # fmt: skip
def test_an_offset_of_the_minimum_detectable_effect_is_found_and_named(
    clean: dict[str, Any],
    parts: dict[str, Any],
    source: str,
    place: tuple[int, ...],
    variable: str,
    span: list[int] | None,
) -> None:
    effect_sd = clean["gate"]["minimum_detectable_effect"]["smallest_sd"]["one"]
    assert effect_sd in QUICK.gate.offsets_sd
    values = np.array(getattr(CLEAN, source))
    column = values[(slice(None), slice(1, None), *place)]
    from_median = np.abs(column - np.median(column, axis=1, keepdims=True))
    values[(slice(None), 3, *place)] += effect_sd * 1.4826 * np.median(from_median)
    gate = audited(changed(CLEAN, **{source: values}), remember=only(parts, "gate"))["gate"]
    assert gate["verdict"] == "fail"
    named = gate["places"][0]
    assert [named[key] for key in ("source", "variable", "offset_ticks", "action", "kind")] == [
        source,
        variable,
        span,
        "action-3",
        "value",
    ]
    assert named["p"] == 1 / 800


def test_a_leaked_label_is_found_by_gate_and_battery(parts: dict[str, Any]) -> None:
    discrepancy = np.array(CLEAN.discrepancy)
    discrepancy[:, :, 11] = np.arange(5)
    document = audited(changed(CLEAN, discrepancy=discrepancy), remember=only(parts, "gate", "5-way"))
    assert document["gate"]["verdict"] == "fail"
    assert document["gate"]["places"][0]["variable"] == "pedestrian_gap_m"
    found = {test["name"]: test for test in document["battery"]["ways"][0]["tests"]}
    assert found["discrepancy"]["status"] == "fail"
    assert found["discrepancy"]["score"]["accuracy"] > 0.6


@pytest.mark.parametrize("num_groups", [0, 3])
def test_too_few_groups_are_inconclusive(num_groups: int) -> None:
    document = audited(replay_inputs(num_groups, seed=0, partitions=("train",) * num_groups))
    assert document["gate"]["verdict"] == "inconclusive"
    assert not document["battery"]["trusted"]
    assert statuses(document) == {"not_run"}
    assert len(document["not_run"]) == 16
    assert schema_mismatches(document, "leakage.schema.json") == []
