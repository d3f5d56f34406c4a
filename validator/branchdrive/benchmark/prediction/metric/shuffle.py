"""Shuffles: what a model says when it is given another action, another history, or both.

A shuffle gives place ``a`` of group ``g`` the action of candidate ``c_g(a)`` and the history of group ``h(g)``, where
every ``c_g`` and ``h`` is a uniform derangement: nothing keeps its own. A model is a function of one history
and one action, so its shuffled prediction is the one it made for ``(h(g), c_g(a))``::

    shuffled[g, a] = predicted[h(g), c_g(a)]

Derangements are permutations drawn until none keeps its place. The joint shuffle of a seed combines the two
single ones of that seed.

Source: paper, "Action-Conditioned Outcome and Trajectory Prediction"; derangements and 20 seeds are this project's
choice.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.protocol.protocol import Kind
from branchdrive.statistics.random_words import orders, words

__all__ = ["KINDS", "SEEDS", "Shuffle", "derangements", "shuffles"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

KINDS: tuple[Kind, ...] = get_args(Kind)
SEEDS = tuple(range(20))
"""Seeds of the shuffles that are reported."""


class Shuffle(NamedTuple):
    """One shuffle.

    Attributes:
        seed: What it was drawn with.
        candidate: ``[N, A]``, the candidate whose action each place gets.
        history: ``[N]``, the group whose history each group gets.
    """

    seed: int
    candidate: Index
    history: Index

    def apply(self, predicted: Array) -> Array:
        """What models that predict one (history, action) at a time say after the shuffle ``[models, N, A, ...]``.

        Args:
            predicted: What several models said ``[models, N, A, ...]``.
        """
        return predicted[:, self.history[:, None], self.candidate]


def shuffles(kind: Kind, num_groups: int, num_candidates: int, *, seeds: tuple[int, ...] = SEEDS) -> Iterator[Shuffle]:
    """One shuffle for every seed, for groups in a fixed order, that of their ids.

    Raises:
        ValueError: The kind is unknown, or what is shuffled has fewer than two members.
    """
    if kind not in KINDS:
        raise ValueError(f"`kind` is {kind!r}, none of {', '.join(KINDS)}")
    for seed in seeds:
        candidate = np.broadcast_to(np.arange(num_candidates), (num_groups, num_candidates))
        history = np.arange(num_groups)
        if kind != "history":
            candidate = derangements(num_groups, num_candidates, seed=seed, name="metric/shuffle/action")
        if kind != "action":
            history = derangements(1, num_groups, seed=seed, name="metric/shuffle/history")[0]
        yield Shuffle(seed, candidate, history)


def derangements(num_rows: int, num_places: int, *, seed: int, name: str) -> Index:
    """Uniform independent permutations ``[num_rows, num_places]`` that keep nothing in its place.

    Raises:
        ValueError: There are fewer than two places.
    """
    if num_places < 2:
        raise ValueError(f"{num_places} cannot be shuffled so that nothing keeps its place; two are the least")
    found = np.empty((num_rows, num_places), np.int64)
    pending = np.arange(num_rows)
    drawn = 0
    while len(pending):
        # All rows are drawn in every round, so that a row depends on its own earlier draws alone.
        tried = orders(words(seed, name, num_rows, num_places, first_row=drawn))[pending]
        drawn += num_rows
        kept = (tried == np.arange(num_places)).any(axis=1)
        found[pending[~kept]] = tried[~kept]
        pending = pending[kept]
    return found
