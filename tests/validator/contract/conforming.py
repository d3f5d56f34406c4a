"""JSON values that conform to a schema: a Hypothesis strategy read from the schema itself."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any

from hypothesis import strategies as st

from branchdrive.contract.resources import load_resource

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hypothesis.strategies import SearchStrategy

_UNICODE = st.characters(codec="utf-8")


@cache
def matching(pattern: str) -> SearchStrategy[str]:
    """Text that matches a regular expression of the schemas as a whole."""
    return st.from_regex(re.compile(pattern), fullmatch=True, alphabet=_UNICODE)


def _resolve(reference: str, schema_name: str) -> tuple[Mapping[str, Any], str]:
    file_name, _, fragment = reference.partition("#")
    schema_name = file_name or schema_name
    node = load_resource(schema_name)
    for part in fragment.strip("/").split("/") if fragment else ():
        node = node[part]
    return node, schema_name


def conforming(
    schema: Mapping[str, Any] | str, schema_name: str = "", /, **properties: SearchStrategy[Any]
) -> SearchStrategy[Any]:
    """JSON values that conform to a schema, a file name or a node of the file `schema_name`.

    Covers the assertions that the contract uses on single values. Conditions between values
    (``if``, ``contains``, ``uniqueItems``) are the caller's: strategies in `properties` replace those
    of an object's properties.
    """
    if isinstance(schema, str):
        return conforming(load_resource(schema), schema, **properties)
    if "$ref" in schema:
        return conforming(*_resolve(schema["$ref"], schema_name), **properties)
    if "anyOf" in schema:
        return st.one_of(*(conforming(branch, schema_name) for branch in schema["anyOf"]))
    if "const" in schema:
        return st.just(schema["const"])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    match schema["type"]:
        case "object":
            return _objects(schema, schema_name, properties)
        case "array":
            items = conforming(schema["items"], schema_name)
            return st.lists(items, min_size=schema.get("minItems", 0), max_size=schema.get("maxItems"))
        case "string" if "pattern" in schema:
            return matching(schema["pattern"])
        case "string":
            return st.text(_UNICODE, min_size=schema.get("minLength", 0), max_size=schema.get("maxLength"))
        case "integer":
            return _integers(schema.get("minimum"), schema.get("maximum"))
        case "number":
            return _numbers(schema)
        case "boolean":
            return st.booleans()
        case "null":
            return st.none()
    raise ValueError(f"no strategy for {schema!r}")


def _numbers(schema: Mapping[str, Any]) -> SearchStrategy[float]:
    low, high = schema.get("minimum", schema.get("exclusiveMinimum")), schema.get("maximum")
    is_open = "exclusiveMinimum" in schema
    numbers = st.floats(low, high, exclude_min=is_open, allow_nan=False, allow_infinity=False)
    first = None if low is None else math.floor(low) + 1 if is_open else math.ceil(low)
    last = None if high is None else math.floor(high)
    if first is not None and last is not None and first > last:
        return numbers
    return numbers | _integers(first, last)


def _integers(first: int | None, last: int | None) -> SearchStrategy[int]:
    """Integers of at most 20 characters; a document holds no longer ones, whatever its schema."""
    largest = 10**19 - 1
    return st.integers(-largest if first is None else first, largest if last is None else last)


def _objects(
    schema: Mapping[str, Any], schema_name: str, properties: Mapping[str, SearchStrategy[Any]]
) -> SearchStrategy[dict[str, Any]]:
    if "properties" not in schema:
        names = matching(schema["propertyNames"]["pattern"])
        values = conforming(schema["additionalProperties"], schema_name)
        return st.dictionaries(names, values, max_size=min(3, schema.get("maxProperties", 3)))
    fields = {
        name: properties[name] if name in properties else conforming(node, schema_name)
        for name, node in schema["properties"].items()
    }
    required = schema["required"]
    return st.fixed_dictionaries(
        {name: fields[name] for name in required},
        optional={name: field for name, field in fields.items() if name not in required},
    )
