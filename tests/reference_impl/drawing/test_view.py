"""The cut-out of a map: the ego drives to the right, and every future is inside."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.reference_impl.drawing.invented import inside, scene_of, write_invented

from branchdrive import Dataset
from branchdrive_reference.drawing.view import view_of

ASPECT = 1.5


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_invented(tmp_path_factory.mktemp("invented") / "d")


@pytest.mark.parametrize("group_id", ["g0", "g1", "g2"])
def test_every_future_is_in_view(dataset: Dataset, group_id: str) -> None:
    scene = scene_of(dataset, group_id)
    view = view_of(scene, aspect=ASPECT)
    for candidate in scene.candidates:
        u, v = view.place(candidate.x_m[candidate.future], candidate.y_m[candidate.future])
        assert inside(u, view.u_m) and inside(v, view.v_m)
    width, height = np.ptp(view.u_m), np.ptp(view.v_m)
    assert 75.0 <= width <= 105.0
    assert width / height == pytest.approx(ASPECT)


def test_the_nearest_actor_is_in_view(dataset: Dataset) -> None:
    scene = scene_of(dataset)
    view = view_of(scene, aspect=ASPECT)
    (actor,) = (actor for actor in scene.actors if actor.actor_id == scene.nearest_actor_id)
    u, v = view.place(actor.x_m[:1], actor.y_m[:1])
    assert inside(u, view.u_m) and inside(v, view.v_m)


@pytest.mark.parametrize("group_id", ["g0", "g1", "g2"])
def test_the_ego_is_the_origin_and_drives_along_u(dataset: Dataset, group_id: str) -> None:
    scene = scene_of(dataset, group_id)
    view, row = view_of(scene, aspect=ASPECT), scene.branch_row
    x, y, yaw = (float(values[row]) for values in (scene.nominal.x_m, scene.nominal.y_m, scene.nominal.yaw_rad))
    ahead, left = np.array([x, x + math.cos(yaw)]), np.array([y, y + math.sin(yaw)])
    u, v = view.place(ahead, left)
    assert u == pytest.approx([0.0, 1.0]) and v == pytest.approx([0.0, 0.0])
    assert view.angle(yaw) == 0.0


def test_what_lies_outside_is_not_seen(dataset: Dataset) -> None:
    view = view_of(scene_of(dataset), aspect=ASPECT)
    right = np.array([view.u_m[1] + 5.0, view.u_m[1] + 9.0])
    assert not view.sees(right, np.zeros(2))
    assert view.sees(right, np.zeros(2), margin_m=6.0)
    assert view.sees(np.array([-1e3, 1e3]), np.zeros(2))
