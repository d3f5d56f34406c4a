"""Streams of random words, each a function of a seed and of its name alone.

Word ``k`` of a stream is output ``k`` of Philox-4x64 with the 128-bit key ``(seed, first 8 bytes of the
SHA-256 of the name, little-endian)``. Everything drawn from a stream is made of whole words by integer
arithmetic, so no release of numpy and no other stream changes it.

Source: Salmon et al. 2011 (Philox).
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["below", "bits", "orders", "words"]

Words = NDArray[np.uint64]

_SEEDS = 2**64
_HALF = np.uint64(32)


def words(seed: int, name: str, num_rows: int, num_columns: int, *, first_row: int = 0) -> Words:
    """Rows ``first_row ..`` of the stream `name`, ``[num_rows, num_columns]``; a row is whole blocks of four words.

    Raises:
        ValueError: `seed` is negative or needs more than 64 bits.
    """
    if not 0 <= seed < _SEEDS:
        raise ValueError(f"`seed` is {seed!r}, not in 0 .. 2**64 - 1")
    stream = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    blocks = -(-num_columns // 4)
    philox = np.random.Philox(key=np.array([seed, stream], np.uint64), counter=first_row * blocks)
    return philox.random_raw(num_rows * blocks * 4).reshape(num_rows, -1)[:, :num_columns]


def below(values: Words, limit: int) -> NDArray[np.int64]:
    """Integers ``floor(h limit / 2^32)`` in ``0 .. limit - 1`` from the upper halves ``h`` of words, of their shape."""
    return (((values >> _HALF) * np.uint64(limit)) >> _HALF).astype(np.int64)


def bits(values: Words, num_bits: int) -> NDArray[np.uint8]:
    """The first `num_bits` bits of each row, lowest bit of the first word first: ``[rows, num_bits]`` of 0 and 1."""
    octets = np.ascontiguousarray(values).astype("<u8").view(np.uint8)
    return np.unpackbits(octets, axis=1, count=num_bits, bitorder="little")


def orders(values: Words) -> NDArray[np.int64]:
    """A uniform permutation of the columns for every row: the places of its words in ascending order."""
    return np.argsort(values, axis=1, kind="stable").astype(np.int64)
