"""Numbers of a stream depend on seed, stream and place, and on nothing else."""

from __future__ import annotations

import pytest

from branchdrive import UsageError
from branchdrive_reference.learning.stream import BATCHES, WEIGHTS, stream


def test_one_place_has_one_sequence() -> None:
    places = [(11, WEIGHTS, 0), (11, BATCHES, 0), (11, BATCHES, 1), (23, BATCHES, 0)]
    drawn = [stream(*place).random(4).tolist() for place in places]
    assert drawn == [stream(*place).random(4).tolist() for place in places]
    assert len({value for values in drawn for value in values}) == 16


def test_places_do_not_overlap() -> None:
    first = stream(5, BATCHES, 1).bit_generator.random_raw(4000).tolist()
    second = stream(5, BATCHES, 2).bit_generator.random_raw(4000).tolist()
    assert not set(first) & set(second)


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_other_numbers_are_no_seeds(seed: int) -> None:
    with pytest.raises(UsageError, match="the seed is "):
        stream(seed, WEIGHTS)
