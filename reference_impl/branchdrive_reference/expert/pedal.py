"""Pedals for a wanted acceleration: the vehicle's longitudinal model, inverted."""

from __future__ import annotations

from branchdrive_reference.kernel import kernel
from branchdrive_reference.world.vehicle import MAX_BRAKE_MPS2, drive_limit_mps2, resistance_mps2

__all__ = ["pedals"]

_COASTING_BAND_MPS2 = 0.25
_HOLD_SPEED_MPS, _HOLD_BRAKE = 0.3, 0.4


@kernel
def pedals(accel_mps2: float, speed_mps: float) -> tuple[float, float]:
    """Throttle and brake, each in ``[0, 1]`` and never both.

    Just below the coasting deceleration neither pedal is pressed; near standstill the brake holds.
    """
    if accel_mps2 < 0.0 and speed_mps < _HOLD_SPEED_MPS:
        return 0.0, max(_HOLD_BRAKE, min(-accel_mps2 / MAX_BRAKE_MPS2, 1.0))
    surplus = accel_mps2 + resistance_mps2(speed_mps)
    if surplus >= 0.0:
        return min(surplus / drive_limit_mps2(speed_mps), 1.0), 0.0
    if surplus > -_COASTING_BAND_MPS2:
        return 0.0, 0.0
    return 0.0, min(-surplus / MAX_BRAKE_MPS2, 1.0)
