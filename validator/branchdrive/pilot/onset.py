"""When effects of interventions begin: the delay with which recorded commands explain what the vehicle does.

Against the nominal of the group, with the differences of applied commands ``u_k`` at the ticks ``k`` from ``t_b`` and
the nominal's speed ``v``, interventions that only drive or only steer are explained by::

    speed     D_j = g sum_(k < 5 j - d) (throttle_k - q brake_k)      heading   D_j = -g sum_(k < 5 j - d) v_k steer_k

``D_j`` is the difference at the observation of ``t_b + 5 j``, ``j = 0 .. 4``. Each intervention has a gain ``g`` of its
own, so that commands of any shape and vehicles of any strength are compared; ``q`` is one for all. The delay ``d`` is
the one that leaves the least of the effects unexplained, over interventions. It is 0 where the command of ``t_b`` acts
behind the observation of ``t_b``; a delay that a vehicle does not have itself is one of commands or of observations.
The interval holds all delays, early and late alike, that are not worse in clearly more than half of the interventions
(a sign test).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OFFSETS, HISTORY_OFFSETS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.response import MIN_COMMAND
from branchdrive.pilot.pilot import Part
from branchdrive.raw.rules.responses import MIN_INTERVENTIONS
from branchdrive.raw.window import take_float, window_rows

__all__ = ["ONSET_TICKS", "Onset", "fitted_onset", "onset_of"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NUM_AFTER = 4
"""Observations after the branch: a second, before traffic and limits of the vehicle have their say."""

_MARGIN_TICKS = 10
"""Largest delay that is looked for, early or late."""

_DELAYS = np.arange(-_MARGIN_TICKS, _MARGIN_TICKS + 0.125, 0.25)
ONSET_TICKS = np.arange(-_MARGIN_TICKS, _NUM_AFTER * OBSERVATION_STRIDE_TICKS + _MARGIN_TICKS)
"""Ticks from ``t_b`` whose commands may show in the observations that are compared."""

_OFFSETS = (*HISTORY_OFFSETS, *FUTURE_OFFSETS[:_NUM_AFTER])
_AT_BRANCH = len(HISTORY_OFFSETS) - 1

_ABOVE_NOISE = 10
"""An effect stands out where it is so many times the largest difference half a second before the branch and earlier."""

_ROUNDS = 4
"""Turns in which the strength of brakes, in that of the throttle, and the gains of interventions are fitted."""

_SLOWEST_MPS = 1.0
"""A vehicle that comes to a stand has no effect in proportion to its commands."""


class Onset(NamedTuple):
    """When the effects of one actuator begin, in ticks from its command.

    Attributes:
        num: Interventions that say so.
        ticks: The delay; negative where effects come before their commands.
        low: Least delay that explains the effects as well.
        high: Largest.
    """

    num: int
    ticks: float
    low: float
    high: float


def onset_of(parts: Sequence[Part]) -> dict[str, Onset]:
    """Onset by actuator, ``steering`` and ``pedals``, of those that enough interventions tell."""
    cases = [_of_part(part) for part in parts if len(part.view.controls) and len(part.view.observations)]
    found = {}
    for name in ("pedals", "steering") if cases else ():
        effect, *pushes = (np.concatenate(values) for values in zip(*(case[name] for case in cases), strict=True))
        if len(effect) >= MIN_INTERVENTIONS and (onset := fitted_onset(effect, pushes)) is not None:
            found[name] = onset
    return found


@np.errstate(all="ignore")  # where nothing changes there is no onset
def _of_part(part: Part) -> dict[str, tuple[Array, ...]]:
    """Effects ``[interventions, 5]`` and differences of commands ``[interventions, ticks]`` of each actuator."""
    view, selection = part.view, part.examination.selection
    group, policy = np.nonzero(selection.chosen >= 0)
    own, nominal = selection.chosen[group, policy], selection.nominal[group]
    kept = (nominal >= 0) & (policy != view.descriptor.action_bank.nominal_index) & view.branched[own]
    kept &= view.branch_tick[own] == view.branch_tick[nominal]
    own, nominal = own[kept], nominal[kept]
    steer, throttle, brake = (
        np.nan_to_num(_difference(part, "controls", f"applied_{name}", own, nominal, ONSET_TICKS))
        for name in ("steer", "throttle", "brake")
    )
    is_active = (ONSET_TICKS >= 0) & (ONSET_TICKS < ACTIVE_TICKS)
    steered, driven = steer[:, is_active].mean(axis=1), (throttle - brake)[:, is_active].mean(axis=1)
    gained, turned = (
        _difference(part, "observations", name, own, nominal, _OFFSETS) for name in ("speed_mps", "yaw_rad")
    )
    speed = _values(part, "observations", "speed_mps", nominal, _OFFSETS[_AT_BRANCH:])
    moves = (np.minimum(np.abs(speed), np.abs(speed + gained[:, _AT_BRANCH:])) >= _SLOWEST_MPS).all(axis=1)
    drives = moves & (np.abs(driven) >= MIN_COMMAND) & (np.abs(steered) < MIN_COMMAND)
    steers = moves & (np.abs(steered) >= MIN_COMMAND) & (np.abs(driven) < MIN_COMMAND)
    pedals, drives = _clear(gained, drives)
    steering, steers = _clear(-wrap_rad(turned), steers)
    observed = np.arange(_NUM_AFTER + 1) * OBSERVATION_STRIDE_TICKS
    of_tick = [np.interp(ONSET_TICKS + 0.5, observed, values) for values in speed[steers]]
    return {
        "pedals": (pedals, throttle[drives], -brake[drives]),
        "steering": (steering, steer[steers] * np.reshape(of_tick, (-1, len(ONSET_TICKS)))),
    }


def _values(part: Part, table: str, column: str, rollouts: Index, offsets: Sequence[int] | Index) -> Array:
    """Values at offsets from ``t_b`` ``[rollouts, offsets]``, NaN where one is missing."""
    stream = part.view.stream(table)
    rows = window_rows(part.view, stream, rollouts, [int(offset) for offset in offsets])
    return np.where(rows >= 0, take_float(stream, column, rows), np.nan) if len(stream) else np.full(rows.shape, np.nan)


def _difference(
    part: Part, table: str, column: str, own: Index, nominal: Index, offsets: Sequence[int] | Index
) -> Array:
    """Values of attempts minus those of their nominal ``[attempts, offsets]``, NaN where one is missing."""
    one, other = (_values(part, table, column, side, offsets) for side in (own, nominal))
    return one - other


def _clear(effect: Array, counts: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Effects from ``t_b`` on of the interventions that count and stand out, and which ones these are."""
    noise = np.abs(effect[:, : _AT_BRANCH - 1]).max(axis=1)
    after = effect[:, _AT_BRANCH:]
    largest = np.abs(after).max(axis=1)
    counts = counts & np.isfinite(after).all(axis=1) & (largest > _ABOVE_NOISE * noise) & (largest > 0)
    return after[counts], counts


