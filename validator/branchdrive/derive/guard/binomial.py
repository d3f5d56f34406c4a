"""Lower tail of the binomial law, exact.

::

    P(X <= k) = sum_{i <= k} C(n, i) p^i (1 - p)^(n - i),      X ~ Bin(n, p)

The sum is taken in integers with ``p`` as the decimal fraction it is written as, and rounded once.
"""

from __future__ import annotations

from fractions import Fraction

__all__ = ["binomial_cdf", "exact_fraction"]


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
