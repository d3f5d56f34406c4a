"""What was computed of the last maps, for shards that hold the same: most shards of a dataset hold one map.

A map is known by the bytes of its columns, so an answer is that of these very elements in this very order.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

from branchdrive.raw.shard_view import ShardView

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["once_per_map"]

T = TypeVar("T")

_MAX_MAPS = 2
"""Maps of which answers are kept: a grid of the largest takes a hundred megabytes."""

_known: dict[bytes, dict[Hashable, Any]] = {}
_lock = Lock()


def once_per_map(view: ShardView, compute: Callable[[ShardView], T], *further: Hashable) -> T:
    """What `compute` says of a shard, if all that it reads are the shard's map and what is named by `further`."""
    digest = view.cached(_digest)
    with _lock:
        answers = _known.setdefault(digest, {})
        if len(_known) > _MAX_MAPS:
            del _known[next(iter(_known))]
    key = (compute, *further)
    if key not in answers:
        answers[key] = compute(view)
    found: T = answers[key]
    return found


def _digest(view: ShardView) -> bytes:
    """SHA-256 of the map as it is held: types, and buffers of every piece of every column."""
    table = view.map.arrow
    found = hashlib.sha256(str(table.schema).encode())
    for column in table.columns:
        for piece in column.chunks:
            _add(found, piece)
    return found.digest()


def _add(found: hashlib._Hash, piece: pa.Array) -> None:
    import pyarrow as pa

    buffers = piece.buffers()
    found.update(f"{piece.type} {piece.offset} {len(piece)} {[buffer and buffer.size for buffer in buffers]}".encode())
    for buffer in buffers:
        if buffer is not None:
            found.update(buffer)
    if pa.types.is_dictionary(piece.type):
        _add(found, piece.dictionary)
