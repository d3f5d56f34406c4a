"""The loss of a decision is what its formulas say, and sees only what decides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, WEIGHED, desirability, fit_scale, utility
from branchdrive.model.normalisation import Scaling
from branchdrive_reference.learning.configuration import DecisionConfig, PreferenceConfig
from branchdrive_reference.learning.decision import DecisionLoss

PREFERENCES = {name: PreferenceConfig(*PROFILES[name][:3]) for name in ("balanced", "safety", "progress", "comfort")}
NEAR_M = 2.0
NEAR = {"near": PreferenceConfig(0.5, 0.25, 0.25, near_m=NEAR_M)}
CONTRAST = DecisionConfig(contrast_weight=1.0, regret_weight=0.0, temperature=0.05, preferences=PREFERENCES)
REGRET = replace(CONTRAST, contrast_weight=0.0, regret_weight=1.0)
SCALING = Scaling(
    offset=np.array([3.0, 5.0, 30.0, 2.0, 2.0, 0.2]),
    scale=np.array([1.0, 4.0, 15.0, 3.0, 1.0, 0.1]),
    limit=np.full(6, np.inf),
    split_digest="",
)
GROUPS, CANDIDATES = 7, 13


def example(seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Predictions, targets and their mask; two groups are not ranked."""
    rng = np.random.default_rng(seed)
    predicted, scalars = (torch.from_numpy(rng.normal(size=(GROUPS, CANDIDATES, 6))) for _ in range(2))
    mask = torch.ones(GROUPS, CANDIDATES, 6, dtype=torch.bool)
    mask[:, :, 0] = False  # the time to collision, which utility does not weigh
    mask[2, 5, 1] = mask[4, 0, 5] = False
    return predicted, scalars, mask


def made(config: DecisionConfig, scalars: Tensor, mask: Tensor) -> DecisionLoss:
    return DecisionLoss(config, scalars, mask, SCALING)


def loss_of(config: DecisionConfig, predicted: Tensor, scalars: Tensor, mask: Tensor) -> float:
    return float(made(config, scalars, mask)(predicted, scalars, mask))


def test_parts_are_those_of_the_formulas() -> None:
    predicted, scalars, mask = example()
    truth = Targets(SCALING.invert(scalars), mask.numpy())
    guess = Targets(SCALING.invert(predicted), np.ones(mask.shape, np.bool_))
    scale, ranked = fit_scale(truth), [0, 1, 3, 5, 6]
    found, wanted = (desirability(part, scale)[ranked] for part in (guess, truth))
    pairs = (found[:, :, None] - found[:, None]) - (wanted[:, :, None] - wanted[:, None])
    profiles = [PROFILES[name] for name in PREFERENCES]
    contrast = np.mean([(pairs**2 * profile.weights).sum(3).mean() / 2 for profile in profiles])
    assert loss_of(CONTRAST, predicted, scalars, mask) == pytest.approx(contrast)
    regrets = []
    for profile in profiles:
        scores, utilities = (utility(part, scale, profile)[ranked] for part in (guess, truth))
        chosen = np.exp(scores / 0.05)
        value = (chosen * utilities).sum(1) / chosen.sum(1)
        regrets.append((utilities.max(1) - value) / np.ptp(utilities, axis=1))
    assert loss_of(REGRET, predicted, scalars, mask) == pytest.approx(np.mean(regrets))
    both = replace(CONTRAST, contrast_weight=2.0, regret_weight=0.5)
    parts = 2 * loss_of(CONTRAST, predicted, scalars, mask) + 0.5 * loss_of(REGRET, predicted, scalars, mask)
    assert loss_of(both, predicted, scalars, mask) == pytest.approx(parts)


def test_a_near_range_scores_the_root_of_the_gap() -> None:
    """One candidate has a gap and comes to a stop, all others are in contact and keep moving."""
    _, scalars, mask = example()
    mask[:] = True
    scalars[..., 1] = -SCALING.offset[1] / SCALING.scale[1]  # contact
    scalars[..., 2:] = 0.0
    config = replace(CONTRAST, preferences=NEAR)
    loss, costs = made(config, scalars, mask), []
    for gap_m in (0.0, 0.02, 0.5, NEAR_M, 9.0):
        other = scalars.clone()
        other[:, 4, 1] = (gap_m - SCALING.offset[1]) / SCALING.scale[1]
        costs.append(float(loss(scalars, other, mask)) / (0.5 * 12 / 13**2))
    assert costs == pytest.approx([0.0, 0.01, 0.25, 1.0, 1.0])
    predicted = scalars.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(loss(predicted, other, mask), predicted)
    assert bool(torch.isfinite(gradient).all()) and bool((gradient[:, 4, 1] < 0).all())


def test_an_offset_of_a_whole_group_is_no_error_of_contrast() -> None:
    _, scalars, mask = example()
    narrow = 0.01 * scalars  # within the quantiles, where nothing is clipped
    loss = made(CONTRAST, scalars, mask)
    assert float(loss(narrow + 0.1, narrow, mask)) == pytest.approx(0, abs=1e-12)
    assert float(loss(2 * narrow, narrow, mask)) > 1e-6


def test_the_best_choice_has_no_regret_and_the_worst_all_of_it() -> None:
    _, scalars, mask = example()
    mask[:] = True
    sharp = replace(REGRET, temperature=1e-3)
    assert loss_of(sharp, scalars, scalars, mask) < 0.05
    assert loss_of(sharp, -scalars, scalars, mask) > 0.8
    assert loss_of(REGRET, torch.zeros_like(scalars), torch.zeros_like(scalars), mask) == 0.0


@pytest.mark.parametrize(
    "config", [CONTRAST, REGRET, replace(REGRET, preferences=NEAR)], ids=["contrast", "regret", "near range"]
)
def test_what_decides_nothing_has_no_gradient(config: DecisionConfig) -> None:
    predicted, scalars, mask = example()
    predicted[0, 3, 1], predicted[0, 4, 2] = 50.0, -50.0  # beyond the quantiles, and so its desirability moves nowhere
    predicted.requires_grad_()
    (gradient,) = torch.autograd.grad(made(config, scalars, mask)(predicted, scalars, mask), predicted)
    assert not gradient[[2, 4]].any(), "groups that are not ranked"
    assert not gradient[..., 0].any(), "a target that utility does not weigh"
    assert gradient[0, 3, 1] == gradient[0, 4, 2] == 0
    assert all(gradient[0, :, column].any() for column in range(1, 6))
    assert bool(torch.isfinite(gradient).all())


def test_a_batch_without_a_ranked_group_costs_nothing() -> None:
    predicted, scalars, mask = example()
    loss = made(replace(CONTRAST, regret_weight=1.0), scalars, mask)
    assert float(loss(predicted, scalars, torch.zeros_like(mask))) == 0.0
    empty = made(CONTRAST, scalars, torch.zeros_like(mask))
    assert float(empty(predicted, scalars, torch.zeros_like(mask))) == 0.0


def test_every_weighed_target_is_seen() -> None:
    predicted, scalars, mask = example()
    assert len(WEIGHED) == 5
    for column in range(1, 6):
        nearer = predicted.clone()
        nearer[..., column] = scalars[..., column]
        assert loss_of(CONTRAST, nearer, scalars, mask) < loss_of(CONTRAST, predicted, scalars, mask)
