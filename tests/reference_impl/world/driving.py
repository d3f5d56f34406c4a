"""An empty plane with only the ego on it, driven by given commands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.world.body import EGO, Behaviour, Body, Kind, body_table
from branchdrive_reference.world.contact import ContactSpace
from branchdrive_reference.world.motion import finish_motion, plan_motion
from branchdrive_reference.world.vehicle import EGO_SIZE, VEHICLE

GRIP = 0.9


class Plane:
    """The ego at the origin, heading along x, and further bodies that stand or slide."""

    def __init__(self, speed_mps: float, *others: Body, grip: float = GRIP) -> None:
        ego = Body(Kind.VEHICLE, Behaviour.DRIVEN, EGO_SIZE, 0.0, 0.0, 0.0, speed_mps)
        self.bodies = body_table([ego, *others])
        self.vehicle = np.zeros(1, VEHICLE)
        self.vehicle["forward_mps"] = speed_mps
        self.contacts = ContactSpace(self.bodies)
        self._goals = np.stack([self.bodies[name] for name in ("x_m", "y_m", "yaw_rad")], axis=1)
        self._grip = grip

    def drive(self, num_ticks: int, steer: float = 0.0, throttle: float = 0.0, brake: float = 0.0) -> NDArray[np.void]:
        """Ego's `BODY` rows after each of `num_ticks` ticks."""
        rows = []
        for _ in range(num_ticks):
            motion, hit = self.contacts.motion, self.contacts.hit
            planned = plan_motion(self.bodies, self.vehicle[0], motion, steer, throttle, brake, self._grip)
            self.contacts.step()
            finish_motion(self.bodies, self.vehicle[0], motion, self._goals, hit, *planned)
            rows.append(self.bodies[EGO].copy())
        return np.array(rows)
