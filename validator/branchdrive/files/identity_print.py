"""Prints of identities: 64 bits of each, to find those that repeat among many shards without keeping all texts."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["prints_of", "repeated"]

_Place = TypeVar("_Place")
_BITS = 64


def prints_of(identities: Iterable[str]) -> NDArray[np.uint64]:
    """The first 64 bits of the SHA-256 of each identity ``[identities]``."""
    digests = b"".join(
        hashlib.sha256(identity.encode("utf-8", "surrogatepass")).digest()[: _BITS // 8] for identity in identities
    )
    return np.frombuffer(digests, dtype=">u8").astype(np.uint64)


def repeated(
    prints: Mapping[_Place, NDArray[np.uint64]], read: Callable[[_Place], Iterable[str]]
) -> dict[str, list[_Place]]:
    """Identities that occur more than once, each with where it does.

    Args:
        prints: Prints of the identities at every place, such as a shard.
        read: Gives the identities at a place; called where a print repeats, which is nearly always an identity.
    """
    numbers, counts = np.unique(np.concatenate([*prints.values(), np.empty(0, np.uint64)]), return_counts=True)
    alike = numbers[counts > 1]
    found: dict[str, list[_Place]] = {}
    for place, own in prints.items() if len(alike) else ():
        if np.isin(own, alike, kind="sort").any():  # older numpy has no table of numbers of 64 bits
            for identity in read(place):
                found.setdefault(identity, []).append(place)
    return {identity: places for identity, places in found.items() if len(places) > 1}
