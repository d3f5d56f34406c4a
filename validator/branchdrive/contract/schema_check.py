"""JSON Schema as compiled predicates: whether a document conforms to a normative schema, and nothing of why not.

Every keyword of a schema becomes a function of a value, and a schema calls its functions in turn until one says no.
What a value may hold is counted before what it holds is looked at, so that time stays in proportion to what a
conforming document may hold. Annotations (`title`, `description`, `format`) decide nothing.

Values are those that the parser gives: ``None``, booleans, integers, floats, texts, lists and dictionaries. What breaks
a schema, and where, is said by `branchdrive.contract.document.schema_mismatches`.

Source: JSON Schema draft 2020-12, validation and core.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sized
from functools import cache
from itertools import islice
from typing import Any

from branchdrive.contract.resources import load_resource

__all__ = ["compiled_check", "compiled_schema", "ecma_pattern"]

Predicate = Callable[[Any], bool]

_Compile = Callable[[Any], Predicate]
"""Makes the predicate of a schema within a schema."""


@cache
def compiled_check(schema_name: str) -> Predicate:
    """Whether a parsed document conforms to the schema file `schema_name`."""
    return _resolved(schema_name, "")


@cache
def _resolved(schema_name: str, pointer: str) -> Predicate:
    schema = load_resource(schema_name)
    for key in pointer.split("/")[1:]:
        schema = schema[key]
    return compiled_schema(schema, schema_name)


def compiled_schema(schema: Any, schema_name: str) -> Predicate:
    """Predicate of a schema; a reference is looked up when a value first reaches it.

    Args:
        schema: A schema, as it is parsed.
        schema_name: File whose parts and neighbours its references name.

    Raises:
        ValueError: The schema has a keyword that is not among those of the normative schemas.
    """

    def compile_part(part: Any) -> Predicate:
        return compiled_schema(part, schema_name)

    if isinstance(schema, bool):
        return _anything if schema else _nothing
    if unknown := schema.keys() - _KEYWORDS.keys() - _WITH_OTHERS - _ANNOTATIONS:
        raise ValueError(f"{schema_name}: no check is known for the keyword {min(unknown)!r}")
    checks = []
    if "$ref" in schema:
        name, _, pointer = schema["$ref"].partition("#")
        checks.append(_reference(name or schema_name, pointer))
    checks += [make(schema, compile_part) for keyword, make in _KEYWORDS.items() if keyword in schema]
    if "properties" not in schema and "additionalProperties" in schema:
        checks.append(_members(schema, compile_part))
    return _every(checks)


def _anything(_: Any) -> bool:
    return True


def _nothing(_: Any) -> bool:
    return False


def _every(checks: Iterable[Predicate]) -> Predicate:
    match list(checks):
        case []:
            return _anything
        case [only]:
            return only
        case [first, second]:
            return lambda value: first(value) and second(value)
        case several:
            first, second, *others = several
            rest = _every(others)
            return lambda value: first(value) and second(value) and rest(value)


def _reference(name: str, pointer: str) -> Predicate:
    return lambda value: _resolved(name, pointer)(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


_TYPES: dict[str, Predicate] = {
    "array": lambda value: isinstance(value, list),
    "boolean": lambda value: isinstance(value, bool),
    "integer": lambda value: (
        (isinstance(value, int) and not isinstance(value, bool)) or (isinstance(value, float) and value.is_integer())
    ),
    "null": lambda value: value is None,
    "number": _is_number,
    "object": lambda value: isinstance(value, dict),
    "string": lambda value: isinstance(value, str),
}
"""A number without a fraction is an integer however it is written, and a boolean is no number."""


def _type(schema: Mapping[str, Any], _: _Compile) -> Predicate:
    names = [schema["type"]] if isinstance(schema["type"], str) else schema["type"]
    checks = [_TYPES[name] for name in names]
    match checks:
        case [only]:
            return only
        case [first, second]:
            return lambda value: first(value) or second(value)
    return lambda value: any(check(value) for check in checks)


def _comparable(value: Any) -> Any:
    """Something to hash that is equal for equal values of JSON: 1 is 1.0, and is not true."""
    if isinstance(value, list):
        return "array", *map(_comparable, value)
    if isinstance(value, dict):
        return frozenset((key, _comparable(item)) for key, item in value.items())
    return (bool, value) if isinstance(value, bool) else value


def _enum(schema: Mapping[str, Any], _: _Compile) -> Predicate:
    allowed = frozenset(map(_comparable, schema["enum"]))
    return lambda value: _comparable(value) in allowed


def _const(schema: Mapping[str, Any], _: _Compile) -> Predicate:
    wanted = _comparable(schema["const"])
    return lambda value: bool(_comparable(value) == wanted)


def _unique_items(schema: Mapping[str, Any], _: _Compile) -> Predicate:
    if not schema["uniqueItems"]:
        return _anything
    return lambda value: not isinstance(value, list) or len(set(map(_comparable, value))) == len(value)


def _size(kind: type[Sized], keyword: str, fits: Callable[[int, int], bool]) -> Callable[[Any, _Compile], Predicate]:
    def make(schema: Mapping[str, Any], _: _Compile) -> Predicate:
        limit = schema[keyword]
        return lambda value: not isinstance(value, kind) or fits(len(value), limit)

    return make


def _bound(keyword: str, fits: Callable[[Any, Any], bool]) -> Callable[[Any, _Compile], Predicate]:
    def make(schema: Mapping[str, Any], _: _Compile) -> Predicate:
        limit = schema[keyword]
        return lambda value: not _is_number(value) or fits(value, limit)

    return make


def ecma_pattern(pattern: str) -> re.Pattern[str]:
    """A pattern of ECMA-262, whose ``$`` matches the end only; Python's also matches before a final newline."""
    return re.compile(pattern.replace("$", r"\Z"))


