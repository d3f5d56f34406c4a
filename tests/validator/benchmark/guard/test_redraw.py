"""Redraws: each is the guard as it is calibrated on that draw, judged on the other clusters; the mean is bounded."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.each import each
from tests.validator.benchmark.guard.test_assessment import CALIBRATION, FIT, SCALE, VALIDATION, partition

from branchdrive.benchmark.guard.assessment import Assessment, assess
from branchdrive.benchmark.guard.calibration import conformal
from branchdrive.benchmark.guard.data import GuardPartitions, Limits, Setting
from branchdrive.benchmark.guard.path import fit_margin, worst_overprediction
from branchdrive.benchmark.guard.redraw import (
    Executed,
    Pool,
    conformal_places,
    judged,
    learn_then_test_places,
    margin_places,
    pool_of,
)
from branchdrive.driving.utility import PROFILES
from branchdrive.statistics.binomial import binomial_cdf
from branchdrive.statistics.random_words import orders, words

SIZES = (1, 2, 1, 3, 1, 1, 2, 5)


def members(name: str, num_clusters: int) -> tuple[tuple[str, str], ...]:
    """Groups in clusters of the sizes in turn."""
    return tuple(
        (f"{name}-{cluster:03}-{group}", f"{name}-{cluster:03}")
        for cluster in range(num_clusters)
        for group in range(SIZES[cluster % len(SIZES)])
    )


CALIBRATING, OTHERS = members("calibration", 40), members("test", 30)
GROUPS = [group for group, _ in (*CALIBRATING, *OTHERS)]
CLUSTERS = np.array([cluster for _, cluster in (*CALIBRATING, *OTHERS)])


@cache
def pool(num_redraws: int = 20) -> Pool:
    return pool_of(CALIBRATING, OTHERS, seed=3, num_redraws=num_redraws)


@cache
def losses(num_multipliers: int = 15) -> NDArray[np.bool_]:
    """Violations that need not rise along a path, alike in a cluster."""
    rng = np.random.default_rng(0)
    of_cluster = rng.random(70)[pool().place_of]
    rates = np.linspace(0, 0.3, num_multipliers)[:, None]
    return np.asarray((of_cluster + 0.1 * rng.random((num_multipliers, len(GROUPS))) - 0.05) < rates)


def test_a_redraw_is_an_order_of_the_clusters_whose_first_calibrate() -> None:
    drawn = pool().drawn
    order = orders(words(3, "guard/redraws", 20, 70))
    assert [set(np.flatnonzero(row).tolist()) for row in drawn] == [set(row[:40].tolist()) for row in order]
    names = [*sorted({cluster for _, cluster in CALIBRATING}), *sorted({cluster for _, cluster in OTHERS})]
    assert [names[place] for place in pool().place_of] == CLUSTERS.tolist()


def test_conformal_choices_are_those_of_the_draws() -> None:
    found = conformal_places(losses(), pool(), alpha=0.1)
    for drawn, place in zip(pool().drawn, found.tolist(), strict=True):
        mine = drawn[pool().place_of]
        path = losses()[:, mine].copy()
        path[0] = False
        assert place == conformal(path, CLUSTERS[mine].tolist(), alpha=0.1, min_groups=1, min_clusters=1).place
    assert len(set(found.tolist())) > 1


def test_learn_then_test_takes_one_group_of_each_calibrating_cluster() -> None:
    found = learn_then_test_places(losses(), pool(), alpha=0.1, delta=0.3)
    word = words(3, "guard/redraws/groups", 20, len(GROUPS))
    rank = {group: place for place, group in enumerate(sorted(GROUPS))}
    for row, (drawn, place) in enumerate(zip(pool().drawn, found.tolist(), strict=True)):
        least: dict[int, tuple[int, int]] = {}
        for column, group in enumerate(GROUPS):
            cluster = int(pool().place_of[column])
            if drawn[cluster]:
                mine = (int(word[row, rank[group]]), column)
                least[cluster] = min(least.get(cluster, mine), mine)
        taken = [column for _, column in least.values()]
        failing = [m for m in range(1, 15) if binomial_cdf(int(losses()[m, taken].sum()), 40, 0.1) > 0.3]
        assert place == (failing[0] - 1 if failing else 14)
        assert np.flatnonzero(pool().single[row]).tolist() == sorted(taken)


def test_margins_are_those_that_the_draws_fit() -> None:
    rng = np.random.default_rng(1)
    predicted, recorded = rng.normal(size=(2, len(GROUPS), 4))
    margins, places = margin_places(worst_overprediction(predicted, recorded, nominal=0), pool())
    for drawn, place in zip(pool().drawn, places.tolist(), strict=True):
        mine = drawn[pool().place_of]
        assert margins[place] == fit_margin(predicted[mine], recorded[mine], nominal=0).margin_m


def test_a_draw_is_judged_on_the_other_clusters_alone() -> None:
    rng = np.random.default_rng(2)
    utilities, separation = rng.random((2, len(GROUPS), 3))
    executed = Executed(utilities, separation, 0, 0.25, 0.1)
    selections = rng.integers(0, 3, (4, len(GROUPS)))
    selections[0] = 0
    places = rng.integers(0, 4, 20)
    found = judged(selections, selections[3], executed, pool(), places)
    rows, rates, tops, bottoms = np.arange(len(GROUPS)), [], [], []
    for drawn, place in zip(pool().drawn, places.tolist(), strict=True):
        chosen, others = selections[place], ~drawn[pool().place_of]
        lost = (chosen != 0) & (separation[rows, chosen] < separation[:, 0] - 0.25)
        rates.append(np.mean([lost[name == CLUSTERS].mean() for name in sorted(set(CLUSTERS[others]))]))
        tops.append((utilities[rows, chosen] - utilities[:, 0])[others].sum())
        bottoms.append((utilities[rows, selections[3]] - utilities[:, 0])[others].sum())
    assert (found.num_clusters, found.num_others) == (40, 30)
    assert found.mean == pytest.approx(np.mean(rates))
    assert found.error == pytest.approx(np.std(rates) / 20**0.5)
    assert [found.low, found.high] == pytest.approx(np.quantile(rates, [0.025, 0.975]).tolist())
    assert found.share_above == np.mean(np.array(rates) > 0.1)
    assert found.num_nominal == (places == 0).sum()
    defined = np.array(bottoms) > 1e-6 * len(GROUPS)
    assert found.num_undefined == (~defined).sum()
    if sum(bottoms) > 0:
        assert found.retained_gain == pytest.approx(sum(tops) / sum(bottoms))


@each("seed", range(5))
def test_the_mean_over_all_draws_keeps_the_promise_whatever_the_pool(seed: int) -> None:
    """By construction: no assumption on the pool, clusters of the two partitions as different as can be."""
    rng = np.random.default_rng(seed)
    many = pool(1000)
    rate = np.where(np.arange(70) < 40, 0.0, 0.4) if seed == 0 else rng.random(70) ** 3
    path = np.zeros((30, len(GROUPS)), np.bool_)
    level = rng.random(70)[many.place_of]
    path[1:] = level < rate[many.place_of] * np.linspace(0, 1, 29)[:, None]
    places = conformal_places(path, many, alpha=0.1)
    sizes = np.bincount(many.place_of)
    shares = np.stack([np.bincount(many.place_of, row) / sizes for row in path.astype(float)])
    rates = [shares[place][~drawn].mean() for drawn, place in zip(many.drawn, places.tolist(), strict=True)]
    assert np.mean(rates) <= 0.1 + 3 * np.std(rates) / len(rates) ** 0.5


@cache
def assessed(min_groups: int = 88) -> Assessment:
    setting = Setting(
        "balanced",
        PROFILES["balanced"],
        SCALE,
        nominal=0,
        action_prior=3,
        seed=1,
        num_resamples=100,
        num_redraws=200,
        limits=Limits(min_groups=min_groups),
    )
    return assess(FIT, GuardPartitions(VALIDATION, CALIBRATION, partition(60, 33, 2)), setting)


def test_an_assessment_has_redraws_of_every_guard() -> None:
    found = assessed().redraws
    assert found is not None
    assert [found[name].num_clusters for name in ("global_margin", "conformal", "learn_then_test")] == [88, 96, 96]  # type: ignore[union-attr]
    exact, tail, margin = (found[name] for name in ("conformal", "learn_then_test", "global_margin"))
    assert exact is not None and tail is not None and margin is not None
    assert 0 < tail.mean < exact.mean <= 0.05
    assert 0 < (margin.retained_gain or 0) < (exact.retained_gain or 0) < 1


def test_a_guard_that_was_not_judged_has_no_redraws() -> None:
    found = assessed(97).redraws
    assert found is not None
    assert found["conformal"] is found["learn_then_test"] is None
    assert found["global_margin"] is not None
