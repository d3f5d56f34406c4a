"""Changes of JSON documents at one place: what a stranger may have removed, replaced, repeated or turned around."""

from __future__ import annotations

import copy
import random
from collections.abc import Iterator
from typing import Any

from tests.validator.contract.mutation import OF_EVERY_TYPE

__all__ = ["Place", "changed", "changes", "sample"]

Place = tuple[str | int, ...]

REMOVED = object()


def places(value: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Every value below the root with the keys that lead to it."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, member in items:
        yield (*place, key), member
        yield from places(member, (*place, key))


def replacements(value: Any) -> Iterator[Any]:
    """What may stand in the place of a value: nothing, every type, its neighbours, and what is out of all bounds."""
    yield REMOVED
    yield from OF_EVERY_TYPE
    yield from ("NaN", "x" * 150)
    match value:
        case bool():
            yield not value
        case int() | float():
            yield from (value + 1, value - 1, -value, value * 1e6, float(value))
        case str():
            yield from (f"{value}x", value[::-1], value[:-1] + ("1" if value[-1:] == "0" else "0"))
        case list():
            yield from (value + value[:1], value[:-1], value[::-1], [*value, None], value[:1] * len(value))
        case dict():
            yield {**value, "extra": 0}
            yield dict(zip(value, reversed(value.values()), strict=True))


def changes(document: Any) -> list[tuple[Place, Any]]:
    """Every place of a document with every replacement."""
    return [(place, new) for place, value in places(document) for new in replacements(value)]


def sample(name: str, document: Any, size: int) -> list[tuple[Place, Any]]:
    """Changes of the document of that name, always the same."""
    found = changes(document)
    return random.Random(f"changes of {name}").sample(found, min(size, len(found)))


def changed(document: Any, place: Place, new: Any) -> Any:
    """The document with one change."""
    result = copy.deepcopy(document)
    parent = result
    for key in place[:-1]:
        parent = parent[key]
    if new is REMOVED:
        del parent[place[-1]]
    else:
        parent[place[-1]] = copy.deepcopy(new)
    return result
