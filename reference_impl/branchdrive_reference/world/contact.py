"""Contacts: pymunk moves every body by its velocity for one tick and resolves collisions.

All bodies are dynamic, so that momentum is shared at the very first touch; who is driven along a
track gets its pose and velocity written before every step and is released for good when it is hit.
Poses and velocities go in and come out in one batch each; pymunk visits dynamic bodies in insertion
order, which is checked once. The space is built again for every rollout: a copied one is not exact once
contacts are cached.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from branchdrive.contract.timing import TICK_S
from branchdrive.errors import BranchDriveError
from branchdrive_reference.world.body import EGO, Behaviour

__all__ = ["ContactSpace"]

_FIELDS = (
    pymunk.batch.BodyFields.POSITION
    | pymunk.batch.BodyFields.ANGLE
    | pymunk.batch.BodyFields.VELOCITY
    | pymunk.batch.BodyFields.ANGULAR_VELOCITY
)
_EGO_TYPE, _ACTOR_TYPE = 1, 2
_FRICTION, _ELASTICITY = 0.4, 0.1


class ContactSpace:
    """The physics of one rollout.

    Attributes:
        motion: ``[bodies, 6]`` float64: x, y, yaw, velocity x, velocity y, yaw rate; written before
            and read after every step.
        hit: ``[bodies]`` whether a body was ever hit; the caller releases it.
        touching: ``[bodies]`` whether the ego touched a body in the last step.
    """

    def __init__(self, bodies: NDArray[np.void]) -> None:
        count = len(bodies)
        self.motion = np.zeros((count, 6))
        self.hit = np.zeros(count, np.bool_)
        self.touching = np.zeros(count, np.bool_)
        self._behaviour = bodies["behaviour"]
        self._rows: dict[pymunk.Shape, int] = {}
        self._space = pymunk.Space()
        for row in range(count):
            self._add(bodies[row], row)
        self._check_order()
        self._space.on_collision(_EGO_TYPE, _ACTOR_TYPE, begin=self._ego_hits, pre_solve=self._ego_touches)
        self._space.on_collision(_ACTOR_TYPE, _ACTOR_TYPE, begin=self._actors_meet)
        self._inward, self._outward = pymunk.batch.Buffer(), pymunk.batch.Buffer()
        self._inward.set_float_buf(self.motion.reshape(-1))

    def step(self) -> None:
        """Advance `motion` by one tick."""
        self.touching[:] = False
        pymunk.batch.set_space_bodies(self._space, _FIELDS, self._inward)
        self._space.step(TICK_S)
        self._outward.clear()
        pymunk.batch.get_space_bodies(self._space, _FIELDS, self._outward)
        self.motion[:] = np.frombuffer(self._outward.float_buf()).reshape(self.motion.shape)

    def _add(self, row: np.void, index: int) -> None:
        mass, length, width = float(row["mass_kg"]), float(row["length_m"]), float(row["width_m"])
        body = pymunk.Body(mass, pymunk.moment_for_box(mass, (length, width)))
        body.position = float(row["x_m"]), float(row["y_m"])
        body.angle = float(row["yaw_rad"])
        shape = pymunk.Poly.create_box(body, (length, width))
        shape.collision_type = _EGO_TYPE if index == EGO else _ACTOR_TYPE
        shape.friction, shape.elasticity = _FRICTION, _ELASTICITY
        self._space.add(body, shape)
        self._rows[shape] = index

    def _check_order(self) -> None:
        order = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, order)
        inserted = [shape.body.id for shape in self._rows if shape.body is not None]
        if list(memoryview(order.int_buf()).cast("P")) != inserted:
            raise BranchDriveError(f"pymunk {pymunk.version} does not visit bodies in insertion order")

    def _ego_hits(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        self.hit[self._rows[arbiter.shapes[1]]] = True

    def _ego_touches(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        self.touching[self._rows[arbiter.shapes[1]]] = True

    def _actors_meet(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        """Contacts between actors count only where one of them is loose already."""
        rows = [self._rows[shape] for shape in arbiter.shapes]
        loose = [self.hit[row] or self._behaviour[row] == Behaviour.FREE for row in rows]
        if any(loose):
            self.hit[rows] = True
        else:
            arbiter.process_collision = False
