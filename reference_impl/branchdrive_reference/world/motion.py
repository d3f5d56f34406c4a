"""One tick of motion: from commands to velocities before the contact step, and to poses after it.

The contact step advances poses by ``velocity * tick``. The ego moves with its mean velocity of the tick, along
its mean heading ``yaw + w dt / 2``, which makes the chord of a steady turn exact in direction. If the step
returns that velocity unchanged, nothing touched the ego and the planned body-frame state holds; otherwise the
state is what contact made of it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.geometry.polyline import Array
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.world.body import EGO, Behaviour
from branchdrive_reference.world.vehicle import accelerate, turn

__all__ = ["finish_motion", "plan_motion"]

_FREE = int(Behaviour.FREE)


@kernel
def plan_motion(
    bodies: Records, vehicle: Records, motion: Array, steer: float, throttle: float, brake: float, grip: float
) -> tuple[float, float, float]:
    """Write ``motion[bodies, 6]`` for the contact step.

    Returns:
        Planned forward speed, lateral velocity and yaw rate of the ego.
    """
    forward = accelerate(vehicle, throttle, brake, grip)
    lateral, rate = turn(vehicle, forward, steer, grip)
    for index in range(bodies.shape[0]):
        body = bodies[index]
        motion[index, 0], motion[index, 1], motion[index, 2] = body.x_m, body.y_m, body.yaw_rad
        motion[index, 3], motion[index, 4] = body.vel_x_mps, body.vel_y_mps
        motion[index, 5] = body.yaw_rate_radps
    ego = bodies[EGO]
    heading = ego.yaw_rad + 0.5 * rate * TICK_S
    cos, sin = math.cos(heading), math.sin(heading)
    mean_forward, mean_lateral = 0.5 * (vehicle.forward_mps + forward), 0.5 * (vehicle.lateral_mps + lateral)
    ego.vel_x_mps, ego.vel_y_mps = cos * mean_forward - sin * mean_lateral, sin * mean_forward + cos * mean_lateral
    ego.yaw_rate_radps = rate
    motion[EGO, 3], motion[EGO, 4], motion[EGO, 5] = ego.vel_x_mps, ego.vel_y_mps, rate
    return forward, lateral, rate


@kernel
def finish_motion(
    bodies: Records, vehicle: Records, motion: Array, goals: Array, hit: NDArray[np.bool_],
    forward_mps: float, lateral_mps: float, yaw_rate_radps: float,
) -> None:  # fmt: skip
    """Read the contact step back into `bodies` and `vehicle`; a body that was hit is free from now on.

    Args:
        bodies: `BODY` rows.
        vehicle: The ego's `VEHICLE` row.
        motion: ``[bodies, 6]`` after the step.
        goals: ``[bodies, 3]`` poses that bodies on tracks planned to reach.
        hit: ``[bodies]`` whether a body was ever hit.
        forward_mps: Planned forward speed of the ego.
        lateral_mps: Planned lateral velocity of the ego.
        yaw_rate_radps: Planned yaw rate of the ego.
    """
    for index in range(bodies.shape[0]):
        body = bodies[index]
        if index != EGO and hit[index]:
            body.behaviour = _FREE
        if index == EGO or body.behaviour == _FREE:
            body.x_m, body.y_m, body.yaw_rad = motion[index, 0], motion[index, 1], motion[index, 2]
        else:
            body.x_m, body.y_m, body.yaw_rad = goals[index, 0], goals[index, 1], goals[index, 2]
    ego = bodies[EGO]
    cos, sin = math.cos(ego.yaw_rad), math.sin(ego.yaw_rad)
    touched = motion[EGO, 3] != ego.vel_x_mps or motion[EGO, 4] != ego.vel_y_mps
    if touched or motion[EGO, 5] != ego.yaw_rate_radps:
        forward_mps = cos * motion[EGO, 3] + sin * motion[EGO, 4]
        lateral_mps = cos * motion[EGO, 4] - sin * motion[EGO, 3]
        yaw_rate_radps = motion[EGO, 5]
    vehicle.accel_longitudinal_mps2 = (forward_mps - vehicle.forward_mps) / TICK_S
    vehicle.accel_lateral_mps2 = (lateral_mps - vehicle.lateral_mps) / TICK_S + forward_mps * yaw_rate_radps
    vehicle.forward_mps, vehicle.lateral_mps, vehicle.yaw_rate_radps = forward_mps, lateral_mps, yaw_rate_radps
    ego.vel_x_mps, ego.vel_y_mps = cos * forward_mps - sin * lateral_mps, sin * forward_mps + cos * lateral_mps
    ego.yaw_rate_radps, ego.speed_mps = yaw_rate_radps, forward_mps
    for index in range(EGO + 1, bodies.shape[0]):
        body = bodies[index]
        if body.behaviour == _FREE:
            body.vel_x_mps, body.vel_y_mps = motion[index, 3], motion[index, 4]
            body.yaw_rate_radps = motion[index, 5]
            body.speed_mps = body.vel_x_mps * math.cos(body.yaw_rad) + body.vel_y_mps * math.sin(body.yaw_rad)
