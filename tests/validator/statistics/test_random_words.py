"""The random stream against its vectors, and the vectors against a second implementation in whole numbers."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.validator.statistics import random_words as reference

from branchdrive.contract.resources import load_resource
from branchdrive.statistics.random_words import below, bits, counts, normals, orders, uniforms, words


@pytest.fixture(scope="module")
def vectors() -> Any:
    return load_resource("vectors/random-words.json")


def read(numbers: list[str]) -> NDArray[np.uint64]:
    return np.array([int(number, 16) for number in numbers], np.uint64)


def test_the_vectors_are_those_of_whole_numbers(vectors: Any) -> None:
    assert vectors == json.loads(reference.text())
    assert reference.PATH.read_text(encoding="utf-8") == reference.text()


def test_the_stream_gives_the_vectors(vectors: Any) -> None:
    for case in vectors["rows"]:
        drawn = words(int(case["seed"]), case["name"], 1, case["num_words"], first_row=case["row"])
        np.testing.assert_array_equal(drawn[0], read(case["words"]))
    for case in vectors["below"]:
        assert below(read(case["words"]), case["limit"]).tolist() == case["integers"]
    for case in vectors["counts"]:
        assert counts(read(case["words"])[None], case["num_units"])[0].tolist() == case["counts"]
    for case in vectors["signs"]:
        assert (1 - 2.0 * bits(read(case["words"])[None], case["num_signs"])[0]).tolist() == case["signs"]
    for case in vectors["orders"]:
        assert orders(read(case["words"])[None])[0].tolist() == case["order"]
    for case in vectors["uniforms"]:
        assert uniforms(read([case["word"]]))[0] * 2**53 == case["numerator"]
    for case in vectors["normals"]:
        assert normals(read(case["words"])[None])[0].tolist() == [case["variate"]]


def test_blocks_are_those_of_the_bit_generator(vectors: Any) -> None:
    for case in vectors["philox"]:
        counter = (int(case["counter"]) - 1) % 2**256
        drawn = np.random.Philox(key=read(case["key"]), counter=counter).random_raw(4)
        np.testing.assert_array_equal(drawn, read(case["words"]))


@given(st.integers(0, 2**64 - 1), st.text(max_size=9), st.integers(0, 2**40), st.integers(1, 30), st.integers(1, 2**32))
@settings(max_examples=40)
def test_draws_are_those_of_whole_numbers(seed: int, name: str, number: int, num_words: int, limit: int) -> None:
    drawn = words(seed, name, 1, num_words, first_row=number)
    expected = reference.row(seed, name, number, num_words)
    assert drawn[0].tolist() == expected
    assert below(drawn, limit)[0].tolist() == [reference.below(word, limit) for word in expected]
    assert counts(drawn, num_words)[0].tolist() == reference.counts(expected, num_words)
    assert bits(drawn, 63 * num_words)[0].tolist() == reference.sign_bits(expected, 63 * num_words)
    assert orders(drawn)[0].tolist() == reference.order(expected)
    assert uniforms(drawn)[0].tolist() == [reference.uniform(word) for word in expected]
    triples = [expected[i : i + 3] for i in range(0, num_words - 2, 3)]
    assert normals(drawn[:, : 3 * len(triples)])[0].tolist() == [reference.normal(triple) for triple in triples]


def test_variates_are_nearly_normal() -> None:
    drawn = normals(words(0, "normals", 1000, 600)).ravel()
    assert abs(drawn.mean()) < 4 / np.sqrt(drawn.size)
    assert drawn.var() == pytest.approx(1, abs=0.01)
    assert (drawn**4).mean() == pytest.approx(2.9, abs=0.05)
    assert np.abs(drawn).max() <= 6
