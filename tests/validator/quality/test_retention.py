"""Retention: shares as ratios of sums, intervals against the binomial law and a plain bootstrap."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom
from tests.validator.statistics import random_words

from branchdrive.quality.retention import NUM_RESAMPLES, TARGET_SHARES, Retention, retention


def banks(*failing: int, num_pairs: int = 12) -> Any:
    """Groups with the given numbers of pairs that fail."""
    return np.arange(num_pairs) >= np.array(failing)[:, None]


def counts_of(passed: Any, counted: Any = True) -> Any:
    """Pairs of groups that pass and count, and that count."""
    counts = np.broadcast_to(counted, passed.shape)
    return np.stack([(passed & counts).sum(axis=1), counts.sum(axis=1)], axis=1)


def of_train(passed: Any, seed: int = 1, counted: Any = True) -> tuple[Retention, ...]:
    return retention(counts_of(passed, counted), ["train"] * len(passed), partitions=["train"], seed=seed)


def test_the_protocol() -> None:
    assert NUM_RESAMPLES == 2000
    assert dict(TARGET_SHARES) == {"pair": 0.98, "bank": 0.90}


def test_pairs_and_banks_are_counted_apart() -> None:
    pair, bank = of_train(banks(0, 0, 3, 12))
    assert (pair.unit, pair.num_passed, pair.num_units, pair.share) == ("pair", 33, 48, 33 / 48)
    assert (bank.unit, bank.num_passed, bank.num_units, bank.share) == ("bank", 2, 4, 0.5)
    assert pair.num_groups == bank.num_groups == 4


def test_where_all_pass_the_interval_is_a_point() -> None:
    for found in of_train(banks(*[0] * 9)):
        assert (found.share, found.low, found.high, found.met) == (1, 1, 1, True)


@pytest.mark.parametrize(("num_failing", "met"), [(9, True), (10, True), (11, False)])
def test_a_target_is_met_at_its_value(num_failing: int, met: bool) -> None:
    _, bank = of_train(banks(*[1] * num_failing, *[0] * (100 - num_failing)))
    assert bank.met is met


def test_pairs_meet_their_target_at_its_value() -> None:
    passed = np.ones((50, 12), bool)
    passed.flat[:12] = False
    assert of_train(passed)[0].met is True
    passed.flat[12] = False
    assert of_train(passed)[0].met is False


def test_a_partition_without_groups_is_no_pass() -> None:
    pair, bank = retention(counts_of(banks(0)), ["train"], partitions=["val"], seed=0)
    for found in (pair, bank):
        assert (found.num_units, found.share, found.low, found.high, found.met) == (0, None, None, None, None)


def test_partitions_are_reported_in_the_order_that_was_asked_for() -> None:
    found = retention(counts_of(banks(0, 1, 2)), ["val", "train", "spare"], partitions=["train", "val", "test"], seed=0)
    assert [row.unit for row in found] == ["pair", "bank"] * 3
    places = [(row.partition, row.num_groups) for row in found]
    assert places[0::2] == places[1::2] == [("train", 1), ("val", 1), ("test", 0)]


@given(st.lists(st.integers(0, 12), min_size=1, max_size=40), st.integers(0, 2**64 - 1))
def test_neither_order_nor_other_partitions_change_anything(failing: list[int], seed: int) -> None:
    expected = of_train(banks(*failing), seed)
    shuffled = random.Random(seed).sample(failing, len(failing))
    mixed = retention(
        counts_of(banks(*shuffled, 5, 6)),
        ["train"] * len(failing) + ["val"] * 2,
        partitions=["val", "train"],
        seed=seed,
    )
    assert mixed[2:] == expected
    assert of_train(banks(*failing), seed) == expected


def test_seed_and_partition_choose_the_resamples() -> None:
    passed = banks(*range(13), *range(0, 13, 2), *range(0, 13, 3))
    intervals = {of_train(passed, seed)[0].low for seed in range(5)}
    assert len(intervals) > 1
    homes = ["a"] * len(passed) + ["b"] * len(passed)
    a, _, b, _ = retention(counts_of(np.concatenate([passed, passed])), homes, partitions=["a", "b"], seed=1)
    assert (a.share, a.num_units) == (b.share, b.num_units)
    assert (a.low, a.high) != (b.low, b.high)


@pytest.mark.parametrize(("num_groups", "num_failing"), [(87, 6), (431, 21), (95, 50)])
def test_the_interval_of_banks_is_that_of_the_binomial_law(num_groups: int, num_failing: int) -> None:
    _, bank = of_train(banks(*[2] * num_failing, *[0] * (num_groups - num_failing)))
    expected = binom.ppf([0.025, 0.975], num_groups, 1 - num_failing / num_groups) / num_groups
    np.testing.assert_allclose([bank.low, bank.high], expected, atol=1.01 / num_groups)


def test_the_interval_of_pairs_is_that_of_a_plain_bootstrap() -> None:
    rng = random.Random(3)
    failing = [rng.choice([0, 0, 0, 0, 1, 4, 12]) for _ in range(60)]
    counted = [rng.randrange(6, 13) for _ in range(60)]
    mask = np.arange(12) >= 12 - np.array(counted)[:, None]
    passed = banks(*failing)
    rows = [(int((p & m).sum()), int(m.sum())) for p, m in zip(passed, mask, strict=True)]
    shares = []
    for _ in range(2000):
        drawn = rng.choices(rows, k=60)
        shares.append(sum(p for p, _ in drawn) / sum(n for _, n in drawn))
    pair, _ = of_train(passed, counted=mask)
    assert pair.share == sum(p for p, _ in rows) / sum(n for _, n in rows)
    np.testing.assert_allclose([pair.low, pair.high], np.quantile(shares, [0.025, 0.975]), atol=0.01)
    assert pair.low is not None
    assert pair.high is not None
    assert pair.low < pair.share < pair.high


def test_pairs_that_do_not_count_cannot_fail_a_bank() -> None:
    counted = np.ones((2, 12), bool)
    counted[0, :3] = False
    pair, bank = of_train(banks(3, 3), counted=counted)
    assert (pair.num_passed, pair.num_units) == (18, 21)
    assert (bank.num_passed, bank.num_units) == (1, 2)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "partitions": ({"partition_of": ["train"]}, "1 partitions do not match"),
    "counts": ({"counts": np.ones((2, 3), int)}, r"`counts` \[2, 3\]"),
    "nothing counted": ({"counts": [[12, 12], [0, 0]]}, "a group counts no pair"),
    "seed too large": ({"seed": 2**64}, "`seed` is 18446744073709551616"),
    "seed negative": ({"seed": -1}, "`seed` is -1"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_refused(case: str) -> None:
    change, message = WRONG[case]
    arguments: dict[str, Any] = {"counts": counts_of(banks(0, 1)), "partition_of": ["train"] * 2, **change}
    with pytest.raises(ValueError, match=message):
        retention(**{"partitions": ["train"], "seed": 0, **arguments})


def test_an_interval_follows_from_words_in_whole_numbers() -> None:
    failing, size = [0, 3, 1, 0, 12, 0, 2], 7
    passed = sorted(12 - number for number in failing)
    ratios = []
    for b in range(NUM_RESAMPLES):
        drawn = random_words.row(9, "fidelity/retention/train", b, size)
        ratios.append(sum(passed[random_words.below(word, size)] for word in drawn) / (12 * size))
    ratios.sort()
    ends = [(h := 1999 * q, j := int(h)) and ratios[j] + (h - j) * (ratios[j + 1] - ratios[j]) for q in (0.025, 0.975)]
    pair, _ = of_train(banks(*failing), 9)
    assert (pair.low, pair.high) == pytest.approx(tuple(ends), rel=1e-14)
