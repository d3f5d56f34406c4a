"""What an auditor finds wrong in a leakage document, and that it finds nothing wrong in a right one."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from tests.content_cache import kept, remembered
from tests.each import Loop, each
from tests.sampling import THOROUGH
from tests.validator.leakage.replays import changed, replay_inputs
from tests.validator.leakage.test_audit import CLEAN, audited, clean_document
from tests.validator.leakage.test_inputs import without_nominal_replay

from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.contract.mismatch import Mismatch
from branchdrive.leakage import battery, recompute
from branchdrive.leakage.classifier import Unavailable
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.protocol import AuditProtocol
from branchdrive.leakage.recompute import input_mismatches, score_mismatches, statistic_mismatches
from branchdrive.leakage.statistic import Ridge
from branchdrive.leakage.verify import (
    battery_mismatches,
    count_mismatches,
    gate_mismatches,
    protocol_mismatches,
)

OWN: list[Callable[[dict[str, Any]], Iterator[Mismatch]]] = [count_mismatches, gate_mismatches, battery_mismatches]


def every(document: dict[str, Any]) -> list[Mismatch]:
    found = [mismatch for check in OWN for mismatch in check(document)]
    found += [*input_mismatches(document, CLEAN), *statistic_mismatches(document, CLEAN)]
    return [*found, *score_mismatches(document, CLEAN)]


def stated(inputs: ReplayInputs, classifier: Unavailable | None = None) -> dict[str, Any]:
    """Document of an audit."""
    return kept(f"audit-{inputs.digest()[:32]}-{classifier is None}", lambda: audited(inputs, classifier))


@pytest.fixture(scope="module")
def clean() -> dict[str, Any]:
    return clean_document()


@pytest.fixture(scope="module", autouse=True)
def _repeated_parts() -> Iterator[None]:
    """Most lies leave what is drawn and fitted as it is."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in ((battery, "fit_logistic"), (battery, "held_out_score"), (recompute, "_redrawn")):
            patch.setattr(module, name, remembered(getattr(module, name)))
        patch.setattr(Ridge, "of", staticmethod(remembered(Ridge.of)))
        yield


def test_a_right_document_has_no_difference(clean: dict[str, Any]) -> None:
    assert every(parse_json(dump_json(clean))) == []


@pytest.mark.parametrize("kind", ["without a classifier", "leaking", "identical", "without nominal replays", "small"])
def test_other_right_documents_have_none(kind: str) -> None:
    leak = np.array(CLEAN.discrepancy)
    leak[:, 2] += 1.0
    inputs = {
        "without a classifier": CLEAN,
        "leaking": changed(CLEAN, discrepancy=leak),
        "identical": replay_inputs(30, seed=0, noise=0.0),
        "without nominal replays": changed(CLEAN, **without_nominal_replay(CLEAN, list(range(60)))),
        "small": replay_inputs(3, seed=0),
    }[kind]
    document = stated(inputs, Unavailable("because") if kind == "without a classifier" else None)
    assert [mismatch for check in OWN for mismatch in check(document)] == []
    assert [*input_mismatches(document, inputs), *statistic_mismatches(document, inputs)] == []
    assert list(score_mismatches(document, inputs)) == []


def test_counts_may_be_written_as_floats(clean: dict[str, Any]) -> None:
    document = copy.deepcopy(clean)
    document["seed"] = float(document["seed"])
    for part in ("gate", "parity"):
        numbers = document["protocol"][part]
        numbers.update({name: float(value) for name, value in numbers.items() if name.startswith("num_")})
    assert schema_mismatches(document, "leakage.schema.json") == []
    assert every(document) == []


LIES: list[tuple[str, Any, str]] = [
    ("inputs/digest", "0" * 64, "/inputs/digest"),
    ("inputs/num_groups/test", 11, "/inputs/num_groups/test"),
    ("inputs/variables/ego/3", "velocity_mps", "/inputs/variables/ego/3"),
    ("inputs/nominal", "action-1", "/inputs/nominal"),
    ("gate/verdict", "fail", "/gate/verdict"),
    ("gate/bit_identical", True, "/gate/bit_identical"),
    ("gate/shape/groups", 61, "/gate/shape/groups"),
    ("gate/shape/actions", 5, "/gate/shape/actions"),
    ("gate/shape/features", 24, "/gate/shape/features"),
    ("gate/bandwidth", 1.0, "/gate/bandwidth"),
    ("gate/tests/0/observed", 2.5, "/gate/tests/0/observed"),
    ("gate/tests/2/observed", 1e-3, "/gate/tests/2/observed"),
    ("gate/tests/1/p", 0.98765, "/gate/tests/1/p"),
    ("gate/tests/3/p_adjusted", 0.5, "/gate/tests/3/p_adjusted"),
    ("gate/places/0/action", "action-0", "/gate/places/0/action"),
    ("gate/places/0/variable", "y", "/gate/places/0/variable"),
    ("gate/places/1/t", 9.0, "/gate/places/1/t"),
    ("gate/minimum_detectable_effect/alpha", 0.05, "/gate/minimum_detectable_effect/alpha"),
    ("gate/minimum_detectable_effect/smallest_sd/one", 0.25, "/gate/minimum_detectable_effect/smallest_sd/one"),
    ("gate/minimum_detectable_effect/detections/0/offset_sd", 0.1, "/gate/minimum_detectable_effect/detections/0/1"),
    ("gate/minimum_detectable_effect/critical/0", 0.5, "/gate/minimum_detectable_effect/critical/0"),
    ("protocol/gate/alpha", 0.9999, "/gate/verdict"),
    ("battery/trusted", False, "/battery/trusted"),
    ("battery/family/0", "3-way/ego/accuracy", "/battery/family/0"),
    ("battery/ways/0/chance", 0.25, "/battery/ways/0/chance"),
    ("battery/ways/1/num_actions", 5, "/battery/ways/1/num_actions"),
    ("battery/ways/0/name", "13-way", "/battery/ways/0/name"),
    ("battery/ways/0/num_groups/train", 60, "/battery/ways/0/num_groups/train"),
    ("battery/ways/0/controls/0/score/p_accuracy", 0.5, "/battery/trusted"),
    ("battery/ways/0/controls/2/found", True, "/battery/ways/0/controls/2/found"),
    ("battery/ways/0/tests/2/score/identical", True, "/battery/ways/0/tests/2/status"),
    ("battery/ways/0/tests/1/score/p_log_likelihood", 1e-7, "/battery/ways/0/tests/1/score/p_log_likelihood"),
    ("battery/ways/0/tests/1/score/p_log_likelihood", 1 / 2000, "/battery/ways/0/tests/1/status"),
    ("battery/ways/1/tests/4/p_adjusted/accuracy", 0.123, "/battery/ways/1/tests/4/p_adjusted/accuracy"),
    ("battery/ways/1/tests/3/status", "inconclusive", "/battery/ways/1/tests/3/status"),
    ("battery/ways/1/tests/3/score", None, "/not_run"),
    ("not_run", [{"test": "5-way/ego", "reason": "because"}], "/not_run"),
]


