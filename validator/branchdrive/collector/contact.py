"""Contacts of the ego: boxes that touch, where a simulator has no contacts, and how many collisions they are.

Source: spec/05-raw-streams.md#results.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.world import Actor, Scene
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.box import Boxes, box_gap

__all__ = ["num_contacts", "touched"]

_LASTING = round(1.0 / (OBSERVATION_STRIDE_TICKS * TICK_S))
"""Observations of a second: what touches again within it touches still."""


def touched(scene: Scene, x_m: float, y_m: float, yaw_rad: float, actors: Sequence[Actor]) -> list[int]:
    """Ids of the actors whose boxes overlap or touch the ego's, for `Observation.contacts`.

    Args:
        scene: What has the extents of the ego.
        x_m: Centre of its box.
        y_m: The same, y.
        yaw_rad: Its heading.
        actors: Everybody else, at the same tick.
    """
    ego = (x_m, y_m, yaw_rad, scene.ego_length_m, scene.ego_width_m)
    others = [(actor.x_m, actor.y_m, actor.yaw_rad, actor.length_m, actor.width_m) for actor in actors]
    columns = np.array([ego, *others], np.float64).T
    gap_m = box_gap(Boxes(*columns[:, :1]), Boxes(*columns[:, 1:])).gap_m
    return [actor.actor_id for actor, gap in zip(actors, gap_m, strict=True) if gap == 0]


def num_contacts(touching: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Collisions with each actor or thing.

    Args:
        touching: What was touched since the previous observation ``[observations, things]``.

    Returns:
        Observations at which it is touched, and was not at those of the second before ``[things]``.
    """
    before = np.concatenate([np.zeros((_LASTING, touching.shape[1]), bool), touching])
    still = np.logical_or.reduce([before[i : i + len(touching)] for i in range(_LASTING)])
    return np.asarray((touching & ~still).sum(axis=0))