def _pattern(schema: Mapping[str, Any], _: _Compile) -> Predicate:
    search = ecma_pattern(schema["pattern"]).search
    return lambda value: not isinstance(value, str) or search(value) is not None


def _required(schema: Mapping[str, Any], _: _Compile) -> Predicate:
    wanted = frozenset(schema["required"])
    return lambda value: not isinstance(value, dict) or wanted <= value.keys()


def _property_names(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    check = compile_part(schema["propertyNames"])
    return lambda value: not isinstance(value, dict) or all(map(check, value))


def _members(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    """Members by the schema of their key, and further ones by that of all others."""
    known = {key: compile_part(part) for key, part in schema.get("properties", {}).items()}
    further = compile_part(schema.get("additionalProperties", True))

    def members(value: Any) -> bool:
        if isinstance(value, dict):
            for key, item in value.items():
                if not known.get(key, further)(item):
                    return False
        return True

    return members


def _items(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    """Items after those that have schemas of their own."""
    check, first = compile_part(schema["items"]), len(schema.get("prefixItems", ()))
    return lambda value: not isinstance(value, list) or all(map(check, islice(value, first, None) if first else value))


def _prefix_items(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    checks = [compile_part(part) for part in schema["prefixItems"]]
    return lambda value: (
        not isinstance(value, list) or all(check(item) for check, item in zip(checks, value, strict=False))
    )


def _contains(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    check = compile_part(schema["contains"])
    return lambda value: not isinstance(value, list) or any(map(check, value))


def _all_of(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    return _every(map(compile_part, schema["allOf"]))


def _any_of(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    checks = [compile_part(part) for part in schema["anyOf"]]
    return lambda value: any(check(value) for check in checks)


def _one_of(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    checks = [compile_part(part) for part in schema["oneOf"]]
    return lambda value: sum(check(value) for check in checks) == 1


def _not(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    check = compile_part(schema["not"])
    return lambda value: not check(value)


def _if(schema: Mapping[str, Any], compile_part: _Compile) -> Predicate:
    check, then, otherwise = (compile_part(schema.get(keyword, True)) for keyword in ("if", "then", "else"))
    return lambda value: then(value) if check(value) else otherwise(value)


_KEYWORDS: dict[str, Callable[[Any, _Compile], Predicate]] = {
    "type": _type,
    "maxItems": _size(list, "maxItems", lambda size, limit: size <= limit),
    "minItems": _size(list, "minItems", lambda size, limit: size >= limit),
    "maxProperties": _size(dict, "maxProperties", lambda size, limit: size <= limit),
    "minProperties": _size(dict, "minProperties", lambda size, limit: size >= limit),
    "maxLength": _size(str, "maxLength", lambda size, limit: size <= limit),
    "minLength": _size(str, "minLength", lambda size, limit: size >= limit),
    "minimum": _bound("minimum", lambda value, limit: bool(value >= limit)),
    "maximum": _bound("maximum", lambda value, limit: bool(value <= limit)),
    "exclusiveMinimum": _bound("exclusiveMinimum", lambda value, limit: bool(value > limit)),
    "exclusiveMaximum": _bound("exclusiveMaximum", lambda value, limit: bool(value < limit)),
    "const": _const,
    "enum": _enum,
    "pattern": _pattern,
    "required": _required,
    "propertyNames": _property_names,
    "properties": _members,
    "prefixItems": _prefix_items,
    "items": _items,
    "contains": _contains,
    "uniqueItems": _unique_items,
    "allOf": _all_of,
    "anyOf": _any_of,
    "oneOf": _one_of,
    "not": _not,
    "if": _if,
}
"""Makers of the predicate of a keyword, in the order in which values are looked at."""

_WITH_OTHERS = {"$ref", "additionalProperties", "then", "else"}
"""Keywords that other code reads."""

_ANNOTATIONS = {"$schema", "$id", "$defs", "title", "description", "format", "default", "examples"}
