"""The regression against a general minimiser, and which classifier of sequences is taken."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import numpy as np
import pytest
from scipy.optimize import minimize

from branchdrive.leakage import classifier
from branchdrive.leakage.classifier import ENTRY_POINTS, Unavailable, fit_logistic, log_probability, sequence_classifier


def sample(num_rows: int, num_features: int, num_classes: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    classes = rng.integers(num_classes, size=num_rows)
    return rng.normal(size=(num_rows, num_features)) + 0.7 * classes[:, None], classes


def test_the_gradient_vanishes() -> None:
    x, classes = sample(200, 3, 4)
    weights = fit_logistic(x, classes, 4, penalty=0.5)
    residual = np.exp(log_probability(x, weights)) - np.eye(4)[classes]
    gradient = np.concatenate([x, np.ones((200, 1))], axis=1).T @ residual + 0.5 * weights
    np.testing.assert_allclose(gradient, 0.0, atol=1e-4)


def test_a_general_minimiser_finds_the_same() -> None:
    x, classes = sample(60, 2, 3)

    def objective(flat: np.ndarray) -> float:
        w = flat.reshape(3, 3)
        return float(-log_probability(x, w)[np.arange(60), classes].sum() + 0.5 * 2.0 * (w**2).sum())

    found = minimize(objective, np.zeros(9), tol=1e-10).x.reshape(3, 3)
    np.testing.assert_allclose(fit_logistic(x, classes, 3, penalty=2.0), found, atol=1e-4)


def test_probabilities_sum_to_one() -> None:
    x, classes = sample(50, 2, 3)
    scores = log_probability(x.reshape(10, 5, 2) * 1e3, fit_logistic(x, classes, 3, penalty=1.0))
    assert scores.shape == (10, 5, 3)
    np.testing.assert_allclose(np.exp(scores).sum(axis=2), 1.0)


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e6])
def test_separated_classes_end(scale: float) -> None:
    x = scale * np.eye(4).repeat(20, axis=0)
    weights = fit_logistic(x, np.arange(4).repeat(20), 4, penalty=1.0)
    found = log_probability(x, weights)
    assert np.isfinite(weights).all()
    if scale:
        assert (found.argmax(axis=1) == np.arange(4).repeat(20)).all()
    else:
        np.testing.assert_allclose(found, -np.log(4))


def offer(monkeypatch: pytest.MonkeyPatch, *values: str) -> None:
    points = [EntryPoint(f"c{len(values) - i}", value, ENTRY_POINTS) for i, value in enumerate(values)]
    monkeypatch.setattr(classifier, "entry_points", lambda group: points if group == ENTRY_POINTS else [])


def test_the_only_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "math:pi")
    assert sequence_classifier() == pytest.approx(3.14159, abs=1e-5)


def test_none_of_several_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "math:tau", "math:pi")
    reason = "several sequence classifiers are installed: `c1`, `c2`; uninstall all but one"
    assert sequence_classifier() == Unavailable(reason)


def test_a_missing_package_is_named_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "no_such_package.gru:gru")
    reason = "needs the package `no_such_package`, which the extra `models` brings"
    assert sequence_classifier() == Unavailable(reason)


def test_nothing_installed_is_said_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch)
    found = sequence_classifier()
    assert isinstance(found, Unavailable)
    assert "the extra `models` brings one" in found.reason
