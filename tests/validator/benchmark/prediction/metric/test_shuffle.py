"""Shuffles: derangements, fixed by their seed, and what they do to predictions."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare
from tests.validator.statistics.samples import outcomes, predictions

from branchdrive.benchmark.prediction.metric.outcome import Predictions
from branchdrive.benchmark.prediction.metric.shuffle import SEEDS, derangements, shuffles


@given(st.integers(1, 9), st.integers(2, 14), st.integers(0, 50))
def test_nothing_keeps_its_place(num_rows: int, num_places: int, seed: int) -> None:
    found = derangements(num_rows, num_places, seed=seed, name="a")
    assert (np.sort(found, axis=1) == np.arange(num_places)).all()
    assert (found != np.arange(num_places)).all()


def test_derangements_are_uniform_and_rows_independent() -> None:
    found = derangements(8_000, 4, seed=0, name="a")
    wanted = [order for order in permutations(range(4)) if all(place != i for i, place in enumerate(order))]
    code = np.array([wanted.index(tuple(row)) for row in found.tolist()])
    assert len(wanted) == 9
    assert chisquare(np.bincount(code, minlength=9)).pvalue > 0.001
    assert chisquare(np.bincount(code[::2] * 9 + code[1::2], minlength=81)).pvalue > 0.001


@pytest.mark.parametrize(("kind", "action", "history"), [("action", 1, 0), ("history", 0, 1), ("joint", 1, 1)])
def test_a_shuffle_moves_what_it_names(kind: str, action: bool, history: bool) -> None:
    found = list(shuffles(kind, 6, 13))  # type: ignore[arg-type]
    assert [shuffle.seed for shuffle in found] == list(SEEDS) == list(range(20))
    for shuffle in found:
        assert shuffle.candidate.shape == (6, 13)
        assert ((shuffle.candidate != np.arange(13)).all(), (shuffle.candidate == np.arange(13)).all()) == (
            bool(action),
            not action,
        )
        assert ((shuffle.history != np.arange(6)).all(), (shuffle.history == np.arange(6)).all()) == (
            bool(history),
            not history,
        )


def test_the_joint_shuffle_combines_the_single_ones() -> None:
    for action, history, joint in zip(*(shuffles(kind, 5, 4) for kind in ("action", "history", "joint")), strict=True):
        np.testing.assert_array_equal(joint.candidate, action.candidate)
        np.testing.assert_array_equal(joint.history, history.history)


def test_seeds_shuffle_differently() -> None:
    assert len({shuffle.candidate.tobytes() for shuffle in shuffles("action", 6, 13)}) == 20


def test_a_shuffled_prediction_is_the_one_for_the_shuffled_inputs() -> None:
    rng = np.random.default_rng(0)
    histories, actions = rng.normal(size=(5, 3)), rng.normal(size=(4, 3))

    def model(history: np.ndarray, action: np.ndarray) -> Predictions:
        product = (history * action).sum(axis=-1)
        return Predictions.of(
            np.repeat(product[..., None], 6, axis=-1), np.broadcast_to(product[..., None, None], (5, 4, 10, 5))
        )

    whole = model(histories[:, None], actions[None])
    for shuffle in shuffles("joint", 5, 4):
        expected = model(histories[shuffle.history][:, None], actions[shuffle.candidate])
        np.testing.assert_array_equal(shuffle.apply(whole.scalars[None])[0], expected.scalars)
        np.testing.assert_array_equal(shuffle.apply(whole.paths[None])[0], expected.paths)


def test_a_model_without_actions_does_not_see_an_action_shuffle() -> None:
    truth = outcomes(4)
    predicted = predictions(truth)
    blind = Predictions.of(np.broadcast_to(predicted.scalars[:, :1], truth.scalars.shape), predicted.paths)
    for shuffle in shuffles("action", 4, 5):
        np.testing.assert_array_equal(shuffle.apply(blind.scalars[None])[0], blind.scalars)


def test_what_cannot_be_shuffled_is_refused() -> None:
    with pytest.raises(ValueError, match="two are the least"):
        list(shuffles("history", 1, 13))
    with pytest.raises(ValueError, match="`kind` is 'both'"):
        list(shuffles("both", 3, 13))  # type: ignore[arg-type]
