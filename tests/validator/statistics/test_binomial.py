"""The binomial tail: exact values, scipy, and the ends of its range."""

from __future__ import annotations

from fractions import Fraction
from math import comb

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from branchdrive.statistics.binomial import binomial_cdf, exact_fraction


def test_no_success_in_n_trials() -> None:
    assert binomial_cdf(0, 45, 0.05) == float(Fraction(19, 20) ** 45)
    # Forty-four trials cannot show a rate of 0.05 at 0.1, forty-five can.
    assert binomial_cdf(0, 44, 0.05) > 0.1 > binomial_cdf(0, 45, 0.05)


def test_a_number_is_the_fraction_it_is_written_as() -> None:
    assert exact_fraction(0.05) == Fraction(1, 20)
    assert exact_fraction(1) == 1
    assert exact_fraction(1e-3) == Fraction(1, 1000)


@given(st.integers(-1, 80), st.integers(0, 80), st.integers(0, 100))
def test_it_is_the_sum_of_its_terms(successes: int, trials: int, percent: int) -> None:
    p = Fraction(percent, 100)
    terms = [comb(trials, i) * p**i * (1 - p) ** (trials - i) for i in range(trials + 1)]
    assert binomial_cdf(successes, trials, percent / 100) == float(sum(terms[: successes + 1], Fraction(0)))


@given(st.integers(0, 400), st.integers(0, 400), st.floats(0.001, 0.999))
def test_it_is_that_of_scipy(successes: int, trials: int, probability: float) -> None:
    # Next to the smallest numbers of double precision scipy loses digits.
    wanted = binom.cdf(successes, trials, probability)
    assert binomial_cdf(successes, trials, probability) == pytest.approx(wanted, rel=1e-9, abs=1e-200)


@pytest.mark.parametrize(("trials", "probability"), [(-1, 0.5), (3, -0.1), (3, 1.1), (3, float("nan"))])
def test_what_is_no_binomial_law_is_refused(trials: int, probability: float) -> None:
    with pytest.raises(ValueError, match="no binomial law"):
        binomial_cdf(0, trials, probability)
