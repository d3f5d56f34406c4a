"""The beta law: closed forms, scipy, and the ends of its range."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from branchdrive.statistics.binomial import beta_cdf, beta_quantile

PARAMETERS = st.floats(0.05, 2000)


def test_closed_forms() -> None:
    assert beta_cdf(0.3, 1, 1) == pytest.approx(0.3)
    assert beta_cdf(0.3, 4, 1) == pytest.approx(0.3**4)
    assert beta_quantile(0.975, 1, 40) == pytest.approx(1 - 0.025 ** (1 / 40))
    assert beta_quantile(0.25, 0.5, 0.5) == pytest.approx(math.sin(math.pi / 8) ** 2)


@given(st.floats(0, 1), PARAMETERS, PARAMETERS)
def test_distribution_is_that_of_scipy(x: float, a: float, b: float) -> None:
    assert beta_cdf(x, a, b) == pytest.approx(beta.cdf(x, a, b), rel=1e-9, abs=1e-12)


@given(st.sampled_from([0.025, 0.05, 0.5, 0.975]), PARAMETERS, PARAMETERS)
def test_quantile_is_that_of_scipy(probability: float, a: float, b: float) -> None:
    assert beta_quantile(probability, a, b) == pytest.approx(beta.ppf(probability, a, b), rel=1e-8, abs=1e-12)


def test_a_quantile_that_is_asked_for_again_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    once = beta_quantile(0.975, 3.25, 11.5)
    monkeypatch.setattr("branchdrive.statistics.binomial.beta_cdf", None)
    assert beta_quantile(0.975, 3.25, 11.5) == once


def test_ends() -> None:
    assert [beta_cdf(x, 2, 3) for x in (0.0, 1.0)] == [0, 1]
    for probability in (0.0, 1.0):
        with pytest.raises(ValueError, match="not in"):
            beta_quantile(probability, 2, 3)


@pytest.mark.parametrize(("x", "a", "b"), [(-0.1, 1, 1), (1.1, 1, 1), (0.5, 0, 1), (0.5, 1, -1), (math.nan, 1, 1)])
def test_what_is_no_beta_law_is_refused(x: float, a: float, b: float) -> None:
    with pytest.raises(ValueError, match="no beta law"):
        beta_cdf(x, a, b)
