"""Identities that repeat among shards are found by 64 bits of each, and told exactly."""

from __future__ import annotations

import numpy as np

from branchdrive.files.identity_print import prints_of, repeated


def test_what_repeats_is_told_with_its_places() -> None:
    ids = {"A": ["a", "b"], "B": ["c"], "C": ["b", "d", "d"]}
    prints = {place: prints_of(own) for place, own in ids.items()}
    assert repeated(prints, ids.__getitem__) == {"b": ["A", "C"], "d": ["C", "C"]}


def test_nothing_is_read_where_nothing_repeats() -> None:
    assert repeated({"A": prints_of(["a"]), "B": prints_of([])}, {}.__getitem__) == {}


def test_equal_prints_of_different_identities_are_no_repetition() -> None:
    prints = {place: np.array([7], np.uint64) for place in "AB"}
    assert repeated(prints, lambda place: [place]) == {}
