"""A second opinion on targets: plain Python, one rollout at a time, as the definitions read."""

from __future__ import annotations

import math
from collections.abc import Sequence

Pose = tuple[float, float, float, float]
"""x, y, yaw and speed at one observation."""

STEP_S = 0.25


def wrap(angle: float) -> float:
    return math.atan2(math.sin(angle), math.cos(angle))


def trajectory(poses: Sequence[Pose]) -> list[tuple[float, ...]]:
    """Steps 1 to 10 in the frame of the first pose."""
    x0, y0, yaw0, _ = poses[0]
    steps = []
    for x, y, yaw, speed in poses[1:]:
        distance, bearing = math.hypot(x - x0, y - y0), math.atan2(y - y0, x - x0)
        steps.append(
            (
                distance * math.cos(bearing - yaw0),
                distance * math.sin(bearing - yaw0),
                math.sin(yaw - yaw0),
                math.cos(yaw - yaw0),
                speed,
            )
        )
    return steps


def scalars(
    poses: Sequence[Pose], separation_m: Sequence[float | None], ttc_s: Sequence[float | None]
) -> list[float | None]:
    """T_min, D_min, P, J, A_max and Omega_max; ``None`` where unavailable."""
    velocities = [complex(v * math.cos(yaw), v * math.sin(yaw)) for _, _, yaw, v in poses]
    accel = [(velocities[j] - velocities[j - 1]) / STEP_S for j in range(1, 11)]
    jerk = [abs(accel[j] - accel[j - 1]) / STEP_S for j in range(1, 10)]
    turned = [abs(wrap(poses[j][2] - poses[j - 1][2])) for j in range(1, 11)]
    return [
        min((value for value in ttc_s if value is not None), default=None),
        min((value for value in separation_m if value is not None), default=None),
        trajectory(poses)[-1][0],
        sum(jerk) / len(jerk),
        max(map(abs, accel)),
        max(turned) / STEP_S,
    ]
