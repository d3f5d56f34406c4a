"""When effects of interventions begin, by extrapolation: also of replays that differ from their nominal before it.

Against the nominal of the group, speed and heading change linearly at first. With ``D_j`` the change at the observation
of ``t_b + 5 j``, in the direction of the command, of interventions that only drive or only steer::

    slope = (D_4 - D_2) / 2        onset = 3 - (D_2 + D_3 + D_4) / (3 slope)        in observations from t_b

where ``D_2 .. D_4`` lie on a line and stand well above what differs up to ``t_b``. It is 0 where the command of ``t_b``
acts behind the observation of ``t_b``; an actuator that lags adds its delay, an observation that is late by a stride
adds 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OFFSETS, HISTORY_OFFSETS
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.response import MIN_COMMAND
from branchdrive.pilot.pilot import Part
from branchdrive.raw.window import take_float, window_rows

__all__ = ["onsets"]

Array = NDArray[np.float64]

_NUM_BEFORE = len(HISTORY_OFFSETS)
_NUM_AFTER = 4

_ABOVE_NOISE = 10
"""The effect stands out where it is so many times the largest difference up to the branch."""

_STRAIGHT = 0.1
"""Share of the effect by which the middle of three points may be off their line."""


def onsets(parts: Sequence[Part]) -> Array:
    """Onset of every intervention that has one, in observations from the branch."""
    return np.concatenate([np.zeros(0), *(_of_part(part) for part in parts)])


@np.errstate(all="ignore")  # where nothing changes there is no onset
def _of_part(part: Part) -> Array:
    view, selection = part.view, part.examination.selection
    group, policy = np.nonzero(selection.chosen >= 0)
    own, nominal = selection.chosen[group, policy], selection.nominal[group]
    kept = (nominal >= 0) & (policy != view.descriptor.action_bank.nominal_index) & view.branched[own]
    kept &= view.branch_tick[own] == view.branch_tick[nominal]
    own, nominal = own[kept], nominal[kept]
    steer, throttle, brake = (_difference(part, "controls", f"applied_{name}", own, nominal, range(ACTIVE_TICKS))
                              .mean(axis=1) for name in ("steer", "throttle", "brake"))  # fmt: skip
    drive = throttle - brake
    offsets = (*HISTORY_OFFSETS, *FUTURE_OFFSETS[:_NUM_AFTER])
    speed, yaw = (_difference(part, "observations", name, own, nominal, offsets) for name in ("speed_mps", "yaw_rad"))
    drives = (np.abs(drive) >= MIN_COMMAND) & (np.abs(steer) < MIN_COMMAND)
    steers = (np.abs(steer) >= MIN_COMMAND) & (np.abs(drive) < MIN_COMMAND)
    return np.concatenate(
        [
            _onset(speed[drives] * np.sign(drive[drives])[:, None]),
            _onset(-wrap_rad(yaw[steers]) * np.sign(steer[steers])[:, None]),
        ]
    )


def _difference(
    part: Part, table: str, column: str, own: NDArray[np.int64], nominal: NDArray[np.int64], offsets: Sequence[int]
) -> Array:
    """Values of attempts minus those of their nominal ``[attempts, offsets]``, NaN where one is missing."""
    stream = part.view.stream(table)
    rows = [window_rows(part.view, stream, side, offsets) for side in (own, nominal)]
    there = (rows[0] >= 0) & (rows[1] >= 0)
    if not len(stream):
        return np.full(there.shape, np.nan)
    return np.where(there, take_float(stream, column, rows[0]) - take_float(stream, column, rows[1]), np.nan)


def _onset(effect: Array) -> Array:
    """Onsets from effects ``[attempts, 16 + 4]``, of those that have one."""
    noise = np.abs(effect[:, :_NUM_BEFORE]).max(axis=1)
    second, third, fourth = effect[:, _NUM_BEFORE + 1 :].T
    slope, mean = (fourth - second) / 2, (second + third + fourth) / 3
    is_clear = (slope > 0) & (mean > _ABOVE_NOISE * noise) & (np.abs(second - 2 * third + fourth) < _STRAIGHT * mean)
    return np.asarray((3 - mean / slope)[is_clear])
