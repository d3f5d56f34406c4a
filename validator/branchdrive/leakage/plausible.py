"""Whether a stated p-value fits the first of the permutations that it was counted over.

Of ``B`` permutations ``k`` reach a statistic, by the statement; of the first ``n`` of them ``c`` do. The permutations
are exchangeable, so ``c`` is hypergeometric: ``P(c) = C(k, c) C(B - k, n - c) / C(B, n)``. With ``n = B`` only
``c = k`` is possible. Either tail holds ``P(c)``, so where that alone is large enough no tail is summed up.

Source: this project's choice.
"""

from __future__ import annotations

import math

__all__ = ["LEAST_TAIL", "is_plausible"]

LEAST_TAIL = 1e-9
"""Two-sided tail below which a count contradicts a statement."""

_SLACK = 1
"""Permutations that the last bits of another machine may move across a statistic."""


def is_plausible(reached: int, drawn: int, p: float, num_permutations: int) -> bool:
    """Whether `reached` of the first `drawn` permutations fit ``p = (1 + k) / (B + 1)``, with one permutation to spare.

    Args:
        reached: Permutations drawn that reach the statistic, ``c``.
        drawn: Permutations drawn, ``n``.
        p: As stated.
        num_permutations: Permutations that `p` was counted over, ``B``.
    """
    stated = round(p * (num_permutations + 1)) - 1
    counts = range(max(0, stated - _SLACK), min(num_permutations, stated + _SLACK) + 1)
    return any(_two_sided(reached, drawn, k, num_permutations) >= LEAST_TAIL for k in counts)


def _two_sided(c: int, n: int, k: int, total: int) -> float:
    """Twice the smaller of both tails of the hypergeometric distribution, each with `c` itself.

    Where ``2 P(c)`` is at least `LEAST_TAIL`, that.
    """
    least, most = max(0, n - (total - k)), min(n, k)
    if not least <= c <= most:
        return 0.0
    if (alone := 2 * _probability(c, n, k, total)) >= LEAST_TAIL:
        return alone
    below = math.fsum(_probability(x, n, k, total) for x in range(least, c + 1))
    above = math.fsum(_probability(x, n, k, total) for x in range(c, most + 1))
    return 2 * min(below, above)


def _probability(c: int, n: int, k: int, total: int) -> float:
    return math.exp(_log_choose(k, c) + _log_choose(total - k, n - c) - _log_choose(total, n))


def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
