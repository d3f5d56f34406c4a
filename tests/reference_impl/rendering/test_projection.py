"""Pinhole projection: the formula of the specification, and what another library says."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from branchdrive.contract.camera import PinholeCamera
from branchdrive_reference.rendering.projection import Pinhole
from branchdrive_reference.rendering.rig import MEDIA_STREAMS, cameras_of

TILTED = PinholeCamera(
    name="tilted", stream="rgb_surround", width_px=160, height_px=90, fx_px=120.0, fy_px=130.0, cx_px=70.0, cy_px=50.0,
    x_m=1.0, y_m=-0.4, z_m=1.5, yaw_rad=0.5, pitch_rad=-0.2, roll_rad=0.15,
)  # fmt: skip
CAMERAS = [TILTED, *(one for one in cameras_of(MEDIA_STREAMS) if isinstance(one, PinholeCamera))]
POINTS = np.random.default_rng(3).uniform([-40, -40, 0], [40, 40, 3], (400, 3))


def seen_points(pinhole: Pinhole) -> np.ndarray:
    return POINTS[pinhole.seen(POINTS)[:, 2] > 0.5]


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_pixels_are_those_of_opencv(camera: PinholeCamera) -> None:
    pinhole = Pinhole(camera)
    points = seen_points(pinhole)
    turn, _ = cv2.Rodrigues(pinhole.axes)
    theirs, _ = cv2.projectPoints(points, turn, -pinhole.axes @ pinhole.place_m, pinhole.intrinsics, None)
    np.testing.assert_allclose(
        pinhole.pixels(pinhole.seen(points)), theirs[:, 0], atol=1e-4
    )  # its vectors of rotations are short


def test_a_level_camera_sees_by_the_pinhole_formula() -> None:
    front = next(camera for camera in CAMERAS if camera.name == "front")
    x, y, z = 20.6, 3.0, 0.2
    depth = x - front.x_m
    expected = (front.cx_px - front.fx_px * y / depth, front.cy_px + front.fy_px * (front.z_m - z) / depth)
    pinhole = Pinhole(front)
    np.testing.assert_allclose(pinhole.pixels(pinhole.seen(np.array([x, y, z]))), expected, atol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_the_ground_is_a_plane_of_the_same_projection(camera: PinholeCamera) -> None:
    pinhole = Pinhole(camera)
    points = seen_points(pinhole) * [1, 1, 0]
    points = points[pinhole.seen(points)[:, 2] > 0.5]
    by_homography = np.column_stack([points[:, :2], np.ones(len(points))]) @ pinhole.ground.T
    pixels = pinhole.pixels(pinhole.seen(points))
    np.testing.assert_allclose(by_homography[:, :2] / by_homography[:, 2:], pixels, atol=1e-6)
    inside = (pixels > 0).all(axis=1) & (pixels < [camera.width_px, camera.height_px]).all(axis=1)
    u, v = np.floor(pixels[inside]).astype(int).T
    centres = np.column_stack([u + 0.5, v + 0.5, np.ones(len(u))])
    ground = centres @ np.linalg.inv(pinhole.ground).T
    ground = np.column_stack([ground[:, :2] / ground[:, 2:], np.zeros(len(u))])
    depth = pinhole.seen(ground)[:, 2]
    below = np.isfinite(pinhole.depth_m[v, u])
    np.testing.assert_allclose(pinhole.depth_m[v, u][below], depth[below], rtol=1e-6)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_the_frustum_holds_exactly_what_is_in_the_image(camera: PinholeCamera) -> None:
    pinhole = Pinhole(camera)
    normals, distances = pinhole.frustum(0.3)
    in_frustum = (distances < POINTS @ normals.T).all(axis=1)
    seen = pinhole.seen(POINTS)
    before = seen[:, 2] > 0.3
    pixels = pinhole.pixels(np.where(before[:, None], seen, 1.0))
    in_image = (pixels > 0).all(axis=1) & (pixels < [camera.width_px, camera.height_px]).all(axis=1)
    np.testing.assert_array_equal(in_frustum, before & in_image)
    assert in_frustum.any()
