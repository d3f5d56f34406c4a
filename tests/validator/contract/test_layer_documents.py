"""Documents of the derived layers: what their schemas accept and refuse."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.each import each
from tests.mismatch import pointers
from tests.validator.contract.layer_documents import EXAMPLES
from tests.validator.contract.mutation import mutated

from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.resources import load_resource
from branchdrive.testing.conforming import conforming

Path = tuple[str | int, ...]

each_document = each("stem", EXAMPLES)


def nodes(value: Any, path: Path = ()) -> list[tuple[Path, Any]]:
    """Every value of a document with its path; of a list the first and the last member."""
    found = [(path, value)]
    if isinstance(value, dict):
        for key, member in value.items():
            found += nodes(member, (*path, key))
    elif isinstance(value, list) and value:
        for index in sorted({0, len(value) - 1}):
            found += nodes(value[index], (*path, index))
    return found


def at(document: Any, path: Path) -> Any:
    for key in path:
        document = document[key]
    return document


def changed(stem: str, path: Path, value: Any) -> dict[str, Any]:
    document = copy.deepcopy(EXAMPLES[stem])
    at(document, path[:-1])[path[-1]] = value
    return document


def violations(stem: str, document: Any) -> list[str]:
    return pointers(schema_mismatches(document, f"{stem}.schema.json"))


BENCHMARK = {document.schema for document in LAYERS["benchmark"].documents.values()}
"""Schemas whose examples stand with the benchmark."""


def test_every_document_has_an_example() -> None:
    declared = {document.schema for layer in LAYERS.values() for document in layer.documents.values()}
    elsewhere = {"leakage.schema.json", *BENCHMARK} - {"ledger.schema.json"}  # the one form of two layers
    assert {f"{stem}.schema.json" for stem in EXAMPLES} == declared - elsewhere


@each_document
def test_example_conforms_and_comes_back_from_its_bytes(stem: str) -> None:
    assert violations(stem, EXAMPLES[stem]) == []
    assert parse_json(dump_json(EXAMPLES[stem])) == EXAMPLES[stem]


@each_document
def test_schema_closes_every_object_and_bounds_every_array_and_text(stem: str) -> None:
    for path, node in nodes(load_resource(f"{stem}.schema.json")):
        if not isinstance(node, dict) or path[-1:] == ("properties",):
            continue
        match node.get("type"):
            case "object":
                assert "additionalProperties" in node, path
                assert node["additionalProperties"] is False or "maxProperties" in node, path
            case "array":
                assert "maxItems" in node, path
            case "string":
                assert node.keys() & {"pattern", "maxLength"}, path


OPTIONAL = {
    ("split", "partitions", "calibration"),
    ("population", "stages", "groups"),
    ("features", "arrays"),
    ("variants", "variants", "where"),
}
"""Places whose keys are data, so that one of them may lack."""


@each_document
def test_absence_of_a_property_is_refused(stem: str) -> None:
    for path, _ in nodes(EXAMPLES[stem]):
        names = tuple(part for part in (stem, *path) if isinstance(part, str))
        if not path or not isinstance(path[-1], str) or names in OPTIONAL or names[:-1] in OPTIONAL:
            continue
        document = copy.deepcopy(EXAMPLES[stem])
        del at(document, path[:-1])[path[-1]]
        assert violations(stem, document), path


@each_document
def test_undeclared_property_is_refused(stem: str) -> None:
    for path, value in nodes(EXAMPLES[stem]):
        if isinstance(value, dict):
            document = copy.deepcopy(EXAMPLES[stem])
            at(document, path)["Not a name"] = 0
            assert violations(stem, document), path


@each_document
def test_number_that_is_none_is_refused_by_the_parser(stem: str) -> None:
    for path, value in nodes(EXAMPLES[stem]):
        if path and isinstance(value, int | float) and not isinstance(value, bool):
            for wrong in (float("nan"), float("inf"), float("-inf")):
                content = json.dumps(changed(stem, path, wrong)).encode()
                with pytest.raises(ValueError, match="is not a JSON number"):
                    parse_json(content)
            assert violations(stem, changed(stem, path, "1")), path


@each_document
def test_null_is_refused_where_a_value_is_always_known(stem: str) -> None:
    nullable = {
        "calibration", "unit", "value", "share", "low", "high", "met", "groups", "trajectories", "encoding", "frame",
        "limit", "threshold", "mean_share_above", "share_above", "variation", "over_variation", "num_failing_alone",
        "num_unmatched", "filters",
    }  # fmt: skip
    for path, _ in nodes(EXAMPLES[stem]):
        if not path or path[-1] in nullable or (path[0], path[-1]) in (("scalars", "offset"), ("scalars", "scale")):
            continue
        assert violations(stem, changed(stem, path, None)), path


@each(
    ("stem", "path", "value"),
    [
        pytest.param("source", ("raw_layer",), "0" * 63, id="a short digest"),
        pytest.param("source", ("raw_layer",), "0" * 64 + "\n", id="a digest with a line feed"),
        pytest.param("source", ("dispositions", "kept"), -1, id="a negative count"),
        pytest.param("split", ("shares", "train"), 0, id="a partition without share"),
        pytest.param("split", ("partitions", "val"), {"groups": 0, "clusters": 0}, id="a partition without group"),
        pytest.param("split", ("partitions", "holdout"), {"groups": 1, "clusters": 1}, id="an unknown partition"),
        pytest.param("thresholds", ("partition",), "val", id="thresholds of another partition"),
        pytest.param("thresholds", ("quantile",), 0.95, id="another quantile"),
        pytest.param("thresholds", ("num_groups",), 0, id="thresholds of no group"),
        pytest.param("thresholds", ("variables", 0, "value"), -0.1, id="a negative threshold"),
        pytest.param("thresholds", ("variables", 0, "unit"), "", id="an empty unit"),
        pytest.param("thresholds", ("variables",), [], id="no variable"),
        pytest.param("retention", ("rows", 0, "share"), 1.01, id="a share above 1"),
        pytest.param("retention", ("rows", 0, "target"), 0.8, id="another target"),
        pytest.param("retention", ("num_resamples",), 1999, id="fewer resamples"),
        pytest.param("population", ("stages",), EXAMPLES["population"]["stages"][:-1], id="a stage lacks"),
        pytest.param("population", ("partitions",), ["train", "train"], id="a partition twice"),
        pytest.param("variants", ("frozen", "where", "near_duplicate"), True, id="another frozen population"),
        pytest.param("variants", ("variants", 0, "where"), {}, id="a variant of all groups"),
        pytest.param("variants", ("variants", 0, "where", "eligible"), 1, id="a flag that is a number"),
        pytest.param("ledger", ("entries", 0, "event"), "test_closed", id="an unknown event"),
        pytest.param("ledger", ("entries", 0, "number"), 0, id="an entry before the first"),
        pytest.param("features", ("contracts", "sensor"), ["actions"], id="a contract that reads no history"),
        pytest.param("features", ("trajectory", "steps"), 9, id="nine steps"),
        pytest.param("features", ("encoding", "width"), 30, id="bd29 of another width"),
        pytest.param("features", ("arrays", "state", "shape"), ["N", 16, 21], id="an unknown length"),
        pytest.param("features", ("candidate_order",), ["nominal", "nominal"], id="a candidate twice"),
        pytest.param("normalisation", ("state", 0, "scale"), 0, id="a scale of 0"),
        pytest.param("normalisation", ("partition",), "val", id="normalisation of another partition"),
        pytest.param("normalisation", ("scalars", 0, "scale"), -1.0, id="a negative scale"),
        pytest.param("normalisation", ("trajectories",), EXAMPLES["normalisation"]["trajectories"][1:], id="49 places"),
    ],
)
def test_value_outside_its_bounds_is_refused(stem: str, path: Path, value: Any) -> None:
    assert violations(stem, changed(stem, path, value))


@pytest.mark.parametrize(
    ("stem", "path", "value"),
    [
        pytest.param("split", ("calibration",), None, id="a split without calibration"),
        pytest.param("thresholds", ("variables", 0, "value"), None, id="an infinite threshold"),
        pytest.param("retention", ("rows",), [], id="retention of nothing"),
        pytest.param("ledger", ("entries",), [], id="a ledger of nothing yet"),
        pytest.param("features", ("encoding",), None, id="a bank without encoding"),
        pytest.param("normalisation", ("num_groups",), 431.0, id="an integer with a zero fraction"),
    ],
)
def test_value_at_its_bounds_is_accepted(stem: str, path: Path, value: Any) -> None:
    assert violations(stem, changed(stem, path, value)) == []


@pytest.mark.parametrize("stem", ["source", "split", "ledger", "thresholds", "retention"])
@settings(max_examples=settings.default.max_examples // 3)
@given(data=st.data())
def test_documents_drawn_from_the_schema_conform(stem: str, data: st.DataObject) -> None:
    schema = load_resource(f"{stem}.schema.json")
    small = {**schema, "properties": {name: _short(node) for name, node in schema["properties"].items()}}
    document = data.draw(conforming({**small, "type": "object"}, f"{stem}.schema.json"))
    assert violations(stem, document) == []
    assert parse_json(dump_json(document)) == document


def _short(node: dict[str, Any]) -> dict[str, Any]:
    """The same node with arrays no longer than they must be, or two."""
    if node.get("type") != "array":
        return node
    return {**node, "maxItems": max(node.get("minItems", 0), min(node["maxItems"], 2))}


@each_document
@settings(max_examples=settings.default.max_examples // 2)
@given(data=st.data())
def test_judgement_of_a_mutated_document_is_a_list_of_places_in_it(stem: str, data: st.DataObject) -> None:
    document = data.draw(mutated(st.just(EXAMPLES[stem])))
    for mismatch in schema_mismatches(document, f"{stem}.schema.json"):
        assert f"{mismatch.location['pointer']}{mismatch.expected}{mismatch.found}".isprintable()
        assert len(str(mismatch.location["pointer"])) <= 400
