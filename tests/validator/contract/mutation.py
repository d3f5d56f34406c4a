"""Small defects of JSON documents: one key or value of a conforming document, changed.

Replacement values come from the schemas themselves: every bound with its neighbours on both sides,
every listed value, and one value of every JSON type.
"""

from __future__ import annotations

import copy
import math
from functools import cache
from typing import TYPE_CHECKING, Any

from hypothesis import strategies as st

from branchdrive.contract.resources import load_resource, schema_dir

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hypothesis.strategies import DrawFn, SearchStrategy

Path = tuple[str | int, ...]

OF_EVERY_TYPE: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    -1,
    0.5,
    -0.0,
    1.0,
    1e300,
    2**63,
    -(2**63),
    "",
    "a",
    [],
    {},
)
"""Values of every JSON type, numbers of every kind among them."""

_BOUNDS = ("minimum", "maximum", "exclusiveMinimum", "minLength", "maxLength", "minItems", "maxItems")


def _nodes(value: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    yield path, value
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, member in items:
        yield from _nodes(member, (*path, key))


@cache
def boundary_values() -> tuple[Any, ...]:
    """Values at, just inside and just outside every bound of the schemas, and every listed value."""
    values: list[Any] = []
    for file in sorted(schema_dir().glob("*.schema.json")):
        for path, node in _nodes(load_resource(file.name)):
            word = path[-1] if path else None
            if word in _BOUNDS and isinstance(node, int | float):
                values += [
                    node,
                    node - 1,
                    node + 1,
                    math.nextafter(node, -math.inf),
                    math.nextafter(node, math.inf),
                ]
            elif word == "const":
                values.append(node)
            elif word == "enum" and isinstance(node, list):
                values += node
    return tuple({(type(value), repr(value)): value for value in values}.values())


def _twisted(value: Any) -> list[Any]:
    """Values next to `value`: the same number in another notation, the same text with an addition."""
    match value:
        case bool():
            return [int(value), str(value).lower()]
        case int():
            return [float(value), value + 0.5, value + 1, value - 1, bool(value), str(value), -value]
        case float():
            neighbours = [math.nextafter(value, -math.inf), math.nextafter(value, math.inf)]
            return [*neighbours, -value, str(value), int(value), [value]]
        case str():
            texts = [
                value + "\n",
                "\n" + value,
                value + " ",
                value.upper(),
                value + "\x00",
                value + "é",
                value + "\u0661",
            ]
            return [*texts, value[:-1], value * 40, value[:1] * 128, value[:1] * 129, [value]]
        case list():
            return [
                value + value[:1],
                value[:-1],
                value[::-1],
                [*value, None],
                dict(enumerate(map(str, value))),
                value * 9,
            ]
        case dict():
            return [list(value), {}, [value], None]
    return [0, "null", [None]]


def neighbours(document: dict[str, Any], part: str) -> Iterator[dict[str, Any]]:
    """Every document that differs from `document` at one place below the property `part`."""
    for path, value in list(_nodes(document[part], (part,))):
        other = copy.deepcopy(document)
        del _parent(other, path)[path[-1]]
        yield other
        for replacement in [*_twisted(value), *OF_EVERY_TYPE]:
            other = copy.deepcopy(document)
            _parent(other, path)[path[-1]] = copy.deepcopy(replacement)
            yield other
        if isinstance(value, dict):
            other = copy.deepcopy(document)
            (_parent(other, path)[path[-1]])["extra"] = 0
            yield other


def _parent(document: Any, path: Path) -> Any:
    for key in path[:-1]:
        document = document[key]
    return document


@st.composite
def mutated(draw: DrawFn, documents: SearchStrategy[Any]) -> Any:
    """Documents with one or two changes; a change may leave the document conforming."""
    document = copy.deepcopy(draw(documents))
    for _ in range(draw(st.integers(1, 2))):
        nodes = list(_nodes(document))
        path, value = draw(st.sampled_from(nodes))
        change = draw(st.sampled_from(("replace", "twist", "swap", "delete", "add")))
        if change == "add" and isinstance(value, dict):
            value[draw(st.sampled_from(("value", "name", "extra", "", "key\n")))] = copy.deepcopy(
                draw(st.sampled_from(nodes))[1]
            )
        elif change == "add" and isinstance(value, list):
            item = copy.deepcopy(draw(st.sampled_from([*value, value])))
            value.insert(draw(st.integers(0, len(value))), item)
        elif not path:
            return draw(st.sampled_from(OF_EVERY_TYPE))
        elif change == "delete":
            del _parent(document, path)[path[-1]]
        else:
            alike = [other for place, other in nodes if place and place[-1] == path[-1]]
            pool = {"twist": _twisted(value), "swap": alike}.get(change, [*OF_EVERY_TYPE, *boundary_values()])
            _parent(document, path)[path[-1]] = copy.deepcopy(draw(st.sampled_from(pool)))
    return document
