"""Lower bounds on gap and time to collision that need no box arithmetic.

With ``D`` the vector between the centres of two boxes, ``h`` the sum of their half diagonals, ``v``
their relative velocity, and ``g n`` the vector between their closest points (gap ``g``, unit vector
``n``, closing speed ``c = -v . n``), no closest point is further than a half diagonal from its centre::

    |g n - D| <= h
    g          >= |D| - h
    c g = -v . g n <= |v| h - v . D =: p
    g / c = g^2 / (c g) >= max(|D| - h, 0)^2 / p      c <= 0 where p <= 0

Source: spec/05-raw-streams.md#evidence.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["PairBounds", "pair_bounds"]

Array = NDArray[np.float64]

_ROUNDING = 1e-9
"""Relative error that rounding stays below, here and where the quantities are computed."""


class PairBounds(NamedTuple):
    """Lower bounds of pairs, each field ``[pairs]``; NaN, which bounds nothing, where an input is no number.

    Attributes:
        gap_m: At most the gap, negative where boxes may overlap.
        ttc_s: At most gap over closing speed, at most 0 where boxes may overlap, ``inf`` where they cannot close.
    """

    gap_m: Array
    ttc_s: Array


def pair_bounds(offset_x_m: Array, offset_y_m: Array, reach_m: Array, rel_x_mps: Array, rel_y_mps: Array) -> PairBounds:
    """Bounds from ``D`` (second centre minus first), ``h`` and ``v`` (second velocity minus first)."""
    distance = np.sqrt(offset_x_m * offset_x_m + offset_y_m * offset_y_m)
    speed = np.sqrt(rel_x_mps * rel_x_mps + rel_y_mps * rel_y_mps)
    gap = distance - reach_m
    error = _ROUNDING * (distance + reach_m)
    gap -= error
    power = speed * (reach_m + error) - (rel_x_mps * offset_x_m + rel_y_mps * offset_y_m)
    ttc = np.where(gap > 0, np.inf, 0.0)
    with np.errstate(over="ignore"):  # a bound beyond all numbers is infinity
        np.divide(gap * gap, power, out=ttc, where=~(power <= 0) & ~(gap <= 0))
    return PairBounds(gap, ttc)
