"""JSON documents: bounded parsing of untrusted text, and validation against the normative schemas.

Source: spec/03-layout.md, spec/09-security.md.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator

from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.resources import load_resource, schema_dir
from branchdrive.contract.schema_check import compiled_check, ecma_pattern

if TYPE_CHECKING:
    from jsonschema.protocols import Validator

_TOKEN = re.compile(r'"(?:[^"\\]++|\\.)*+"?|[\[\]{}]', re.DOTALL)
"""A string, closed or not, or a bracket; possessive, so that a scan takes linear time on any text."""

_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
"""Escape of half a surrogate pair; most stand next to their other half."""

__all__ = ["Integer", "dump_json", "parse_json", "schema_mismatches"]


def _integral(value: Any) -> Any:
    """An integer written as ``1.0`` is the integer 1, as JSON Schema has it."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Integer = Annotated[int, BeforeValidator(_integral)]
"""Integer of a document, with JSON Schema's meaning of ``integer``."""


def _shortened(text: str, length: int = 160) -> str:
    return text if len(text) <= length else text[: length - 1] + "…"


def _unique_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        repeated = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise ValueError(f"object repeats the key {_shortened(repr(repeated))}")
    return result


def _no_constant(name: str) -> Any:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    value = float(text)
    if value in (float("inf"), float("-inf")):
        raise ValueError(f"number {text[:40]} is out of range")
    return value


def _bounded_integer(text: str) -> int:
    if len(text) > 20:
        raise ValueError(f"number {text[:40]} is out of range")
    return int(text)


def _check_depth(text: str, max_depth: int) -> None:
    depth = 0
    for token in _TOKEN.finditer(text):
        if token[0] in "[{":
            depth += 1
            if depth > max_depth:
                raise ValueError(f"document nests deeper than {max_depth} levels")
        elif token[0] in "]}":
            depth -= 1


def parse_json(content: bytes, limits: Limits | None = None) -> Any:
    """Parsed JSON of untrusted bytes.

    Raises:
        ValueError: Not UTF-8, not JSON, NaN or infinity, repeated keys, half a surrogate pair, too large
            or nested too deep.
    """
    limits = limits or spec_limits()
    if len(content) > limits.max_document_bytes:
        raise ValueError(f"document has {len(content)} bytes; the limit is {limits.max_document_bytes}")
    text = content.decode("utf-8")
    _check_depth(text, limits.max_document_depth)
    document = json.loads(
        text,
        object_pairs_hook=_unique_object,
        parse_constant=_no_constant,
        parse_float=_finite,
        parse_int=_bounded_integer,
    )
    if _SURROGATE.search(text):
        try:
            json.dumps(document, ensure_ascii=False).encode()
        except UnicodeEncodeError as error:
            raise ValueError("text holds half of a surrogate pair, which is no character") from error
    return document


def dump_json(document: Any) -> bytes:
    """Canonical bytes of a document: sorted keys, two-space indent, UTF-8, final newline."""
    return (json.dumps(document, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n").encode()


@cache
def _validator(schema_name: str) -> Validator:
    from jsonschema import Draft202012Validator, validators
    from jsonschema.exceptions import ValidationError
    from referencing import Registry
    from referencing.jsonschema import DRAFT202012

    def as_ecma(_: Validator, pattern: str, instance: Any, _schema: Any) -> Iterator[ValidationError]:
        if isinstance(instance, str) and not ecma_pattern(pattern).search(instance):
            yield ValidationError(f"{instance!r} does not match {pattern!r}")

    # A schema that names its dialect is validated by the dialect's own class, also where a reference
    # reaches it: without the name, the class below holds across files.
    schemas = [load_resource(path.name) for path in sorted(schema_dir().glob("*.schema.json"))]
    nameless = [{key: value for key, value in schema.items() if key != "$schema"} for schema in schemas]
    registry = Registry[Any]().with_resources([(s["$id"], DRAFT202012.create_resource(s)) for s in nameless])
    validator_class = validators.extend(Draft202012Validator, {"pattern": as_ecma})
    validator: Validator = validator_class(load_resource(schema_name), registry=registry)
    return validator


def schema_mismatches(document: Any, schema_name: str) -> list[Mismatch]:
    """Places where `document` breaks the schema file `schema_name`, in order of their pointers; none if it conforms.

    Keys of a pointer and what was found are shortened, control characters escaped. Examination ends at an array or
    object that holds more than its schema allows, so that time and memory stay in proportion to what a conforming
    document may hold. A document that conforms, as most do, is looked at by the compiled check alone.
    """
    if compiled_check(schema_name)(document):
        return []
    errors = []
    for error in _validator(schema_name).iter_errors(document):
        errors.append(error)
        if error.validator in ("maxItems", "maxProperties"):
            break
    errors.sort(key=lambda error: list(error.absolute_path))
    found = ((_pointer(error.absolute_path), _demand(error), _shortened(repr(error.instance))) for error in errors)
    return [Mismatch({"pointer": pointer or "/"}, demand, value) for pointer, demand, value in dict.fromkeys(found)]


def _pointer(path: Iterable[str | int]) -> str:
    """JSON pointer as one line of printable text: other characters are escaped, long keys shortened."""
    keys = (_shortened(str(part)).replace("~", "~0").replace("/", "~1") for part in path)
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode()
        for char in "".join(f"/{key}" for key in keys)
    )


def _demand(error: Any) -> str:
    match error.validator:
        case "required":
            missing = [name for name in error.validator_value if name not in error.instance]
            return _shortened(f"properties {missing}", 200)
        case "additionalProperties" | "unevaluatedProperties":
            declared = ", ".join(sorted(error.schema.get("properties", {})))
            return _shortened(f"no undeclared property; {error.message}; declared are {declared or 'none'}", 200)
        case "anyOf" | "oneOf" | "contains" | "if" | "not" if "description" in error.schema:
            return _shortened(str(error.schema["description"]), 200)
        case _:
            return _shortened(f"{error.validator} {error.validator_value!r}", 200)
