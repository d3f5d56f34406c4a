"""Calibration: the place that is taken, refusals, order, and the guarantees by simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import binom

from branchdrive.benchmark.guard.calibration import (
    ALPHA,
    DELTA,
    MIN_CLUSTERS,
    MIN_GROUPS,
    Calibration,
    conformal,
    learn_then_test,
)

Mask = NDArray[np.bool_]


def stairs(*first: int, num_multipliers: int = 6) -> Mask:
    """Groups that violate from a place of the path on."""
    return np.arange(num_multipliers)[:, None] >= np.array(first)


def alone(num_groups: int) -> list[str]:
    return [f"route-{place}" for place in range(num_groups)]


def test_the_protocol() -> None:
    assert (ALPHA, DELTA, MIN_GROUPS, MIN_CLUSTERS) == (0.05, 0.1, 88, 48)


def test_eighty_eight_groups_permit_three_violations() -> None:
    losses = stairs(1, 2, 3, 4, *[9] * 84)
    found = conformal(losses, alone(88))
    assert (found.method, found.place, found.refusal) == ("conformal", 3, None)
    assert found.curve == pytest.approx(np.array([1, 2, 3, 4, 5, 5]) / 89)


def test_the_limit_itself_is_kept() -> None:
    # With 99 clusters four violations make the bound exactly 5 / 100.
    assert conformal(stairs(1, 1, 1, 1, *[9] * 95), alone(99)).place == 5
    assert conformal(stairs(1, 1, 1, 1, 2, *[9] * 94), alone(99)).place == 1


def test_a_selection_that_recovers_stays_a_violation() -> None:
    losses = stairs(*[9] * 88)
    losses[2, :5] = True
    assert conformal(losses, alone(88)).place == 1


def test_clusters_count_by_their_means() -> None:
    # One cluster of 40 groups that all violate counts one of 49, far from 40 of 88.
    clusters = ["long"] * 40 + alone(48)
    losses = stairs(*[1] * 40, *[9] * 48)
    found = conformal(losses, clusters)
    assert (found.num_groups, found.num_clusters) == (88, 49)
    assert found.place == 5
    assert found.curve[1:] == pytest.approx(np.full(5, 2 / 50))


def test_means_are_exact_at_the_limit() -> None:
    # Thirds of a cluster add up to whole violations without a rounding that decides.
    clusters = [f"{place // 3}" for place in range(297)]
    losses = stairs(*[1, 9, 9] * 12, *[9] * 261)
    assert conformal(losses, clusters).curve[1] == 0.05
    assert conformal(losses, clusters).place == 5


@pytest.mark.parametrize(("num_groups", "num_clusters"), [(87, 87), (88, 47), (300, 47)])
def test_too_few_are_not_judged(num_groups: int, num_clusters: int) -> None:
    clusters = [f"{place % num_clusters}" for place in range(num_groups)]
    losses = stairs(*[9] * num_groups)
    wanted = f"{num_groups} calibration groups of {num_clusters} clusters, expected at least 88 groups of 48 clusters"
    for found in (conformal(losses, clusters), learn_then_test(losses, clusters, alone(num_groups), seed=1)):
        assert (found.place, found.refusal) == (0, wanted)


def test_enough_are_judged() -> None:
    clusters = [f"{place % 48}" for place in range(88)]
    losses = stairs(*[9] * 88)
    for found in (conformal(losses, clusters), learn_then_test(losses, clusters, alone(88), seed=1)):
        assert (found.place, found.refusal) == (5, None)


def test_a_bound_that_no_sample_of_this_size_can_show_is_refused() -> None:
    losses = stairs(*[9] * 88)
    assert "cannot bound a rate of 0.01" in str(conformal(losses, alone(88), alpha=0.01).refusal)
    found = learn_then_test(losses[:, :44], alone(44), alone(44), seed=1, min_groups=1, min_clusters=1)
    assert "44 clusters cannot show a rate of 0.05" in str(found.refusal)
    assert found.place == 0


def test_learn_then_test_stops_at_the_first_multiplier_it_cannot_show() -> None:
    losses = stairs(*[9] * 88)
    losses[3, :2] = True
    found = learn_then_test(losses, alone(88), alone(88), seed=1)
    assert found.curve == pytest.approx(binom.cdf([0, 0, 0, 2, 0, 0], 88, 0.05))
    assert binom.cdf(1, 88, 0.05) < DELTA < binom.cdf(2, 88, 0.05)
    assert found.place == 2


def test_learn_then_test_draws_one_group_of_every_cluster() -> None:
    clusters = [f"{place // 3}" for place in range(180)]
    losses = np.concatenate([np.zeros((1, 180), bool), np.eye(180, dtype=bool)])
    found = learn_then_test(losses, clusters, alone(180), seed=3, min_clusters=60)
    drawn = np.flatnonzero(found.curve[1:] > binom.cdf(0, 60, 0.05) + 1e-9)
    assert (drawn // 3).tolist() == list(range(60))
    assert len(set((drawn % 3).tolist())) == 3
    other = learn_then_test(losses, clusters, alone(180), seed=4, min_clusters=60)
    assert other.curve.tolist() != found.curve.tolist()


@settings(max_examples=25)
@given(st.randoms(use_true_random=False), st.integers(0, 5))
def test_the_order_of_groups_does_not_matter(random: object, seed: int) -> None:
    rng = np.random.default_rng(seed)
    losses = stairs(*rng.integers(1, 40, 120), num_multipliers=30)
    clusters, groups = [f"{place}" for place in rng.integers(0, 70, 120)], alone(120)
    order = list(range(120))
    random.shuffle(order)  # type: ignore[attr-defined]
    moved = [clusters[place] for place in order]

    def seen(found: Calibration) -> tuple[object, ...]:
        return (found.place, found.curve.tolist(), found.refusal)

    assert seen(conformal(losses[:, order], moved)) == seen(conformal(losses, clusters))
    there = learn_then_test(losses[:, order], moved, [groups[place] for place in order], seed=seed)
    assert seen(there) == seen(learn_then_test(losses, clusters, groups, seed=seed))


def population(rng: np.random.Generator, num_clusters: int) -> tuple[Mask, NDArray[np.intp]]:
    """Losses that come and go along the path, alike within clusters of one to four groups."""
    sizes = rng.integers(1, 5, num_clusters)
    cluster = np.repeat(np.arange(num_clusters), sizes)
    shared, own = rng.random(num_clusters)[cluster], rng.random(len(cluster))
    start = (np.minimum(shared, 0.6 * own + 0.4 * shared) * 60 + 1).astype(int)
    place = np.arange(40)[:, None]
    losses = (place >= start) & (rng.random((40, len(cluster))) < 0.8)
    return losses, cluster


def test_the_conformal_guarantee_holds_on_average() -> None:
    rng = np.random.default_rng(11)
    losses, cluster = population(rng, 1200)
    mean_loss = np.stack([losses[:, cluster == place].mean(axis=1) for place in range(1200)], axis=1)
    rates = []
    for _ in range(400):
        drawn = rng.permutation(1200)
        inside = np.isin(cluster, drawn[:60])
        found = conformal(losses[:, inside], [str(place) for place in cluster[inside]])
        rates.append(mean_loss[found.place, drawn[60:]].mean())
    error = np.std(rates) / np.sqrt(len(rates))
    assert np.mean(rates) <= ALPHA + 3 * error
    assert np.mean(rates) > 0.01


def test_the_conformal_guarantee_is_tight_where_losses_only_rise() -> None:
    # Thresholds uniform over a fine path: the risk lies between alpha - 2 / (n + 1) and alpha.
    rng = np.random.default_rng(12)
    names = alone(99)
    rates = []
    for _ in range(300):
        losses = np.arange(400)[:, None] >= rng.integers(1, 400, 99)
        rates.append(conformal(losses, names).place / 399)
    error = np.std(rates) / np.sqrt(len(rates))
    assert ALPHA - 2 / 100 - 3 * error <= np.mean(rates) <= ALPHA + 3 * error


def test_learn_then_test_fails_no_more_often_than_it_says() -> None:
    rng = np.random.default_rng(13)
    names = alone(88)
    rates = []
    for _ in range(400):
        losses = np.arange(200)[:, None] >= rng.integers(1, 200, 88)
        rates.append(learn_then_test(losses, names, names, seed=1).place / 199)
    failures = np.mean(np.array(rates) > ALPHA)
    assert failures <= DELTA + 3 * np.sqrt(DELTA * (1 - DELTA) / 400)
    assert np.mean(rates) > 0.005


@pytest.mark.parametrize("seed", [-1, 1 << 64])
def test_a_seed_fits_the_key(seed: int) -> None:
    with pytest.raises(ValueError, match="`seed` is"):
        learn_then_test(stairs(9), ["a"], ["x"], seed=seed)


def test_broken_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="do not match 2 groups"):
        conformal(stairs(9), ["a", "b"])
    with pytest.raises(ValueError, match="must start at nominal"):
        conformal(stairs(0), ["a"])
    with pytest.raises(ValueError, match="not between 0 and 1"):
        conformal(stairs(9), ["a"], alpha=1.0)
    with pytest.raises(ValueError, match="do not name each of 2 once"):
        learn_then_test(stairs(9, 9), ["a", "b"], ["x", "x"], seed=1)
