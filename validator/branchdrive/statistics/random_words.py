"""Streams of random words, each a function of a seed and of its name alone, and what is drawn from them.

Output ``k`` of a stream is word ``k mod 4`` of the Philox-4x64 block of ten rounds with the counter
``floor(k / 4) + 1`` and the 128-bit key ``(seed, first 8 bytes of the SHA-256 of the name, little-endian)``.
Everything drawn is made of whole words by integer arithmetic, so no release of numpy, no processor and no other
stream changes it. The name of a stream stands where it is used, and nowhere else.

Source: spec/15-random-words.md; Salmon et al. 2011 (Philox).
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["WORDS_PER_NORMAL", "below", "bits", "counts", "group_orders", "normals", "orders", "uniforms", "words"]

Words = NDArray[np.uint64]

WORDS_PER_NORMAL = 3

_SEEDS = 2**64
_HALF = np.uint64(32)
_FIELDS_PER_NORMAL = 4 * WORDS_PER_NORMAL
_LARGEST_FIELD = 2**16 - 1


def words(seed: int, name: str, num_rows: int, num_columns: int, *, first_row: int = 0) -> Words:
    """Rows ``first_row ..`` of the stream `name`, ``[num_rows, num_columns]``; a row is whole blocks of four words.

    Raises:
        ValueError: `seed` is negative or needs more than 64 bits.
    """
    if not 0 <= seed < _SEEDS:
        raise ValueError(f"`seed` is {seed!r}, not in 0 .. 2**64 - 1")
    stream = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    blocks = -(-num_columns // 4)
    # numpy raises the counter by one before each block.
    philox = np.random.Philox(key=np.array([seed, stream], np.uint64), counter=first_row * blocks)
    return philox.random_raw(num_rows * blocks * 4).reshape(num_rows, blocks * 4)[:, :num_columns]


def below(values: Words, limit: int) -> NDArray[np.int64]:
    """Integers ``floor(h limit / 2^32)`` in ``0 .. limit - 1`` from the upper halves ``h`` of words, of their shape.

    Probabilities of two integers differ by at most ``2^-32``; `limit` is at most ``2^32``.
    """
    return (((values >> _HALF) * np.uint64(limit)) >> _HALF).astype(np.int64)


def counts(values: Words, num_units: int) -> NDArray[np.int64]:
    """How often each of `num_units` units is drawn by the words of a row: ``[rows, units]``, sums of `below`."""
    num_rows = len(values)
    line = np.arange(num_rows)[:, None] * num_units
    drawn = np.bincount((line + below(values, num_units)).ravel(), minlength=num_rows * num_units)
    return drawn.reshape(num_rows, num_units)


def bits(values: Words, num_bits: int) -> NDArray[np.uint8]:
    """The first `num_bits` bits of each row, lowest bit of the first word first: ``[rows, num_bits]`` of 0 and 1."""
    octets = np.ascontiguousarray(values).astype("<u8").view(np.uint8)
    return np.unpackbits(octets, axis=1, count=num_bits, bitorder="little")


def orders(values: Words) -> NDArray[np.intp]:
    """A uniform permutation of the columns for every row ``[rows, n]``: places in ascending order of their words.

    The lowest ``bit_length(n - 1)`` bits of a word are first replaced by its place, so that no two are equal.
    """
    num_places = values.shape[1]
    mask = np.uint64((1 << (num_places - 1).bit_length()) - 1)
    # Sorting words that carry their own place is quicker than `argsort`.
    carrying = np.sort((values & ~mask) | np.arange(num_places, dtype=np.uint64), axis=1)
    return (carrying & mask).astype(np.intp)


def group_orders(
    seed: int, name: str, num_rows: int, num_groups: int, num_actions: int, *, first_row: int = 0
) -> NDArray[np.intp]:
    """Orders of the actions of every group, ``[num_rows, num_groups, num_actions]``, one row of words for all groups.

    Raises:
        ValueError: `seed` is negative or needs more than 64 bits.
    """
    drawn = words(seed, name, num_rows, num_groups * num_actions, first_row=first_row)
    return orders(drawn.reshape(-1, num_actions)).reshape(-1, num_groups, num_actions)


def uniforms(values: Words) -> NDArray[np.float64]:
    """Numbers ``(floor(w / 2^12) + 1/2) / 2^52`` between 0 and 1, exact in float64, of the shape of the words."""
    return ((values >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def normals(values: Words) -> NDArray[np.float64]:
    """Nearly normal variates ``(sum of 12 fields - 393,210) / 2^16`` of rows of whole triples: ``[rows, words / 3]``.

    Fields are the 16-bit quarters of three words. The variate is a multiple of ``2^-16`` between -6 and 6 and exact
    in float64; its mean is 0, its variance ``1 - 2^-32``, its kurtosis 2.9.
    """
    num_rows, num_words = values.shape
    fields = np.ascontiguousarray(values).view(np.uint16)
    fields = fields.reshape(num_rows, num_words * 4 // _FIELDS_PER_NORMAL, _FIELDS_PER_NORMAL)
    centred = fields.sum(axis=2, dtype=np.int64) - _FIELDS_PER_NORMAL * _LARGEST_FIELD // 2
    return np.asarray(centred * 2.0**-16)
