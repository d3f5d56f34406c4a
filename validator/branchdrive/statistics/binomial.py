"""Lower tail of the binomial law, exact.

::

    P(X <= k) = sum_{i <= k} C(n, i) p^i (1 - p)^(n - i),      X ~ Bin(n, p)

The sum is taken in integers with ``p`` as the decimal fraction it is written as, and rounded once.

The beta law with real parameters: distribution function and quantiles, to nine digits for parameters to 10,000.

With ``I`` the regularised incomplete beta function, by Lentz's continued fraction::

    P(X <= x) = I_x(a, b) = x^a (1 - x)^b / (a B(a, b)) * 1 / (1 + d_1 / (1 + d_2 / (1 + ...)))
    d_2m   = m (b - m) x / ((a + 2m - 1) (a + 2m))
    d_2m+1 = -(a + m) (a + b + m) x / ((a + 2m) (a + 2m + 1))

and ``I_x(a, b) = 1 - I_(1-x)(b, a)`` where ``x`` is above the mean. Quantiles are found by bisection.

Source: Lentz 1976; Press et al. 2007, section 6.4.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache

__all__ = ["beta_cdf", "beta_quantile", "binomial_cdf", "binomial_interval", "exact_fraction"]


def binomial_cdf(successes: int, trials: int, probability: float) -> float:
    """``P(X <= successes)``, correctly rounded.

    Raises:
        ValueError: `trials` is negative or `probability` not in ``[0, 1]``.
    """
    if trials < 0 or not 0 <= probability <= 1:
        raise ValueError(f"no binomial law of {trials} trials with probability {probability!r}")
    p = exact_fraction(probability)
    hit, miss = p.numerator, p.denominator - p.numerator
    if successes < 0 or not miss:
        return float(0 <= trials <= successes)
    ways = term = miss**trials
    for i in range(min(successes, trials)):
        term = term * (trials - i) * hit // ((i + 1) * miss)  # without remainder: a binomial term is an integer
        ways += term
    return float(Fraction(ways, p.denominator**trials))


def exact_fraction(number: float) -> Fraction:
    """The decimal fraction that `number` is written as: 0.05 is 1/20."""
    return Fraction(repr(float(number)))


def binomial_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % interval of Clopper and Pearson for the probability of success.

    Raises:
        ValueError: There is no trial, or `successes` is not in ``0 .. trials``.
    """
    if not 0 <= successes <= trials or not trials:
        raise ValueError(f"no interval of {successes} successes in {trials} trials")
    tail, missed = (1 - _LEVEL) / 2, trials - successes
    low = beta_quantile(tail, successes, missed + 1) if successes else 0.0
    high = beta_quantile(1 - tail, successes + 1, missed) if missed else 1.0
    return low, high


_LEVEL = 0.95
_TINY = 1e-300


_PRECISION = 1e-15


_MAX_TERMS = 100_000


_HALVINGS = 200


_MOST_KEPT = 4096
"""Quantiles that are kept: the intervals of a benchmark ask for the same few again and again."""


def beta_cdf(x: float, a: float, b: float) -> float:
    """``P(X <= x)`` for ``X ~ Beta(a, b)``.

    Raises:
        ValueError: `x` is not in ``[0, 1]``, `a` or `b` is not positive, or they are too large for the fraction.
    """
    if not (0 <= x <= 1 and 0 < a < math.inf and 0 < b < math.inf):
        raise ValueError(f"no beta law of {a!r} and {b!r} at {x!r}")
    if x in (0, 1):
        return float(x)
    if x * (a + b + 2) > a + 1:
        return 1 - beta_cdf(1 - x, b, a)
    logarithm = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    return math.exp(logarithm) / (a * _fraction(x, a, b))


@lru_cache(_MOST_KEPT)
def beta_quantile(probability: float, a: float, b: float) -> float:
    """The ``x`` at which `beta_cdf` is `probability`.

    Raises:
        ValueError: `probability` is not in ``(0, 1)``, or as `beta_cdf`.
    """
    if not 0 < probability < 1:
        raise ValueError(f"probability {probability!r} is not in (0, 1)")
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        low, high = (middle, high) if beta_cdf(middle, a, b) < probability else (low, middle)
    return high


def _fraction(x: float, a: float, b: float) -> float:
    """``1 + d_1 / (1 + d_2 / ...)``."""
    value, above, below = 1.0, 1.0, 0.0
    for k in range(1, _MAX_TERMS):
        m = k // 2
        if k % 2:
            d = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        else:
            d = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        below = 1 / _nonzero(1 + d * below)
        above = _nonzero(1 + d / above)
        step = above * below
        value *= step
        if abs(step - 1) < _PRECISION:
            return value
    raise ValueError(f"no beta law of {a!r} and {b!r}: the fraction does not settle")


def _nonzero(number: float) -> float:
    return number if abs(number) > _TINY else _TINY
