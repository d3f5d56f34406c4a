"""Places of a history that no value of one moment shows: codes in them are found, and clean populations not accused."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstest
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.gate import Gate, leakage_gate
from branchdrive.leakage.outcome import outcome_codes, revealed_outcomes
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.leakage.streams import StreamColumn, Streams, num_different, ranked
from branchdrive.raw.media.image_numbers import NAMES, image_numbers

QUICK = GateProtocol(alpha=0.03, num_permutations=199, num_frequencies=8, offsets_sd=(), sparse_offsets_sd=())
NUM_GROUPS, NUM_ACTIONS, NUM_TIMES = 46, 6, 16
CODE = np.arange(NUM_ACTIONS)

Array = NDArray[np.float64]


def histories(seed: int) -> Array:
    """A recorded column of replays ``[groups, actions, times]``, of which one value in eight repeats the last one."""
    rng = np.random.default_rng(seed)
    values = exchangeable(NUM_GROUPS, NUM_ACTIONS, NUM_TIMES, seed=seed)
    for time in range(1, NUM_TIMES):
        is_held = rng.random((NUM_GROUPS, NUM_ACTIONS)) < 1 / 8
        values[..., time] = np.where(is_held, values[..., time - 1], values[..., time])
    return values


def images(seed: int) -> NDArray[np.uint8]:
    """Images of one moment ``[groups, actions, 24, 32]``: a scene of each group, and noise of the camera."""
    rng = np.random.default_rng(seed)
    scenes = rng.integers(40, 200, (NUM_GROUPS, 1, 24, 32))
    return np.asarray(scenes + rng.integers(-8, 9, (NUM_GROUPS, NUM_ACTIONS, 24, 32)), np.uint8)


def judged(columns: Array, seed: int = 0) -> Gate:
    """The gate on columns ``[groups, actions, columns]`` of streams, beside features in which nothing leaks."""
    names = tuple(StreamColumn("observations", f"column {number}", 0) for number in range(columns.shape[2]))
    x = exchangeable(NUM_GROUPS, NUM_ACTIONS, 3, seed=1000 + seed)
    return leakage_gate(x, seed=seed, protocol=QUICK, streams=Streams(names, *ranked(columns)))


def of_values(values: Array) -> Array:
    """What is read of a column: its values, and how many different ones there are."""
    return np.concatenate([values, num_different(values)[..., None]], axis=2)


def of_images(pixels: NDArray[np.uint8]) -> Array:
    """What is read of the pixels of images."""
    numbers = np.array([[image_numbers(image) for image in group] for group in pixels], np.float64)
    return numbers.reshape(NUM_GROUPS, NUM_ACTIONS, len(NAMES))


def values_that_repeat(seed: int) -> Array:
    values = histories(seed)
    for action in CODE:
        values[:, action, 5 : 6 + action] = values[:, action, 5:6]
    return of_values(values)


def values_that_repeat_one_of_long_before(seed: int) -> Array:
    values = histories(seed)
    for action in CODE:
        values[:, action, 15 - action :] = values[:, action, : 1 + action]
    return of_values(values)


def a_pixel_that_moves_within_its_cell(seed: int, axis: int) -> Array:
    pixels = images(seed)
    for action in CODE:
        row, column = (12 + action, 10) if axis == 0 else (14, 8 + action)
        pixels[:, action, row, column] = 255
    return of_images(pixels)


def a_size(seed: int) -> Array:
    return (
        3_000 + np.random.default_rng(seed).integers(0, 9, (NUM_GROUPS, NUM_ACTIONS, NUM_TIMES)) + 2.0 * CODE[:, None]
    )


@pytest.mark.parametrize(
    "planted",
    [
        values_that_repeat,
        values_that_repeat_one_of_long_before,
        partial(a_pixel_that_moves_within_its_cell, axis=0),
        partial(a_pixel_that_moves_within_its_cell, axis=1),
        a_size,
    ],
    ids=["repeats", "repeats of long before", "pixel down", "pixel right", "size"],
)
def test_a_code_of_the_action_is_found(planted: Callable[[int], Array]) -> None:
    gate = judged(planted(3))
    assert {test.name for test in gate.tests if test.p_adjusted <= QUICK.alpha} == {"concordance"}


def clean_p_values(num_populations: int) -> Array:
    """p of the concordance of clean populations ``[populations]``."""
    found = []
    for seed in range(num_populations):
        gate = judged(np.concatenate([of_values(histories(seed)), of_images(images(seed))], axis=2), seed)
        assert gate.verdict in ("pass", "fail")
        found.append(gate.tests[STATISTICS.index("concordance")].p)
    return np.array(found)


def test_clean_populations_are_not_accused() -> None:
    assert clean_p_values(10).min() > QUICK.alpha / len(STATISTICS)


@pytest.mark.thorough
def test_p_of_clean_populations_is_no_smaller_than_uniform() -> None:
    assert kstest(clean_p_values(200), "uniform", alternative="greater").pvalue > 0.01


def released(seed: int, num_groups: int) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Variables, counts, targets and availability; some variables and the targets share a cause."""
    rng = np.random.default_rng(seed)
    cause = rng.normal(size=(num_groups, 1, 1))
    targets = np.round(cause + rng.normal(size=(num_groups, 13, 3)), 2)
    moving = cause[:, 0] + 0.3 * rng.normal(size=(num_groups, 20))
    counts = rng.integers(1, 17, (num_groups, 40)).astype(float)
    flags = rng.integers(0, 3, (num_groups, 40)).astype(float)
    return np.concatenate([moving, flags], axis=1), counts, targets, rng.random(targets.shape) < 0.9


@pytest.mark.parametrize(
    "num_populations", [pytest.param(2, id="few"), pytest.param(50, marks=pytest.mark.thorough, id="many")]
)
@pytest.mark.parametrize("num_groups", [15, 100])
def test_outcomes_of_clean_populations_are_told_by_nothing(num_groups: int, num_populations: int) -> None:
    for seed in range(num_populations):
        variables, counts, targets, available = released(seed, num_groups)
        columns = [f"column {number}" for number in range(variables.shape[1])]
        categories = [f"kind {number}" for number in variables[:, -1].tolist()]
        assert revealed_outcomes(variables, columns, targets, available) == []
        assert revealed_outcomes(counts, columns, targets, available, max_correlation=0.98) == []
        assert outcome_codes(categories, targets, available) == []