def fitted_onset(effect: Array, pushes: Sequence[Array]) -> Onset | None:
    """The delay that explains effects, ``None`` where it is not inside of what is looked for.

    Args:
        effect: Differences from the nominal at ``t_b`` and the four observations after it ``[interventions, 5]``.
        pushes: Differences of commands at `ONSET_TICKS` from ``t_b``, each ``[interventions, ticks]``.
    """
    unexplained = np.stack([_unexplained(effect, [_summed(push, delay) for push in pushes]) for delay in _DELAYS])
    best = int(unexplained.mean(axis=1).argmin())
    num_worse = (unexplained > unexplained[best]).sum(axis=1)
    as_good = np.flatnonzero(num_worse <= len(effect) / 2 + np.sqrt(len(effect)))
    low, high = _DELAYS[as_good[0]], _DELAYS[as_good[-1]]
    if low == _DELAYS[0] or high == _DELAYS[-1]:
        return None
    return Onset(len(effect), float(_DELAYS[best]), float(low), float(high))


def _summed(push: Array, delay: float) -> Array:
    """Sums of differences of commands up to each observation, commands acting `delay` ticks later."""
    sums = np.concatenate([np.zeros((len(push), 1)), np.cumsum(push, axis=1)], axis=1)
    place = np.arange(_NUM_AFTER + 1) * OBSERVATION_STRIDE_TICKS - delay + _MARGIN_TICKS
    whole = np.minimum(place.astype(int), sums.shape[1] - 2)
    return np.asarray(sums[:, whole] * (1 - (place - whole)) + sums[:, whole + 1] * (place - whole))


def _unexplained(effect: Array, sums: Sequence[Array]) -> Array:
    """Share of each effect, by its norm, that commands leave unexplained ``[interventions]``, at a gain of its own."""
    weight = 1 / np.linalg.norm(effect, axis=1)
    gain, expected = np.ones(len(effect)), np.zeros_like(effect)
    for _ in range(_ROUNDS if len(sums) > 1 else 1):  # shares of the actuators and gains, by turns
        columns = np.stack([(part * (gain * weight)[:, None]).ravel() for part in sums], axis=1)
        shares = np.linalg.lstsq(columns, (effect * weight[:, None]).ravel())[0]
        expected = np.tensordot(shares, np.stack(sums), axes=1)
        squared = (expected**2).sum(axis=1)
        gain = np.where(squared > 0, (effect * expected).sum(axis=1) / np.maximum(squared, 1e-300), 0.0)
        gain = np.maximum(gain, 0.0)
    return np.asarray(np.linalg.norm(effect - gain[:, None] * expected, axis=1) * weight)
