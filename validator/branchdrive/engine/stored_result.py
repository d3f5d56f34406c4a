"""Results as bytes, and back: a JSON document, and the arrays that it refers to one after the other.

A reader constructs values of the classes below and nothing else; nothing is ever unpickled. Every value comes
back with its type: numbers of numpy, tuples and sets, arrays of any shape, masked ones, text and lists in cells.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mismatch, Mismatches
from branchdrive.driving.response import Responses, Sights
from branchdrive.driving.target import Targets, Trajectory
from branchdrive.driving.track_end import TrackEnds
from branchdrive.engine.derived_rules import LayersResult
from branchdrive.engine.finding import Finding
from branchdrive.engine.shard import ShardResult
from branchdrive.engine.tally import Tallies, Tally
from branchdrive.files.group_marks import Outlines, Tracks
from branchdrive.files.identities import Identities
from branchdrive.model.arrays import Masked, ModelArrays
from branchdrive.raw.funnel import Funnel, GroupOutcome

__all__ = ["from_bytes", "to_bytes"]

_CLASSES = {
    one.__name__: one
    for one in (
        Finding, Funnel, GroupOutcome, Identities, LayersResult, Masked, Mismatch, Mismatches, ModelArrays, Outlines,
        Responses, ShardResult, Sights, Tallies, Tally, Targets, TrackEnds, Tracks, Trajectory,
    )
}  # fmt: skip
_KINDS = "biufSUM"
"""Kinds of arrays whose bytes are their values."""

_PLAIN = (str, int, bool, float, type(None))
"""Classes of values that JSON has."""

_FORMS = ("array", "bytes", "counter", "frozenset", "map", "masked", "objects", "scalar", "set", "tuple")
"""What JSON has no form for."""


def to_bytes(value: Any) -> bytes:
    """A result as bytes; equal results give equal bytes.

    Raises:
        TypeError: It holds what cannot be written.
    """
    blocks: list[bytes] = []
    document = json.dumps(_written(value, blocks), separators=(",", ":")).encode()
    return b"".join((len(document).to_bytes(8, "little"), document, *blocks))


def from_bytes(content: bytes) -> Any:
    """The result that was written.

    Raises:
        ValueError: These are no bytes of a result.
    """
    try:
        start = 8 + int.from_bytes(content[:8], "little")
        reader = _Reader(memoryview(content)[start:])
        value = reader.value(json.loads(content[8:start]))
        if start + reader.place != len(content):
            raise ValueError(f"{len(content)} bytes, not {start + reader.place}")
    except (AttributeError, IndexError, KeyError, OverflowError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"no bytes of a result: {error}") from error
    return value


def _written(value: Any, blocks: list[bytes]) -> Any:
    """JSON of a value; what JSON has no form for is an object of one member, which names what it is."""
    if type(value) in _PLAIN:
        return value
    name = type(value).__name__
    if _CLASSES.get(name) is type(value):
        return {name: {one: _written(part, blocks) for one, part in _parts(value)}}
    write = partial(_written, blocks=blocks)
    match value:
        case np.ma.MaskedArray():
            fill = np.asarray(value.fill_value, value.dtype)
            return {"masked": [write(value.data), write(np.ma.getmaskarray(value)), write(fill)]}
        case np.ndarray():
            return _written_array(value, blocks)
        case np.generic():
            return {"scalar": _written_array(np.asarray(value), blocks)}
        case list():
            return [write(one) for one in value]
        case bytes():
            return {"bytes": write(np.frombuffer(value, np.uint8))}
        case frozenset() | set():
            return {type(value).__name__: [write(one) for one in sorted(value)]}
        case Counter():
            return {"counter": [[write(key), count] for key, count in value.items()]}
        case Mapping():
            return {"map": [[write(key), write(one)] for key, one in value.items()]}
    if type(value) is tuple:
        return {"tuple": [write(one) for one in value]}
    raise TypeError(f"results hold no {type(value)}")


def _parts(value: Any) -> Iterator[tuple[str, Any]]:
    """What a value of a class is made of: its fields, but for those that are as they are by default."""
    if isinstance(value, Identities):
        yield "texts", [*value]
        return
    if isinstance(value, Tallies):
        yield from zip(("rules", "numbers", "others"), value.parts, strict=True)
        return
    if isinstance(value, tuple):
        yield from zip(value._fields, value, strict=True)  # type: ignore[attr-defined]
        return
    for one in fields(value):
        part = getattr(value, one.name)
        if type(part) in _PLAIN:
            is_default = type(part) is type(one.default) and part == one.default
        else:
            is_default = type(part) in (list, dict) and not part and one.default_factory in (list, dict)
        if not is_default:
            yield one.name, part


def _written_array(array: NDArray[Any], blocks: list[bytes]) -> Any:
    if array.dtype.hasobject:
        cells = array.ravel().tolist()
        is_text = all(type(cell) is str for cell in cells)
        return {"objects": [list(array.shape), cells if is_text else [_written(cell, blocks) for cell in cells]]}
    if array.dtype.kind not in _KINDS:
        raise TypeError(f"results hold no arrays of {array.dtype}")
    blocks.append(array.tobytes())
    return {"array": [array.dtype.str, list(array.shape)]}


class _Reader:
    """Reads what was written, and takes blocks of arrays in the order in which they were."""

    def __init__(self, content: memoryview) -> None:
        self._content, self.place = content, 0

    def value(self, written: Any) -> Any:
        """The value that JSON stands for."""
        kind = type(written)
        if kind in _PLAIN:
            return written
        if kind is list:
            return [one if type(one) in _PLAIN else self.value(one) for one in written]
        ((name, content),) = written.items()
        if name not in _FORMS:
            return _CLASSES[name](**{one: self.value(part) for one, part in content.items()})
        return getattr(self, f"_{name}")(content)

    def _array(self, written: Any) -> NDArray[Any]:
        dtype, shape = np.dtype(written[0]), tuple(written[1])
        if dtype.kind not in _KINDS or min(shape, default=0) < 0:
            raise ValueError(f"results hold no arrays of {dtype} and shape {shape}")
        start = self.place
        self.place += dtype.itemsize * math.prod(shape)
        return np.frombuffer(self._content[start : self.place], dtype).reshape(shape).copy()

    def _bytes(self, written: Any) -> bytes:
        return bytes(self.value(written))

    def _counter(self, written: Any) -> Counter[Any]:
        return Counter({self.value(key): count for key, count in written})

    def _frozenset(self, written: Any) -> frozenset[Any]:
        return frozenset(map(self.value, written))

    def _map(self, written: Any) -> dict[Any, Any]:
        value = self.value
        return {key if type(key) is str else value(key): value(one) for key, one in written}

    def _masked(self, written: Any) -> np.ma.MaskedArray[Any, Any]:
        data, mask, fill = map(self.value, written)
        return np.ma.MaskedArray(data, mask=mask, fill_value=fill[()])

    def _objects(self, written: Any) -> NDArray[Any]:
        shape, cells = written
        array = np.empty(len(cells), object)
        array[:] = np.fromiter(map(self.value, cells), object, len(cells))
        return array.reshape(shape)

    def _scalar(self, written: Any) -> Any:
        return self.value(written)[()]

    def _set(self, written: Any) -> set[Any]:
        return set(map(self.value, written))

    def _tuple(self, written: Any) -> tuple[Any, ...]:
        return tuple(map(self.value, written))
