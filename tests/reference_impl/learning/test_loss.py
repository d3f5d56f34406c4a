"""The loss is what its formulas say, and what is unavailable has no part in it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tests.reference_impl.learning.small_models import TRAINING
from torch import Tensor

from branchdrive_reference.learning.loss import LossTerms, loss_terms
from branchdrive_reference.learning.network import Outcome


def example(seed: int = 0) -> tuple[Outcome, Tensor, Tensor, Tensor]:
    rng = torch.Generator().manual_seed(seed)
    scalars, target = (3 * torch.randn(4, 13, 6, generator=rng, dtype=torch.float64) for _ in range(2))
    path, truth = (2 * torch.randn(4, 13, 10, 5, generator=rng, dtype=torch.float64) for _ in range(2))
    mask = torch.rand(4, 13, 6, generator=rng) < 0.7
    return Outcome(scalars.requires_grad_(), path.requires_grad_()), target, mask, truth


def huber(error: np.ndarray) -> np.ndarray:
    return np.where(np.abs(error) <= 1, 0.5 * error**2, np.abs(error) - 0.5)


def test_terms_are_those_of_the_formulas() -> None:
    outcome, target, mask, truth = example()
    terms = loss_terms(outcome, target, mask, truth, TRAINING)
    scalars, path = (values.detach().numpy() for values in outcome)
    errors, there = huber(scalars - target.numpy()), mask.numpy()
    terms = LossTerms(*(term.detach() for term in terms))
    assert float(terms.scalars) == pytest.approx(np.mean([errors[..., t][there[..., t]].mean() for t in range(6)]))
    assert float(terms.trajectories) == pytest.approx(huber(path - truth.numpy()).mean())
    norm = np.hypot(path[..., 2], path[..., 3])
    assert float(terms.heading) == pytest.approx(0.05 * ((norm - 1) ** 2).mean())
    assert float(terms.total) == pytest.approx(sum(float(term) for term in terms))


def test_what_is_unavailable_changes_neither_loss_nor_gradient() -> None:
    outcome, target, mask, truth = example()
    loss = loss_terms(outcome, target, mask, truth, TRAINING).scalars
    (gradient,) = torch.autograd.grad(loss, outcome.scalars)
    assert not gradient[~mask].any()
    assert bool(gradient[mask].all())
    other, shifted = torch.where(mask, target, 1e6), torch.where(mask, outcome.scalars, -1e6)
    assert torch.equal(loss_terms(Outcome(shifted, outcome.trajectories), other, mask, truth, TRAINING).scalars, loss)


def test_targets_weigh_the_same_however_rare_they_are() -> None:
    outcome, target, mask, truth = example()
    mask[:] = True
    mask[..., 0] = False
    mask[0, 0, 0] = True
    apart = Outcome(target + torch.tensor([11.0, 0, 0, 0, 0, 0]), outcome.trajectories)
    assert float(loss_terms(apart, target, mask, truth, TRAINING).scalars) == pytest.approx(10.5 / 6)


def test_a_target_without_any_value_is_left_out() -> None:
    outcome, target, mask, truth = example()
    mask[:] = True
    mask[..., 5] = False
    apart = Outcome(target + 3.0, outcome.trajectories)
    assert float(loss_terms(apart, target, mask, truth, TRAINING).scalars) == pytest.approx(2.5)
    mask[:] = False
    assert float(loss_terms(apart, target, mask, truth, TRAINING).scalars) == 0.0


def test_a_perfect_prediction_costs_nothing_and_no_norm_has_no_gradient_to_miss() -> None:
    _, target, mask, truth = example()
    truth[..., 2], truth[..., 3] = 0.6, 0.8
    assert float(loss_terms(Outcome(target, truth), target, mask, truth, TRAINING).total) == pytest.approx(0, abs=1e-12)
    flat = torch.zeros_like(truth, requires_grad=True)
    (gradient,) = torch.autograd.grad(loss_terms(Outcome(target, flat), target, mask, truth, TRAINING).heading, flat)
    assert bool(torch.isfinite(gradient).all())
