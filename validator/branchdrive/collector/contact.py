"""Contacts of the ego where a simulator has none: boxes that overlap or touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from branchdrive.collector.world import Actor, Scene
from branchdrive.driving.box import Boxes, box_gap

__all__ = ["touched"]


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
