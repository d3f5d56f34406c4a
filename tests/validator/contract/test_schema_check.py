"""Compiled checks of documents say what jsonschema says: of every part of every schema, and of changed documents."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest
from hypothesis import given
from tests.each import each
from tests.sampling import THOROUGH
from tests.validator.contract.changing import changed, sample
from tests.validator.contract.layer_documents import EXAMPLES
from tests.validator.contract.mutation import OF_EVERY_TYPE, mutated

from branchdrive.contract.document import _validator, schema_mismatches
from branchdrive.contract.resources import load_resource, schema_dir
from branchdrive.contract.schema_check import compiled_check, compiled_schema
from branchdrive.testing import strategies

SCHEMAS = sorted(path.name for path in schema_dir().glob("*.schema.json"))

_NAMED = ("properties", "$defs")
_LISTED = ("allOf", "anyOf", "oneOf", "prefixItems")
_SINGLE = ("additionalProperties", "propertyNames", "items", "contains", "not", "if", "then", "else")

_PAIRS = ([1, True], [True, 1, 0, False], [1, 1.0], [[1], [True]], [[1], [1.0]], [{"a": 1}, {"a": True}], ["a", "a"])
_NUMBERS = (10**19, -(10**19), 2**53 + 1, float(2**53), 1e19, 5e-324, -0.0, 1.7976931348623157e308, 7.0, 13.0)
_DEEP = json.loads("[" * 60 + "]" * 60)
_TEXTS = ("0" * 64, "0" * 64 + "\n", "a.b", "BD-LYR-001", "Some words.", "é", "\u0661", "1.0.0", "a" * 5000)
HOSTILE = [*OF_EVERY_TYPE, *_PAIRS, *_NUMBERS, _DEEP, *_TEXTS, {"name": "a"}, {"": 0}, [{}], [[]]]


def parts(schema: Any, pointer: str = "") -> Iterator[tuple[str, Any]]:
    """Every schema within a schema, with where it stands."""
    yield pointer, schema
    if isinstance(schema, dict):
        for key in _NAMED:
            for name, part in schema.get(key, {}).items():
                yield from parts(part, f"{pointer}/{key}/{name}")
        for key in _LISTED:
            for i, part in enumerate(schema.get(key, ())):
                yield from parts(part, f"{pointer}/{key}/{i}")
        for key in _SINGLE:
            if key in schema:
                yield from parts(schema[key], f"{pointer}/{key}")


def own_values(part: Any) -> Iterator[Any]:
    """Values at the bounds of a schema, and next to those that it lists."""
    if isinstance(part, dict):
        for word, limit in part.items():
            if word in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"):
                yield from (
                    limit,
                    limit - 1,
                    limit + 1,
                    math.nextafter(limit, -math.inf),
                    math.nextafter(limit, math.inf),
                )
            elif word in ("minLength", "maxLength", "minItems", "maxItems") and limit <= 1000:
                for size in (limit - 1, limit, limit + 1):
                    yield from ("a" * size, list(range(size)))
        for value in (*part.get("enum", ()), *([part["const"]] if "const" in part else ())):
            yield from (value, [value], f"{value} ", bool(value))


def keywords(part: Any) -> Any:
    """What tells a schema from those that a check treats alike: its keywords, and the type that it asks for."""
    return (*part, str(part.get("type"))) if isinstance(part, dict) else part


@cache
def kinds() -> dict[str, list[tuple[str, Any]]]:
    """Parts by schema, of those with the same keywords in all schemas the last."""
    known = {
        keywords(part): (name, (pointer, part)) for name in SCHEMAS for pointer, part in parts(load_resource(name))
    }
    return {name: [part for home, part in known.values() if home == name] for name in SCHEMAS}


@pytest.mark.parametrize("is_every", [False, pytest.param(True, marks=THOROUGH)])
@each("name", SCHEMAS)
def test_every_part_of_a_schema_says_what_jsonschema_says(name: str, is_every: bool) -> None:
    """The document as a whole, and of parts with the same keywords the last, or every one."""
    validator, identity = _validator(name), load_resource(name)["$id"]
    found = [*parts(load_resource(name))]
    for pointer, part in found if is_every else [found[0], *kinds()[name]]:
        check, wanted = compiled_schema(part, name), validator.evolve(schema={"$ref": f"{identity}#{pointer}"})
        for value in [*HOSTILE, *own_values(part)]:
            assert check(value) == wanted.is_valid(value), (pointer, value)


def documents() -> dict[str, Any]:
    """A document that conforms, by the name of its schema."""
    names = {name: name.replace(".schema", "") for name in SCHEMAS}
    resources = {name: load_resource(file) for name, file in names.items() if (schema_dir() / file).is_file()}
    return {**resources, **{f"{stem}.schema.json": document for stem, document in EXAMPLES.items()}}


@each("name", documents())
def test_changed_documents_are_judged_as_by_jsonschema(name: str) -> None:
    document, check, wanted = documents()[name], compiled_check(name), _validator(name)
    assert check(document)
    for place, new in sample(name, document, 15):
        other = changed(document, place, new)
        assert check(other) == wanted.is_valid(other), (place, new)


@given(mutated(strategies.descriptor_documents()))
def test_descriptors_are_judged_as_by_jsonschema(document: Any) -> None:
    assert compiled_check("descriptor.schema.json")(document) == _validator("descriptor.schema.json").is_valid(document)


def test_a_document_that_conforms_is_not_walked_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(schema_name: str) -> Any:
        raise AssertionError(f"{schema_name} was compiled by jsonschema")

    monkeypatch.setattr("branchdrive.contract.document._validator", refuse)
    assert schema_mismatches(EXAMPLES["source"], "source.schema.json") == []
    with pytest.raises(AssertionError, match=r"source\.schema\.json was compiled"):
        schema_mismatches({}, "source.schema.json")


def test_a_keyword_that_no_check_is_known_for_is_refused() -> None:
    with pytest.raises(ValueError, match="no check is known for the keyword 'dependentRequired'"):
        compiled_schema({"type": "object", "dependentRequired": {}}, "invented.schema.json")
