"""What cameras show: an actor where the formula says, in the cameras that look at it and in no other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.reference_impl.rendering.stage_set import CAR, Row, moved, snapshot, straight_town

from branchdrive.contract.camera import PinholeCamera
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass, classes_of
from branchdrive.driving.projection import map_pixels
from branchdrive_reference.rendering.projection import Pinhole
from branchdrive_reference.rendering.renderer import Renderer
from branchdrive_reference.rendering.rig import cameras_of

CAMERAS = cameras_of(("rgb_surround", "semantic_bev"), width_px=320, height_px=180)
_AROUND = [camera for camera in CAMERAS if isinstance(camera, PinholeCamera)]
_RENDERER = Renderer(straight_town(), "clear-noon", CAMERAS)


def box_pixels(camera: PinholeCamera, ahead_m: float, left_m: float, yaw_rad: float) -> np.ndarray | None:
    """Pixels of the corners of a car ``[8, 2]``, ``None`` where one lies behind the camera."""
    length, width, height = CAR
    signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (0, 1)])
    along, left = signs[:, 0] * length / 2, signs[:, 1] * width / 2
    x = ahead_m + math.cos(yaw_rad) * along - math.sin(yaw_rad) * left
    y = left_m + math.sin(yaw_rad) * along + math.cos(yaw_rad) * left
    pinhole = Pinhole(camera)
    seen = pinhole.seen(np.stack([x, y, signs[:, 2] * height], axis=1))
    return None if (seen[:, 2] < 0.5).any() else pinhole.pixels(seen)


PLACES = [
    (18.0, 0.0, 0.0),
    (25.0, 7.0, 2.0),
    (6.0, 12.0, 0.3),
    (5.0, -11.0, 1.5),
    (-20.0, 3.0, 0.1),
    (-14.0, -9.0, -0.7),
]


@pytest.mark.parametrize(("ahead_m", "left_m", "yaw_rad"), PLACES)
def test_a_car_is_where_the_formula_says(ahead_m: float, left_m: float, yaw_rad: float) -> None:
    row: Row = ("vehicle", ahead_m, left_m - 1.75, yaw_rad)
    without, with_car = (_RENDERER.images(snapshot(rows)) for rows in ([], [row]))
    num_seen = 0
    for camera in _AROUND:
        changed = np.abs(with_car[camera.name].astype(int) - without[camera.name]).max(axis=2) > 12
        corners = box_pixels(camera, ahead_m, left_m, yaw_rad)
        size = np.array([camera.width_px, camera.height_px])
        is_whole = corners is not None and (corners > 1).all() and (corners < size - 1).all()
        if is_whole:
            low, high = corners.min(axis=0), corners.max(axis=0)
            rows, columns = np.nonzero(changed)
            depth_m = Pinhole(camera).seen(np.array([ahead_m, left_m, 0.0]))[2] - CAR[0] / 2
            tolerance = 2.0 + 0.15 * camera.fx_px / depth_m  # smooth edges, and a shadow a hand wide
            found = (columns.min(), columns.max() + 1, rows.min(), rows.max() + 1)
            assert found == pytest.approx((low[0], high[0], low[1], high[1]), abs=tolerance)
            num_seen += 1
        elif corners is None or (corners < 0).all(axis=0).any() or (corners > size).all(axis=0).any():
            behind = Pinhole(camera).seen(np.array([ahead_m, left_m, 0.7]))[2] < -3
            assert not changed.any() or not behind
    assert num_seen >= 1


@pytest.mark.parametrize(("ahead_m", "left_m", "yaw_rad"), PLACES)
def test_cameras_and_the_semantic_view_agree(ahead_m: float, left_m: float, yaw_rad: float) -> None:
    state = snapshot([("vehicle", ahead_m, left_m - 1.75, yaw_rad)])
    images, empty = _RENDERER.images(state), _RENDERER.images(snapshot())
    bev = CAMERAS[-1]
    row, column = (int(value) for value in map_pixels(bev, ahead_m, left_m))  # type: ignore[arg-type]
    assert classes_of(images["bev"])[row, column] == SemanticClass.VEHICLE
    assert images["bev"][row, column] & SemanticChannel.OTHER_VEHICLE
    for camera in _AROUND:
        pinhole = Pinhole(camera)
        seen = pinhole.seen(np.array([ahead_m, left_m, 0.6]))
        u, v = np.floor(pinhole.pixels(seen)).astype(int) if seen[2] > 1 else (-1, -1)
        if 0 <= u < camera.width_px and 0 <= v < camera.height_px:
            assert np.abs(images[camera.name][v, u].astype(int) - empty[camera.name][v, u]).max() > 12


def test_the_world_turns_with_the_ego() -> None:
    turned = moved(snapshot([("vehicle", 0.0, 18.25, 0.5 * math.pi)]), yaw_rad=0.5 * math.pi)
    without = moved(snapshot(), yaw_rad=0.5 * math.pi)
    changed = _RENDERER.images(turned)["front"].astype(int) - _RENDERER.images(without)["front"]
    rows, columns = np.nonzero(np.abs(changed).max(axis=2) > 12)
    assert columns.mean() == pytest.approx(159.5, abs=2.0)
    assert rows.mean() > 90


def test_nearer_actors_cover_farther_ones() -> None:
    near, far = ("static", 8.0, -1.75, 0.0), ("vehicle", 30.0, -1.75, 0.0)
    images = [_RENDERER.images(snapshot(rows))["front"] for rows in ([near], [near, far], [far, near])]
    pinhole = Pinhole(_AROUND[0])
    u, v = np.floor(pinhole.pixels(pinhole.seen(np.array([7.8, 0.0, 0.3])))).astype(int)
    for image in images[1:]:
        np.testing.assert_array_equal(image[v, u], images[0][v, u])


def test_a_signal_shows_the_recorded_light() -> None:
    shown = {light: _RENDERER.images(snapshot(light=light))["front"].astype(int) for light in ("red", "green", None)}
    changed = np.abs(shown["red"] - shown["green"]).max(axis=2) > 30
    rows, columns = np.nonzero(changed)
    pinhole = Pinhole(_AROUND[0])
    expected = pinhole.pixels(pinhole.seen(np.array([30.0, -3.25, 2.9])))
    assert (columns.mean() + 0.5, rows.mean() + 0.5) == (
        pytest.approx(expected[0], abs=2),
        pytest.approx(expected[1], abs=2),
    )
    red, green = (shown["red"] - shown[None])[changed], (shown["green"] - shown[None])[changed]
    assert red[:, 2].max() > 80
    assert green[:, 1].max() > 80


def test_a_wide_image_is_drawn_as_well() -> None:
    cameras = cameras_of(("rgb_surround",), width_px=1600, height_px=900)
    images = Renderer(straight_town(), "rain-night", cameras).images(snapshot([("vehicle", 12.0, -1.75, 0.0)]))
    assert {image.shape for image in images.values()} == {(900, 1600, 3)}


@pytest.mark.parametrize("distance_m", [-1.0, 0.0, 2.5, 3.5, 1000.0])
def test_actors_at_any_distance_are_drawn(distance_m: float) -> None:
    rows = [(kind, distance_m, -1.75, 0.4) for kind in ("vehicle", "cycle", "pedestrian", "static")]
    for image in _RENDERER.images(snapshot(rows)).values():
        assert np.ptp(image) > 0
