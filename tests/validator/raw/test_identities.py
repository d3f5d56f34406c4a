"""Identities in blocks: the texts that went in, and those that occur again."""

from __future__ import annotations

import pickle
from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.files.identities import Identities, repeated_texts

TEXTS = st.lists(st.text(max_size=6), max_size=12)


@given(TEXTS)
def test_the_texts_come_back(texts: list[str]) -> None:
    found = pickle.loads(pickle.dumps(Identities(texts)))
    assert [*found] == texts
    assert found == texts
    assert (len(found), found[1:3]) == (len(texts), texts[1:3])
    assert found.digests.tolist() == Identities.of(texts).digests.tolist()


def test_texts_that_no_file_holds_are_no_error() -> None:
    assert [*Identities(["\ud800", "", "\n"])] == ["\ud800", "", "\n"]


def test_many_alike_take_less_than_half_of_their_length() -> None:
    texts = [f"g{i:05d}-accident.accelerate_0.{i % 10}0.reference-1.a1" for i in range(1000)]
    assert len(pickle.dumps(Identities(texts))) < sum(map(len, texts)) / 2


@given(st.lists(TEXTS, max_size=4))
def test_repeated_texts_are_named_with_their_places(every: list[list[str]]) -> None:
    count = Counter(text for texts in every for text in texts)
    expected = {
        text: [place for place, texts in enumerate(every) for other in texts if other == text]
        for text, times in count.items()
        if times > 1
    }
    found = repeated_texts([Identities(texts) if place % 2 else texts for place, texts in enumerate(every)])
    assert found == expected
    assert [*found] == [*expected]


def test_texts_of_one_digest_are_told_apart() -> None:
    one, other = Identities(["a", "b"]), Identities(["c", "a"])
    for block in (one, other):
        block.digests = np.zeros(2, np.uint64)
    assert repeated_texts([one, other]) == {"a": [0, 1]}
