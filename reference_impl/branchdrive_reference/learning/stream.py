"""Streams of randomness: a number is a function of seed, stream and place, and of no draw before it.

Neither weights nor the order of batches depend on the state of a generator, so that a run that goes on after an
interruption has none to restore.

Source: this project's choice; Philox is Salmon et al., SC 2011.
"""

from __future__ import annotations

import numpy as np

from branchdrive.errors import UsageError

__all__ = ["BATCHES", "WEIGHTS", "stream"]

WEIGHTS, BATCHES = range(2)
"""Streams under one seed."""

_SEEDS = 2**64


def stream(seed: int, name: int, place: int = 0) -> np.random.Generator:
    """Generator at the start of a place of a stream; places do not overlap.

    Raises:
        UsageError: `seed` is negative or needs more than 64 bits.
    """
    if not 0 <= seed < _SEEDS:
        raise UsageError(f"the seed is {seed!r}, not in 0 .. 2**64 - 1")
    counter = np.array([0, 0, 0, place], np.uint64)
    return np.random.Generator(np.random.Philox(key=np.array([seed, name], np.uint64), counter=counter))
