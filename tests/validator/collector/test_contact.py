"""Contacts by boxes."""

from __future__ import annotations

import numpy as np

import branchdrive as bd
from branchdrive.collector.contact import num_contacts

SCENE = bd.Scene(
    town="T", route_id="r", route_x_m=[0, 9], route_y_m=[0, 0], environment="e", ego_length_m=4.0, ego_width_m=2.0
)


def actor(actor_id: int, x_m: float, y_m: float, yaw_rad: float = 0.0) -> bd.Actor:
    return bd.Actor(
        actor_id=actor_id, actor_class="vehicle", x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, length_m=4.0, width_m=2.0,
        vel_x_mps=0.0, vel_y_mps=0.0,
    )  # fmt: skip


def test_boxes_that_overlap_or_touch_are_contacts() -> None:
    actors = [actor(3, 4.0, 0.0), actor(5, 4.01, 0.0), actor(7, 0.0, -1.9), actor(9, 0.0, 2.5), actor(11, 30.0, 0.0)]
    assert bd.touched(SCENE, 0.0, 0.0, 0.0, actors) == [3, 7]


def test_headings_count() -> None:
    assert bd.touched(SCENE, 0.0, 0.0, 0.0, [actor(1, 0.0, 2.5, np.pi / 2)]) == [1]
    assert bd.touched(SCENE, 0.0, 0.0, np.pi / 2, [actor(1, 3.5, 0.0, np.pi / 2)]) == []


def test_nobody_touches_an_empty_road() -> None:
    assert bd.touched(SCENE, 0.0, 0.0, 0.0, []) == []


def test_what_is_touched_again_within_a_second_is_one_collision() -> None:
    touching = np.zeros((20, 3), bool)
    touching[[2, 3, 7, 12], 0] = True  # 4 observations are a second, 5 are more
    touching[0, 1] = True
    assert num_contacts(touching).tolist() == [2, 1, 0]


def test_nothing_is_touched_in_a_drive_without_observations() -> None:
    assert num_contacts(np.zeros((0, 2), bool)).tolist() == [0, 0]
    assert num_contacts(np.zeros((4, 0), bool)).tolist() == []
