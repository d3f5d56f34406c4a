"""`schema_mismatches`: where a document breaks its schema, what the schema demands, what is there."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.mismatch import pointers
from tests.validator.contract.mutation import mutated

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.resources import load_resource, schema_dir
from branchdrive.testing import strategies

DESCRIPTOR_SCHEMA = "descriptor.schema.json"
POLICY_SCHEMA = "policy.schema.json"
BANK_SCHEMA = "action-bank.schema.json"


def bank() -> dict[str, Any]:
    document: dict[str, Any] = load_action_bank().model_dump(mode="json", exclude_none=True)
    return document


def brake() -> dict[str, Any]:
    policy: dict[str, Any] = bank()["policies"][4]
    return policy


def descriptor(**changes: Any) -> dict[str, Any]:
    software = {"name": "none", "version": "1"}
    return {
        "spec_version": "0.1",
        "dataset_id": "invented",
        "dataset_version": "1.0.0",
        "title": "Invented",
        "licence": "CC-BY-4.0",
        "simulator": software,
        "collector": software,
        "streams": ["ego_route_state", "controls", "route_result"],
        "action_bank": bank(),
        "collection": {"seed": 1},
        **changes,
    }


def wrong(pointer: str, expected: str, found: str) -> Mismatch:
    return Mismatch({"pointer": pointer}, expected, found)


IDENTIFIER = "pattern '^[a-z0-9][a-z0-9._-]{0,127}$'"
MAPS = ["ego_route_state", "controls", "route_result", "semantic_bev"]
BEV: dict[str, Any] = {
    "name": "bev",
    "stream": "semantic_bev",
    "projection": "top_down",
    "width_px": 8,
    "height_px": 8,
    "px_per_m": 2,
    "origin_row_px": 4,
    "origin_column_px": 4,
}
UNSCALED = {name: value for name, value in BEV.items() if name != "px_per_m"}
TWICE = ["controls", "controls", "ego_route_state", "route_result"]

DEFECTS: dict[str, tuple[str, Any, list[Mismatch]]] = {
    "not an object": (POLICY_SCHEMA, [], [wrong("/", "type 'object'", "[]")]),
    "one property lacks": (
        "action-encoding.schema.json",
        {"name": "own", "width": 3},
        [wrong("/", "properties ['sha256']", "{'name': 'own', 'width': 3}")],
    ),
    "several properties lack": (
        "action-encoding.schema.json",
        {},
        [wrong("/", "properties ['name', 'width', 'sha256']", "{}")],
    ),
    "undeclared property": (
        "action-encoding.schema.json",
        {"name": "own", "width": 3, "sha256": "0" * 64, "x": 1},
        [
            wrong(
                "/",
                "no undeclared property; Additional properties are not allowed ('x' was unexpected); "
                "declared are name, sha256, width",
                f"{{'name': 'own', 'width': 3, 'sha256': '{'0' * 64}', 'x': 1}}",
            )
        ],
    ),
    "bd29 of another width": (
        "action-encoding.schema.json",
        {"name": "bd29", "width": 30, "sha256": "0" * 64},
        [wrong("/width", "const 29", "30")],
    ),
    "wrong type": (
        POLICY_SCHEMA,
        {**brake(), "magnitude": "0.3"},
        [wrong("/magnitude", "type 'number'", "'0.3'")],
    ),
    "bool for a number": (
        POLICY_SCHEMA,
        {**brake(), "magnitude": True},
        [wrong("/magnitude", "type 'number'", "True")],
    ),
    "fraction for an integer": (
        POLICY_SCHEMA,
        {**brake(), "duration_ticks": 0.5},
        [wrong("/duration_ticks", "type 'integer'", "0.5")],
    ),
    "too large": (POLICY_SCHEMA, {**brake(), "magnitude": 2}, [wrong("/magnitude", "maximum 1", "2")]),
    "not in the list": (
        POLICY_SCHEMA,
        {**brake(), "recovery": "coast"},
        [wrong("/recovery", "enum ['none', 'online_expert', 'stored_nominal', 'hold']", "'coast'")],
    ),
    "pattern": (POLICY_SCHEMA, {**brake(), "key": "Brake"}, [wrong("/key", IDENTIFIER, "'Brake'")]),
    "final line break": (
        POLICY_SCHEMA,
        {**brake(), "key": "brake\n"},
        [wrong("/key", IDENTIFIER, "'brake\\n'")],
    ),
    "final line break, in another file": (
        DESCRIPTOR_SCHEMA,
        descriptor(action_bank={"name": "own", "policies": [brake(), {**brake(), "key": "x\n"}]}),
        [wrong("/action_bank/policies/1/key", IDENTIFIER, "'x\\n'")],
    ),
    "rule without its value": (
        POLICY_SCHEMA,
        {**brake(), "brake": {"rule": "floor"}},
        [wrong("/brake", "properties ['value']", "{'rule': 'floor'}")],
    ),
    "rule with a value of another": (
        POLICY_SCHEMA,
        {**brake(), "steer": {"rule": "zero", "value": 0}},
        [wrong("/steer/value", "type 'null'", "0")],
    ),
    "value of no kind": (
        POLICY_SCHEMA,
        {**brake(), "brake": {"rule": "floor", "value": 3}},
        [wrong("/brake/value", "a number from -1 to 1, or null", "3")],
    ),
    "too few policies": (
        BANK_SCHEMA,
        {"name": "own", "policies": []},
        [wrong("/policies", "minItems 2", "[]")],
    ),
    "other version": (
        DESCRIPTOR_SCHEMA,
        descriptor(spec_version="9"),
        [wrong("/spec_version", "const '0.1'", "'9'")],
    ),
    "encoding of no kind": (
        DESCRIPTOR_SCHEMA,
        descriptor(action_encoding="bd29"),
        [wrong("/action_encoding", "an action encoding or null", "'bd29'")],
    ),
    "required stream": (
        DESCRIPTOR_SCHEMA,
        descriptor(streams=["ego_route_state", "controls"]),
        [wrong("/streams", "the stream route_result is required", "['ego_route_state', 'controls']")],
    ),
    "repeated stream": (
        DESCRIPTOR_SCHEMA,
        descriptor(streams=TWICE),
        [wrong("/streams", "uniqueItems True", str(TWICE))],
    ),
    "streams are no list": (
        DESCRIPTOR_SCHEMA,
        descriptor(streams="controls"),
        [wrong("/streams", "type 'array'", "'controls'")],
    ),
    "no camera of a stream": (
        DESCRIPTOR_SCHEMA,
        descriptor(streams=MAPS, cameras=[]),
        [wrong("/cameras", "the stream semantic_bev needs the camera bev, of this stream", "[]")],
    ),
    "camera of a stream that is not claimed": (
        DESCRIPTOR_SCHEMA,
        descriptor(streams=MAPS, cameras=[BEV, {**BEV, "name": "above", "stream": "rgb_top_down"}]),
        [wrong("/cameras/1/stream", "a claimed media stream; rgb_top_down is not claimed", "'rgb_top_down'")],
    ),
    "camera of another projection": (
        DESCRIPTOR_SCHEMA,
        descriptor(streams=MAPS, cameras=[BEV, {**BEV, "name": "fisheye", "projection": "fisheye"}]),
        [wrong("/cameras/1/projection", "enum ['pinhole', 'top_down']", "'fisheye'")],
    ),
    "map without a scale": (
        DESCRIPTOR_SCHEMA,
        descriptor(streams=MAPS, cameras=[UNSCALED]),
        [wrong("/cameras/0", "properties ['px_per_m']", f"{UNSCALED}")],
    ),
    "fault of an impossible name": (
        DESCRIPTOR_SCHEMA,
        descriptor(collection={"seed": 1, "faults": {"Late": 0.5}}),
        [wrong("/collection/faults", IDENTIFIER, "'Late'")],
    ),
    "pointer of a key with a slash": (
        DESCRIPTOR_SCHEMA,
        descriptor(collection={"seed": 1, "faults": {"a/b~c": 2}}),
        [
            wrong("/collection/faults", IDENTIFIER, "'a/b~c'"),
            wrong("/collection/faults/a~1b~0c", "maximum 1", "2"),
        ],
    ),
}


@each(("schema_name", "document", "expected"), DEFECTS.values(), ids=DEFECTS)
def test_violation_says_where_what_and_what_is_there(schema_name: str, document: Any, expected: list[Mismatch]) -> None:
    assert schema_mismatches(document, schema_name) == expected


def test_missing_camera_list_is_a_mismatch_of_the_whole() -> None:
    (found,) = schema_mismatches(descriptor(streams=MAPS), DESCRIPTOR_SCHEMA)
    assert (found.location["pointer"], found.expected) == ("/", "properties ['cameras']")


def test_conforming_document_has_no_mismatch() -> None:
    assert schema_mismatches(descriptor(), DESCRIPTOR_SCHEMA) == []


def test_mismatches_are_in_the_order_of_the_document() -> None:
    policies = [{**brake(), "magnitude": 2} for _ in range(12)]
    found = schema_mismatches({"name": "A", "policies": policies}, BANK_SCHEMA)
    assert pointers(found) == ["/name", *(f"/policies/{index}/magnitude" for index in range(12))]


@given(mutated(strategies.bank_documents(max_policies=3)))
def test_mismatches_are_reproducible_and_say_each_thing_once(document: Any) -> None:
    found = schema_mismatches(document, BANK_SCHEMA)
    assert schema_mismatches(copy.deepcopy(document), BANK_SCHEMA) == found
    assert all(found.count(mismatch) == 1 for mismatch in found)


def _reversed_keys(document: Any) -> Any:
    match document:
        case dict():
            return {key: _reversed_keys(value) for key, value in reversed(document.items())}
        case list():
            return [_reversed_keys(value) for value in document]
    return document


@given(mutated(strategies.policy_documents()))
def test_order_of_keys_changes_no_place_and_no_demand(document: Any) -> None:
    one, other = (schema_mismatches(it, POLICY_SCHEMA) for it in (document, _reversed_keys(document)))
    assert [(m.location, m.expected) for m in other] == [(m.location, m.expected) for m in one]


NASTY = "\x1b[31m\x00\r\n\x7f\x9b\u202e\u2028\ud800"

LEAKY: dict[str, Any] = {
    "value": descriptor(dataset_id=NASTY),
    "undeclared key": descriptor(**{NASTY: 1}),
    "key of a free object": descriptor(collection={"seed": 1, "faults": {NASTY: 7}}),
    "item": descriptor(streams=[NASTY]),
    "value of no kind": descriptor(action_encoding=NASTY),
    "nested": descriptor(simulator={"name": "a", "version": [{NASTY: NASTY}]}),
    "cameras": descriptor(streams=MAPS, cameras=[NASTY]),
}


@pytest.mark.parametrize("document", LEAKY.values(), ids=LEAKY)
def test_control_characters_never_leak(document: Any) -> None:
    found = schema_mismatches(document, DESCRIPTOR_SCHEMA)
    assert found
    for mismatch in found:
        assert f"{mismatch.location['pointer']}{mismatch.expected}{mismatch.found}".isprintable()


LONG = "x" * 1_000_000


@each(
    "document",
    [
        descriptor(title=LONG),
        descriptor(**{LONG: 1}),
        descriptor(collection={"seed": 1, "faults": {LONG: LONG}}),
        descriptor(action_encoding=LONG),
        descriptor(streams=[LONG]),
        descriptor(cameras=[LONG] * 4),
        descriptor(**{f"k{index}": index for index in range(20_000)}),
        [LONG],
    ],
    ids=["text", "undeclared key", "free key", "no kind", "item", "items", "many keys", "whole"],
)
def test_long_values_are_shortened(document: Any) -> None:
    found = schema_mismatches(document, DESCRIPTOR_SCHEMA)
    assert found
    for mismatch in found:
        assert len(mismatch.found) <= 160
        assert len(mismatch.expected) <= 200
        assert len(str(mismatch.location["pointer"])) <= 400
    assert any("…" in f"{m.location['pointer']}{m.expected}{m.found}" for m in found)


def beginning(document: Any) -> str:
    return str(document)[:159] + "…"


OVERSIZED: dict[str, tuple[Any, Mismatch]] = {
    "policies": (
        descriptor(action_bank={"name": "own", "policies": [{}] * 500_000}),
        wrong("/action_bank/policies", "maxItems 256", beginning([{}] * 100)),
    ),
    "streams": (
        descriptor(streams=[[0], {}] * 300_000),
        wrong("/streams", "maxItems 9", beginning([[0], {}] * 100)),
    ),
    "cameras": (
        descriptor(cameras=[0] * 500_000),
        wrong("/cameras", "maxItems 64", beginning([0] * 100)),
    ),
    "faults": (
        descriptor(collection={"seed": 1, "faults": {f"f{index}": 9 for index in range(200_000)}}),
        wrong("/collection/faults", "maxProperties 64", beginning({f"f{i}": 9 for i in range(100)})),
    ),
}


@pytest.mark.parametrize(("document", "expected"), OVERSIZED.values(), ids=OVERSIZED)
def test_oversized_collections_are_refused_unexamined(document: Any, expected: Mismatch) -> None:
    assert schema_mismatches(document, DESCRIPTOR_SCHEMA) == [expected]


def _schemas_with_patterns(node: Any) -> list[str]:
    match node:
        case dict():
            own = [node["pattern"]] if isinstance(node.get("pattern"), str) else []
            return own + [pattern for value in node.values() for pattern in _schemas_with_patterns(value)]
        case list():
            return [pattern for value in node for pattern in _schemas_with_patterns(value)]
    return []


@each("path", sorted(schema_dir().glob("*.schema.json")), ids=lambda path: path.name)
def test_dollar_of_a_pattern_is_only_its_end(path: Any) -> None:
    for pattern in _schemas_with_patterns(load_resource(path.name)):
        assert "$" not in pattern[:-1], pattern


@given(
    st.sampled_from(sorted(path.name for path in schema_dir().glob("*.schema.json"))),
    st.none() | st.booleans(),
)
def test_every_schema_can_be_asked(schema_name: str, document: Any) -> None:
    assert schema_mismatches(document, schema_name)
