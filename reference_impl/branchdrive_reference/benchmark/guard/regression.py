"""Penalised regressions under signs: what is minimised, a certificate of the minimum, and Newton steps towards it.

With rows ``x`` of ``n``, truths ``y``, weights ``w`` and a free offset ``b``::

    F(w, b) = mean loss(w x + b, y) + r |w|^2          s_k w_k >= 0 where a sign s_k is not 0

A point that keeps the signs is the minimum exactly where the least element ``v`` of the subdifferential of ``F``
and the signs is 0. With the gradient ``g`` of ``F``, ``v`` holds what is left of stationarity, of the dual
variables ``s_k g_k >= 0`` and of complementarity::

    v_k = min(s_k g_k, 0)  where s_k is not 0 and w_k = 0          v_k = g_k  elsewhere, and for b

How far the minimum is follows from ``v`` by curvature that holds in a ball. Let ``R`` be the largest length of a row
with a 1 appended, ``c_i`` the least curvature of the loss of row ``i`` while its value moves by at most ``q``, and
``m`` the least eigenvalue of ``mean c_i (x_i, 1) (x_i, 1)^T + 2 r diag(1 .. 1, 0)``. Since gradients of convex
functions are monotone, and by at least ``m`` within ``q / R`` of the point::

    |v| < m q / R    implies    |(w, b) - minimum| <= |v| / m

The offset has no penalty; its curvature is that of the losses, so a fit in which no row has any is not certified.
The bound holds up to the rounding of ``v``, about 1e-16 ``R``.

Source: Rockafellar 1970 (subdifferentials); Gafni and Bertsekas 1984 (projected Newton steps); Bach 2010 (curvature
of the logistic loss away from a point).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["HUBER", "LOGISTIC", "Certificate", "Loss", "Regression", "polished"]

Array = NDArray[np.float64]

_REACH = 1e-4
"""``q``: how far values of rows may move in the certificate."""

_MAX_STEPS = 200
_MAX_HALVINGS = 40
_LEAST_SHARE = 1e-4
"""Part of the decrease that the gradient promises which a step must keep."""

_NEAR = 1e-3
"""Weights this near to 0 whose sign holds them there take no part in a Newton step."""

_RESOLVED = 1e-12
"""Decreases below this part of the objective are lost in its rounding."""


class Loss(NamedTuple):
    """A convex loss of values ``z`` against truths ``y``, each function from the two arrays, element by element.

    Attributes:
        value: The loss.
        slope: Its derivative in ``z``.
        curvature: Its second derivative, and at a kink of the slope one of both sides.
        majorant: Curvature of a parabola that touches the loss at ``z`` and is nowhere below it.
        floor: Least curvature within a third argument of ``z``.
    """

    value: Callable[[Array, Array], Array]
    slope: Callable[[Array, Array], Array]
    curvature: Callable[[Array, Array], Array]
    majorant: Callable[[Array, Array], Array]
    floor: Callable[[Array, Array, float], Array]


def _logistic_curvature(z: Array, _: Array) -> Array:
    small = np.exp(-np.abs(z))
    return np.asarray(small / (1.0 + small) ** 2)


def _logistic_slope(z: Array, y: Array) -> Array:
    small = np.exp(-np.abs(z))
    return np.asarray(np.where(z > 0, 1.0, small) / (1.0 + small) - y)


LOGISTIC = Loss(
    value=lambda z, y: np.logaddexp(0.0, z) - y * z,
    slope=_logistic_slope,
    curvature=_logistic_curvature,
    majorant=lambda z, _: np.full_like(z, 0.25),
    # |loss'''| <= loss'', so the logarithm of the curvature moves no more than z.
    floor=lambda z, y, reach: _logistic_curvature(z, y) * np.exp(-reach),
)
"""``log(1 + exp(z)) - y z`` with ``y`` 0 or 1."""

HUBER = Loss(
    value=lambda z, y: np.where(np.abs(z - y) <= 1.0, (z - y) ** 2, 2.0 * np.abs(z - y) - 1.0),
    slope=lambda z, y: 2.0 * np.clip(z - y, -1.0, 1.0),
    curvature=lambda z, y: np.where(np.abs(z - y) <= 1.0, 2.0, 0.0),
    majorant=lambda z, y: 2.0 / np.maximum(np.abs(z - y), 1.0),
    floor=lambda z, y, reach: np.where(np.abs(z - y) <= 1.0 - reach, 2.0, 0.0),
)
"""``e^2`` where ``|e| <= 1``, else ``2 |e| - 1``, with ``e = z - y``."""


class Certificate(NamedTuple):
    """How good a point is.

    Attributes:
        residual: ``|v|``.
        curvature: ``m``.
        distance: Largest distance from the minimum, weights and offset together; ``inf`` where nothing bounds it.
    """

    residual: float
    curvature: float
    distance: float


class Regression:
    """One program, on points ``[features + 1]``: the weights, and the offset last.

    Args:
        rows: ``x`` ``[rows, features]``.
        truth: ``y`` ``[rows]``.
        loss: Of a row.
        signs: ``s`` ``[features]``, -1, 0 for any, 1.
        penalty: ``r``, above 0.

    Raises:
        ValueError: There is no row, or a row or truth is not finite.
    """

    def __init__(self, rows: Array, truth: Array, loss: Loss, *, signs: Array, penalty: float) -> None:
        if not len(rows) or not (np.isfinite(rows).all() and np.isfinite(truth).all()):
            raise ValueError(f"a regression needs rows of finite numbers; there are {len(rows)} rows")
        self.truth, self.loss, self.penalty = truth, loss, penalty
        self.rows = np.concatenate([rows, np.ones((len(rows), 1))], axis=1)
        self.signs = np.append(signs, 0.0)
        self._ridge = np.append(np.full(rows.shape[1], 2.0 * penalty), 0.0)

    def thinned(self, most: int) -> Regression:
        """The same of every k-th row, with the least k that leaves at most `most` rows, at least one."""
        rows, every = self.rows[:, :-1], -(-len(self.rows) // most)
        if every == 1:
            return self
        return Regression(rows[::every], self.truth[::every], self.loss, signs=self.signs[:-1], penalty=self.penalty)

    def kept(self, point: Array) -> Array:
        """The nearest point that keeps the signs."""
        return np.where((self.signs != 0) & (point * self.signs <= 0), 0.0, point)

    def value(self, point: Array) -> float:
        """``F``."""
        return float(self.loss.value(self.rows @ point, self.truth).mean() + 0.5 * (self._ridge * point**2).sum())

    def gradient(self, point: Array) -> Array:
        """``g`` ``[features + 1]``."""
        slope = self.loss.slope(self.rows @ point, self.truth)
        return np.asarray(slope @ self.rows / len(self.rows) + self._ridge * point)

    def curvature(self, of_rows: Array) -> Array:
        """Second derivative ``[features + 1, features + 1]`` where rows have these curvatures ``[rows]``."""
        return np.asarray((self.rows.T * of_rows) @ self.rows / len(self.rows) + np.diag(self._ridge))

    def residual(self, point: Array) -> Array:
        """``v`` ``[features + 1]`` of a point that keeps the signs."""
        gradient = self.gradient(point)
        at_bound = (self.signs != 0) & (point == 0)
        return np.where(at_bound, np.minimum(self.signs * gradient, 0.0), gradient)

    def certificate(self, point: Array) -> Certificate:
        """How far a point may be from the minimum; one that breaks a sign or is not finite may be anywhere."""
        if not np.isfinite(point).all() or (point * self.signs < 0).any():
            return Certificate(np.inf, 0.0, np.inf)
        residual = float(np.linalg.norm(self.residual(point)))
        floors = self.loss.floor(self.rows @ point, self.truth, _REACH)
        least = max(float(np.linalg.eigvalsh(self.curvature(floors))[0]), 0.0)
        longest = float(np.sqrt((self.rows**2).sum(axis=1).max()))
        bounded = residual * longest < least * _REACH
        return Certificate(residual, least, residual / least if bounded else np.inf)


def polished(program: Regression, start: Array) -> Array:
    """The point of least residual on a path of Newton steps from `start`, as near to the minimum as rounding allows.

    Weights that their sign holds at 0 stay there, the others take a Newton step, and what leaves its sign is put
    at 0. Where the loss has too little curvature for that, as beyond the kinks of Huber's, its majorant stands for
    it. Steps are halved until the objective falls; where it falls by less than its rounding, a step must halve the
    residual instead.

    Args:
        program: What is minimised.
        start: Any finite point ``[features + 1]``; 0 stands for one that is worse.
    """
    point = best = min(program.kept(start), np.zeros_like(start), key=program.value)
    least = np.linalg.norm(program.residual(best))
    for _ in range(_MAX_STEPS):
        found = _step(program, point, program.loss.curvature)
        if found is None:
            found = _step(program, point, program.loss.majorant)
        if found is None:
            break
        point, residual = found, np.linalg.norm(program.residual(found))
        if residual < least:
            best, least = point, residual
    return best


def _step(program: Regression, point: Array, curvature: Callable[[Array, Array], Array]) -> Array | None:
    """The next point, ``None`` where none is better."""
    gradient, value = program.gradient(point), program.value(point)
    residual = float(np.linalg.norm(program.residual(point)))
    near = (program.signs != 0) & (np.abs(point) <= min(_NEAR, residual)) & (program.signs * gradient > 0)
    second = program.curvature(curvature(program.rows @ point, program.truth))[np.ix_(~near, ~near)]
    direction = -gradient
    try:
        direction[~near] = np.linalg.solve(second, -gradient[~near])
    except np.linalg.LinAlgError:
        return None
    promised = -float(gradient[~near] @ direction[~near])
    if not promised > _RESOLVED * (1.0 + abs(value)):
        tried = program.kept(point + direction)
        return tried if np.linalg.norm(program.residual(tried)) <= 0.5 * residual else None
    for halving in range(_MAX_HALVINGS):
        share = 0.5**halving
        tried = program.kept(point + share * direction)
        expected = share * promised + float(gradient[near] @ (point - tried)[near])
        if value - program.value(tried) >= _LEAST_SHARE * expected:
            return tried
    return None
