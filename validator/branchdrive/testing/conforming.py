"""JSON values that conform to a schema: a Hypothesis strategy read from the schema itself."""

from __future__ import annotations

import copy
import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any

from hypothesis import strategies as st

from branchdrive.contract.resources import load_resource

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from hypothesis.strategies import SearchStrategy

_UNICODE = st.characters(codec="utf-8")

_anything = st.none() | st.booleans() | st.integers(-9, 9) | st.text(_UNICODE, max_size=4) | st.lists(st.none())
"""Values of members that a schema leaves open."""


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
    for alternatives in ("anyOf", "oneOf"):
        if alternatives in schema:
            return st.one_of(*(conforming(branch, schema_name) for branch in schema[alternatives]))
    if "allOf" in schema and "type" not in schema:
        (whole,) = schema["allOf"]
        parts = {name: conforming(node, schema_name) for name, node in schema["properties"].items()}
        return conforming(whole, schema_name, **parts)
    if choices := _choices(schema):
        return st.one_of(*(conforming(choice["then"], schema_name) for choice in choices))
    if "const" in schema:
        return st.just(schema["const"])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    match schema["type"]:
        case [*kinds]:
            return st.one_of(*(conforming({**schema, "type": kind}, schema_name, **properties) for kind in kinds))
        case "object":
            return _objects(schema, schema_name, properties)
        case "array" if "prefixItems" in schema:
            return st.tuples(*(conforming(node, schema_name) for node in schema["prefixItems"])).map(list)
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


def _choices(schema: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Conditions that choose, by a constant, what an object holds which its own node leaves open."""
    return [] if "additionalProperties" in schema else [part for part in schema.get("allOf", ()) if "if" in part]


def _numbers(schema: Mapping[str, Any]) -> SearchStrategy[float]:
    low = schema.get("minimum", schema.get("exclusiveMinimum"))
    high = schema.get("maximum", schema.get("exclusiveMaximum"))
    is_above, is_below = "exclusiveMinimum" in schema, "exclusiveMaximum" in schema
    numbers = st.floats(low, high, exclude_min=is_above, exclude_max=is_below, allow_nan=False, allow_infinity=False)
    first = None if low is None else math.floor(low) + 1 if is_above else math.ceil(low)
    last = None if high is None else math.ceil(high) - 1 if is_below else math.floor(high)
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
    if "properties" not in schema and "propertyNames" not in schema:
        return st.dictionaries(st.text(_UNICODE, max_size=8), _anything, max_size=min(3, schema["maxProperties"]))
    if "properties" not in schema:
        names = conforming({"type": "string", **schema["propertyNames"]}, schema_name)
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


def declared(
    value: Any, schema: Mapping[str, Any], schema_name: str, place: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], Mapping[str, Any], str]]:
    """Every place below the root of a conforming value, with the node that declares it and that node's file."""
    while "$ref" in schema or "oneOf" in schema or "anyOf" in schema or _choices(schema):
        if "$ref" in schema:
            schema, schema_name = _resolve(schema["$ref"], schema_name)
        elif choices := _choices(schema):
            schema = next((choice["then"] for choice in choices if _may_declare(choice["if"], value)), {})
        else:
            branches = schema.get("oneOf") or schema["anyOf"]
            schema = next((branch for branch in branches if _may_declare(branch, value)), {})
    if isinstance(value, dict) and ("properties" in schema or "propertyNames" in schema):
        named, others = schema.get("properties", {}), schema.get("additionalProperties")
        members = [(key, member, named.get(key, others)) for key, member in value.items()]
    elif isinstance(value, list) and schema.get("items"):
        members = [(index, member, schema["items"]) for index, member in enumerate(value)]
    else:
        return
    for key, member, node in members:
        yield (*place, key), node, schema_name
        yield from declared(member, node, schema_name, (*place, key))


def _may_declare(branch: Mapping[str, Any], value: Any) -> bool:
    """Whether a branch of alternatives is that of a value: alternatives here differ in type or in a constant."""
    if isinstance(value, list):
        return branch.get("type") == "array"
    if not isinstance(value, dict):
        return False  # nothing is below it
    constants = {name: node["const"] for name, node in branch.get("properties", {}).items() if "const" in node}
    return branch.get("type") == "object" and all(value.get(name) == known for name, known in constants.items())


@st.composite
def redrawn(draw: st.DrawFn, document: Any, schema_name: str) -> Any:
    """A document of which one to three values are drawn again from the nodes of the schema that declare them."""
    places = list(declared(document, load_resource(schema_name), schema_name))
    chosen = draw(st.lists(st.sampled_from(range(len(places))), min_size=1, max_size=3, unique=True))
    result = copy.deepcopy(document)
    for index in sorted(chosen, reverse=True):  # an outer value comes after those within, and replaces them
        place, node, name = places[index]
        parent = result
        for key in place[:-1]:
            parent = parent[key]
        parent[place[-1]] = draw(conforming(node, name))
    return result
