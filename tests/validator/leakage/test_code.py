"""Codes of the best action: chance is bounded, readings find what ranks nothing, and few groups say nothing."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise, permutations

import numpy as np
import pytest

from branchdrive.leakage import code
from branchdrive.leakage.cells import (
    Readings,
    readings_of_history,
    readings_of_numbers,
    readings_of_pair,
    readings_of_texts,
)
from branchdrive.leakage.code import Answers, Order, TooFewError, best_answers, codes

UNITS, ACTIONS, TIMES = 60, 7, 16
RNG = np.random.default_rng(11)
ANSWER = RNG.permutation(np.repeat(np.arange(5), 12))
CODE = np.array([4, 0, 3, 1, 2])[ANSWER]
"""Answers in an order of no meaning."""

NAMES = [f"at tick {tick}" for tick in range(TIMES)]


def asked(answer: np.ndarray = ANSWER) -> list[Answers]:
    return [Answers.of("the best action", np.arange(len(answer)), answer)]


def noise() -> np.ndarray:
    return RNG.normal(size=(UNITS, TIMES)).astype(np.float32).astype(np.float64)


def found(readings: Readings, order: Order | None = None) -> list[str]:
    return [one.how for one in codes([(readings, order)], asked())]


# --- chance


@pytest.mark.parametrize(
    "cells", [(0, 0, 0, 1, 1, 1, 2), (0, 0, 1, 1, 2, 2, 2), (0, 0, 0, 0, 1, 1, 2), (0, 1, 2, 3, 4, 5, 5)]
)
@pytest.mark.parametrize("answer", [(0, 0, 0, 1, 1, 2, 2), (0, 0, 0, 0, 0, 1, 2), (0, 0, 1, 1, 2, 2, 3)])
def test_no_permutation_has_a_larger_chance(cells: tuple[int, ...], answer: tuple[int, ...]) -> None:
    """Of all orders of the answers, no larger share agrees as well as some order than the chance that is stated."""
    orders = np.array(sorted(set(permutations(answer))))
    names = np.arange(len(cells))
    judged = [code._judged(np.array([cells]), Answers("", names, order, is_rich=True)) for order in orders]
    agreeing = np.array([int(one.agreeing[0]) for one in judged])
    assert len(set(agreeing.tolist())) > 1
    for one, number in zip(judged, agreeing, strict=True):
        assert (agreeing >= number).mean() <= math.exp(one.log_p[0]) + 1e-12


@pytest.mark.parametrize("answer", [(0, 0, 0, 1, 1, 2, 2), (0, 0, 0, 0, 1, 1, 1)])
def test_no_order_has_a_larger_chance(answer: tuple[int, ...]) -> None:
    changes = np.array([sum(a != b for a, b in pairwise(order)) for order in sorted(set(permutations(answer)))])
    for number in sorted(set(changes.tolist())):
        assert (changes <= number).mean() <= code._chance_of_order(
            number, Answers("", np.arange(7), np.array(answer), is_rich=True)
        ) + 1e-12


# --- what is found


def planted(plant: Callable[[np.ndarray], None]) -> np.ndarray:
    values = noise()
    plant(values)
    return values


def in_clusters(values: np.ndarray) -> None:
    values[:, 5] = CODE + 0.25 * np.tanh(values[:, 5])


def in_digits(values: np.ndarray) -> None:
    values[:, 5] = np.rint(100 * values[:, 5]) / 10 + 0.002 * CODE


def in_bits(values: np.ndarray) -> None:
    words = values[:, 3].astype(np.float32).view(np.uint32)
    values[:, 3] = ((words & ~np.uint32(7)) | CODE.astype(np.uint32)).view(np.float32)


def in_bits_at_successive_times(values: np.ndarray) -> None:
    words = values[:, 6:9].astype(np.float32).view(np.uint32)
    bits = (CODE[:, None] >> np.arange(3) & 1).astype(np.uint32)
    values[:, 6:9] = ((words & ~np.uint32(1)) | bits).view(np.float32)


def in_flags_at_successive_times(values: np.ndarray) -> None:
    values[:] = values > 0
    values[:, 6:9] = CODE[:, None] >> np.arange(3) & 1


def in_steps(values: np.ndarray) -> None:
    values[:, 1:4] = values[:, :1] + (CODE[:, None] >> np.arange(3) & 1) * 0.5


def in_repetitions(values: np.ndarray) -> None:
    place = np.arange(TIMES)
    values[:] = np.take_along_axis(values, np.minimum(place, 3 + 2 * CODE[:, None]), 1)


@pytest.mark.parametrize(
    ("values", "way"),
    [
        (planted(in_clusters), "the cluster of the value at tick 5"),
        (planted(in_digits), "what is left beside multiples of"),
        (planted(in_bits), "the last 3 bits at tick 3"),
        (planted(in_bits_at_successive_times), "the last bits at 3 times from the one at tick 6"),
        (planted(in_flags_at_successive_times), "the flags at 3 times from the one at tick 6"),
        (planted(in_repetitions), "the number of different values"),
        ((CODE[:, None] >> np.minimum(np.arange(TIMES), 3) & 1).astype(float), "the history at 16 times"),
    ],
)  # fmt: skip
def test_a_code_that_ranks_nothing_is_found(values: np.ndarray, way: str) -> None:
    (how,) = found(readings_of_history(values, NAMES, ACTIONS))
    assert way in how
    assert how.endswith("groups, to the best action")


def test_signs_of_steps_are_a_reading() -> None:
    readings = readings_of_history(planted(in_steps)[:, :4], NAMES[:4], ACTIONS)
    (how,) = codes([(Readings(readings.ways[1:2], readings.cells[1:2]), None)], asked())
    assert "rise, fall and repeat: 5 cells" in how.how


def summed(code: int, letters: str, number_of: Callable[[str], int], start: int) -> str:
    """A text of letters whose sum has a remainder by the number of actions, and that has no other pattern."""
    rng = np.random.default_rng(start)
    while True:
        text = "".join(rng.choice([*letters], 24 + start % 5))
        if sum(map(number_of, text)) % ACTIONS == code:
            return text


@pytest.mark.parametrize(
    ("texts", "way"),
    [
        ([f"g{7 * place * place}-{'pqrst'[code]}" for place, code in enumerate(CODE)], "character from the end 1"),
        ([f"{'pqrst'[code]}{place:03}" for place, code in enumerate(CODE)], "character 1"),
        ([f"g{7 * (10**16 + 999 * n * n) + code}" for n, code in enumerate(CODE)], "the last number in it modulo 7"),
        (["pqrst"[code] for code in CODE], "the value"),
        ([summed(code, "abcdefg", ord, n) for n, code in enumerate(CODE)], "the sum of its characters modulo 7"),
        ([summed(code, "0123456", int, n) for n, code in enumerate(CODE)], "the sum of its digits modulo 7"),
    ],
)  # fmt: skip
def test_a_text_that_names_an_answer_is_found(texts: list[str], way: str) -> None:
    (how,) = found(readings_of_texts(texts, ACTIONS))
    assert how.startswith(way)


def test_two_labels_that_say_it_together_are_found() -> None:
    key = RNG.integers(0, 5, UNITS)
    first, second = [f"type {k}" for k in key], [f"town {(c + k) % 5}" for c, k in zip(CODE, key, strict=True)]
    assert found(readings_of_texts(first, ACTIONS)) == found(readings_of_texts(second, ACTIONS)) == []
    assert found(readings_of_pair(first, second))


def test_an_order_by_answers_is_found() -> None:
    nothing = Readings([], np.zeros((0, UNITS), np.int64))
    (how,) = found(nothing, Order("its order", np.argsort(CODE, kind="stable")))
    assert how == "its order: 60 groups in 5 runs of the best action"
    assert found(nothing, Order("its order", np.arange(UNITS))) == []


# --- what is not


def test_numbers_that_follow_the_answer_from_afar_are_no_code() -> None:
    assert found(readings_of_numbers(ANSWER[:, None] + 2.0 * noise()[:, :1], NAMES[:1], ACTIONS)) == []


@pytest.mark.parametrize(("num_others", "expected"), [(6, 1), (7, 0)])
def test_nine_in_ten_groups_agree(num_others: int, expected: int) -> None:
    values = CODE.astype(float)
    values[:num_others] = (values[:num_others] + 1) % 5
    readings = readings_of_numbers(values[:, None], NAMES[:1], ACTIONS)
    assert len(codes([(Readings(readings.ways[:1], readings.cells[:1]), None)], asked())) == expected


def test_a_code_of_half_of_the_groups_is_none() -> None:
    values = np.where(np.arange(UNITS) < 30, CODE, 100.0 + np.arange(UNITS))
    readings = readings_of_numbers(values[:, None], NAMES[:1], ACTIONS)
    assert codes([(Readings(readings.ways[:1], readings.cells[:1]), None)], asked()) == []


def test_noise_is_no_code() -> None:
    columns = [(readings_of_history(noise(), NAMES, ACTIONS), None) for _ in range(20)]
    columns.append((readings_of_history(RNG.integers(0, 3, (UNITS, TIMES)).astype(float), NAMES, ACTIONS), None))
    assert codes(columns, asked()) == []


def test_what_is_not_there_is_one_value() -> None:
    values = np.where(CODE[:, None] == 2, np.nan, CODE[:, None] * 1.0) * np.ones(TIMES)
    assert found(readings_of_history(values, NAMES, ACTIONS))
    readings = readings_of_numbers(np.full((UNITS, 2), np.inf), NAMES[:2], ACTIONS)
    assert readings.ways == []
    assert readings.cells.shape == (0, UNITS)


# --- answers


def test_answers_are_single_and_of_different_route_clusters() -> None:
    values = np.array([[1, 2, 2], [3, 1, 0], [np.nan, 5, 4], [np.nan] * 3, [0, 0, 7], [0, 1, 1 + 1e-10]])
    answers = best_answers("it", values, [0, 1, 1, 2, 0, 3])
    assert answers.units.tolist() == [1, 4]


def test_rare_answers_are_one() -> None:
    answers = Answers.of("it", np.arange(12), np.array([9, 9, 9, 4, 4, 7, 2, 2, 2, 5, 5, 5]))
    assert answers.answer.tolist() == [3, 3, 3, 0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert answers.is_rich
    assert not Answers.of("it", np.arange(9), np.array([0, 0, 0, 0, 1, 1, 1, 2, 2])).is_rich
    assert not Answers.of("it", np.arange(24), np.repeat([0, 1, 2], [18, 3, 3])).is_rich


def test_few_groups_are_said_to_be_few() -> None:
    few = slice(0, 60, 4)
    cells = Readings(["the value"] * 400, np.broadcast_to(ANSWER[few], (400, 15)))
    with pytest.raises(TooFewError, match="15 route clusters"):
        codes([(cells, None)], asked(ANSWER[few]))
    with pytest.raises(TooFewError, match="60 route clusters"):
        codes([(readings_of_numbers(CODE[:, None] * 1.0, NAMES[:1], ACTIONS), None)], asked(np.arange(UNITS) % 2))
