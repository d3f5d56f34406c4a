"""What precedes a branch as cells: groups in which a column shows the same, whatever it means.

A code of the best action need not rank anything: it is enough that groups that show the same have one best action.
Readings of a column part the groups into cells without looking at any outcome:

* of numbers at one time: equal ones; clusters, parted at the widest gaps; equal last bits of the float32; clusters of
  what is left beside whole multiples of 1, 0.1, .. 0.0001;
* of a history: equal histories; equal signs of its steps; equal numbers of different values; equal last bits, or flags,
  at some successive times;
* of texts: equal ones; equal characters at one place from either end; equal remainders of the last number in them, of
  the sums of their characters and of their digits, and of their SHA-256.

Source: this project's choice; spec/13-leakage.md#codes.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.streams import DIFFERENT, num_different

__all__ = ["Readings", "readings_of_history", "readings_of_numbers", "readings_of_pair", "readings_of_texts"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MULTIPLES = (1.0, 0.1, 0.01, 0.001, 0.0001)
"""Multiples beside which a number is read."""

_ABSENT = -(2.0**40)
"""Number that stands for one that is not there."""

_CHARACTERS = 16
"""Characters of a text that are read, from either end."""

_DIGITS, _DIGIT = re.compile(r"[0-9]{1,40}(?=[^0-9]*$)"), re.compile("[0-9]")


class Readings(NamedTuple):
    """Ways to read a column.

    Attributes:
        ways: What is read ``[readings]``.
        cells: Cell of every group, from 0 ``[readings, groups]``.
    """

    ways: list[str]
    cells: Index

    @classmethod
    def joined(cls, parts: Sequence[Readings], num_groups: int) -> Readings:
        """All readings of several of a number of groups."""
        cells = [np.zeros((0, num_groups), np.int64), *(part.cells for part in parts)]
        return cls([way for part in parts for way in part.ways], np.concatenate(cells))


def readings_of_history(values: Array, times: Sequence[str], num_actions: int) -> Readings:
    """Readings of a column at its times, and of its history as a whole.

    Args:
        values: ``[groups, times]``; what is not finite is not there.
        times: How each time is called.
        num_actions: Actions that a code must tell apart.
    """
    there = _filled(values)
    whole = [
        (f"the history at {len(times)} times", _equal_rows(there)),
        ("which values of the history rise, fall and repeat", _equal_rows(np.sign(np.diff(there, axis=1)))),
        (f"the {DIFFERENT}", _equal(num_different(there)[None])[0]),
    ]
    history = Readings([way for way, _ in whole], np.array([cells for _, cells in whole]))
    runs = _runs_of_bits(there, times, _num_bits(num_actions))
    return Readings.joined([history, runs, readings_of_numbers(values, times, num_actions)], len(values))


def _runs_of_bits(there: Array, times: Sequence[str], num_bits: int) -> Readings:
    """Readings of one bit at each of so many successive times: of flags themselves, of other numbers the last one."""
    if len(times) < num_bits:
        return Readings.joined([], len(there))
    is_flag = np.isin(there, (0.0, 1.0)).all()
    bits = there.astype(np.int64) if is_flag else _last_bits(there, 1)
    runs = np.lib.stride_tricks.sliding_window_view(bits, num_bits, axis=1) @ (1 << np.arange(num_bits))
    what = "flags" if is_flag else "last bits"
    return Readings([f"the {what} at {num_bits} times from the one {time}" for time in times[: runs.shape[1]]], runs.T)


def readings_of_numbers(values: Array, names: Sequence[str], num_actions: int) -> Readings:
    """Readings of numbers, each for itself.

    Args:
        values: ``[groups, numbers]``; what is not finite is not there.
        names: How each is called.
        num_actions: Actions that a code must tell apart.
    """
    there = _filled(values).T
    varies = (there != there[:, :1]).any(axis=1)
    numbers, kept = there[varies], [name for name, kept in zip(names, varies.tolist(), strict=True) if kept]
    num_bits = _num_bits(num_actions)
    parts = [
        Readings([f"the value {name}" for name in kept], _equal(numbers)),
        Readings([f"the cluster of the value {name}" for name in kept], _clusters(numbers, num_actions)),
        Readings([f"the last {num_bits} bits {name}" for name in kept], _last_bits(numbers, num_bits)),
    ]
    for multiple in _MULTIPLES:
        left = numbers - multiple * np.rint(numbers / multiple)
        ways = [f"what is left beside multiples of {multiple:g} {name}" for name in kept]
        parts.append(Readings(ways, _clusters(left, num_actions)))
    return Readings.joined(parts, len(values))


def readings_of_texts(texts: Sequence[str], num_actions: int) -> Readings:
    """Readings of a text of every group ``[groups]``."""
    found = [("the value", _equal_texts(texts))]
    for way, ordered in (("character", texts), ("character from the end", [text[::-1] for text in texts])):
        letters = np.array(ordered, f"<U{_CHARACTERS}").view("<U1").reshape(len(texts), _CHARACTERS)
        found += [(f"{way} {place + 1}", _equal_texts(letters[:, place])) for place in range(_CHARACTERS)]
    last = [int(match.group()) if (match := _DIGITS.search(text)) else -1 for text in texts]
    hashed = [int.from_bytes(hashlib.sha256(text.encode()).digest(), "big") for text in texts]
    characters = [sum(map(ord, text)) for text in texts]
    digits = [sum(int(digit) for digit in _DIGIT.findall(text)) for text in texts]
    for way, numbers in (
        ("the last number in it", last), ("the sum of its characters", characters),
        ("the sum of its digits", digits), ("its SHA-256", hashed),
    ):  # fmt: skip
        found.append((f"{way} modulo {num_actions}", np.array([number % num_actions for number in numbers], np.int64)))
    return Readings([way for way, _ in found], np.array([cells for _, cells in found]))


def readings_of_pair(first: Sequence[str], second: Sequence[str]) -> Readings:
    """Readings of two texts of every group together ``[groups]``."""
    return Readings(["both values"], _equal_rows(np.stack([_equal_texts(first), _equal_texts(second)], axis=1))[None])


def _num_bits(num_actions: int) -> int:
    """Bits that tell so many actions apart."""
    return (num_actions - 1).bit_length()


def _last_bits(numbers: Array, num_bits: int) -> Index:
    """The lowest bits of numbers as float32."""
    with np.errstate(over="ignore"):
        return (numbers.astype(np.float32).view(np.uint32) & np.uint32((1 << num_bits) - 1)).astype(np.int64)


def _filled(values: Array) -> Array:
    return np.where(np.isfinite(values), values, _ABSENT)


def _equal_texts(texts: Sequence[str] | NDArray[np.str_]) -> Index:
    return np.unique(np.asarray(texts, np.str_), return_inverse=True)[1].astype(np.int64)


def _equal_rows(rows: NDArray[np.generic]) -> Index:
    """Cells of equal rows ``[groups]`` of ``[groups, columns]``."""
    return np.asarray(np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1), np.int64)


def _equal(numbers: Array) -> Index:
    """Cells of equal numbers ``[numbers, groups]``."""
    order = np.argsort(numbers, axis=1, kind="stable")
    ordered = np.take_along_axis(numbers, order, 1)
    return _parted(order, ordered[:, 1:] != ordered[:, :-1])


def _clusters(numbers: Array, num_clusters: int) -> Index:
    """Cells of numbers ``[numbers, groups]`` parted at the widest gaps, of equal ones at the lowest."""
    order = np.argsort(numbers, axis=1, kind="stable")
    gaps = np.diff(np.take_along_axis(numbers, order, 1), axis=1)
    widest = np.argsort(-gaps, axis=1, kind="stable")[:, : num_clusters - 1]
    is_cut = np.zeros(gaps.shape, np.bool_)
    np.put_along_axis(is_cut, widest, np.take_along_axis(gaps, widest, 1) > 0, 1)
    return _parted(order, is_cut)


def _parted(order: NDArray[np.intp], is_cut: NDArray[np.bool_]) -> Index:
    """Cells of groups in an order ``[numbers, groups]`` that is cut behind some of them."""
    place = np.concatenate([np.zeros((len(order), 1), np.int64), np.cumsum(is_cut, axis=1)], axis=1)
    cells = np.empty_like(place)
    np.put_along_axis(cells, order, place, 1)
    return cells