def lies(every: int) -> Loop:
    """Decorator of a test of one lie of so many."""
    chosen = LIES[::every]
    return each(("path", "value", "pointer"), chosen, ids=[f"{path}={value}" for path, value, _ in chosen])


@lies(every=3)
def test_a_lie_is_found_at_its_place(clean: dict[str, Any], path: str, value: Any, pointer: str) -> None:
    find_lie(clean, path, value, pointer)


@THOROUGH
@lies(every=1)
def test_every_lie_is_found_at_its_place(clean: dict[str, Any], path: str, value: Any, pointer: str) -> None:
    find_lie(clean, path, value, pointer)


def find_lie(clean: dict[str, Any], path: str, value: Any, pointer: str) -> None:
    document: Any = copy.deepcopy(clean)
    *parents, last = [int(key) if key.isdigit() else key for key in path.split("/")]
    owner = document
    for key in parents:
        owner = owner[key]
    owner[last] = value
    assert schema_mismatches(document, "leakage.schema.json") == []
    found = every(document)
    assert pointer in [mismatch.location["pointer"] for mismatch in found]
    assert all(mismatch.expected != mismatch.found for mismatch in found)


def test_other_inputs_are_noticed(clean: dict[str, Any]) -> None:
    moved = np.array(CLEAN.ego)
    moved[4, 2, 3, 1] += 1e-3
    other = changed(CLEAN, ego=moved)
    assert [mismatch.location["pointer"] for mismatch in input_mismatches(clean, other)] == ["/inputs/digest"]
    assert "/gate/tests/2/observed" in [mismatch.location["pointer"] for mismatch in statistic_mismatches(clean, other)]


def test_a_gate_without_some_of_its_tests_is_noticed(clean: dict[str, Any]) -> None:
    document = copy.deepcopy(clean)
    document["gate"]["tests"].pop()
    assert schema_mismatches(document, "leakage.schema.json") == []
    (missing,) = statistic_mismatches(document, CLEAN)
    assert (missing.location["pointer"], missing.expected, missing.found) == ("/gate/tests", "6 entries", "5 entries")


def test_a_fail_cannot_be_told_as_a_pass() -> None:
    leak = np.array(CLEAN.discrepancy)
    leak[:, 2] += 1.0
    document = stated(changed(CLEAN, discrepancy=leak), Unavailable("because"))
    assert document["gate"]["verdict"] == "fail"
    document["gate"]["verdict"] = "pass"
    assert [mismatch.location["pointer"] for mismatch in gate_mismatches(document)] == ["/gate/verdict"]
    for test in document["gate"]["tests"]:
        test["p"] = test["p_adjusted"] = 1.0
    pointers = [mismatch.location["pointer"] for mismatch in gate_mismatches(document)]
    assert any(str(pointer).startswith("/gate/minimum_detectable_effect/critical/") for pointer in pointers)


@pytest.mark.parametrize("p", [0.01, 0.05, 0.5, 1.0])
def test_a_fail_is_no_pass_under_another_p_value_and_critical_value(p: float) -> None:
    leak = np.array(CLEAN.discrepancy)
    leak[:, 2] += 1.0
    inputs = changed(CLEAN, discrepancy=leak)
    document = stated(inputs, Unavailable("because"))
    gate = document["gate"]
    for test in gate["tests"]:
        test.update(p=p, p_adjusted=min(1.0, 6 * p))
    gate["minimum_detectable_effect"]["critical"] = [1e6] * 6
    pointers = {mismatch.location["pointer"] for mismatch in statistic_mismatches(document, inputs)}
    assert "/gate/tests/0/p" in pointers
    assert any(str(pointer).startswith("/gate/minimum_detectable_effect/critical") for pointer in pointers)


def test_a_protocol_is_compared_exactly(clean: dict[str, Any]) -> None:
    document = copy.deepcopy(clean)
    document["protocol"].update(AuditProtocol().as_json())
    assert list(protocol_mismatches(document)) == []
    document["protocol"]["gate"]["penalty"] *= 1 + 1e-12
    assert [mismatch.location["pointer"] for mismatch in protocol_mismatches(document)] == ["/protocol/gate/penalty"]
