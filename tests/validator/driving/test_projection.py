"""`projection`: points and pixels of declared cameras, from analytic views."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.contract.camera import PinholeCamera, TopDownCamera
from branchdrive.driving.projection import camera_axes, ground_of_pixels, map_pixels, pinhole_pixels

BEV = TopDownCamera(
    name="bev", stream="semantic_bev", width_px=256, height_px=256, px_per_m=2.0, origin_row_px=128.0,
    origin_column_px=128.0,
)  # fmt: skip


def camera(yaw_rad: float = 0.0, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> PinholeCamera:
    """A camera of a right angle in 160x90 pixels, 1 m before and 1.5 m above the ego's centre on the ground."""
    return PinholeCamera(
        name="front", stream="rgb_surround", width_px=160, height_px=90, fx_px=80.0, fy_px=80.0, cx_px=80.0, cy_px=45.0,
        x_m=1.0, y_m=0.0, z_m=1.5, yaw_rad=yaw_rad, pitch_rad=pitch_rad, roll_rad=roll_rad,
    )  # fmt: skip


ahead, left, ground = (11.0, 0.0, 1.5), (11.0, 10.0, 1.5), (16.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("pose", "point", "pixel", "depth_m"),
    [
        ({}, ahead, (80, 45), 10),
        ({}, left, (0, 45), 10),
        ({}, ground, (80, 53), 15),
        ({"yaw_rad": math.pi / 2}, (1.0, 10.0, 1.5), (80, 45), 10),
        ({"yaw_rad": math.pi / 2}, (11.0, 10.0, 1.5), (160, 45), 10),
        ({"yaw_rad": math.pi}, (-9.0, 0.0, 11.5), (80, -35), 10),
        ({"pitch_rad": math.pi / 4}, (11.0, 0.0, 11.5), (80, 45), math.sqrt(200)),
        ({"roll_rad": math.pi / 2}, left, (80, 125), 10),
    ],
)
def test_a_point_is_seen_where_the_pinhole_formula_has_it(
    pose: dict[str, float], point: tuple[float, float, float], pixel: tuple[float, float], depth_m: float
) -> None:
    pixels, depths = pinhole_pixels(camera(**pose), point)
    assert pixels == pytest.approx(np.array(pixel), abs=1e-9)
    assert depths == pytest.approx(depth_m)


def test_a_point_behind_the_camera_is_not_seen() -> None:
    pixels, depths = pinhole_pixels(camera(), [ahead, (0.0, 0.0, 1.5), (1.0, 3.0, 1.5)])
    assert np.isnan(pixels).all(axis=1).tolist() == [False, True, True]
    assert depths.tolist() == [10, -1, 0]


ANGLES = st.floats(-3.14, 3.14)


@given(ANGLES, ANGLES, ANGLES)
def test_axes_are_a_right_handed_frame(yaw_rad: float, pitch_rad: float, roll_rad: float) -> None:
    axes = camera_axes(camera(yaw_rad, pitch_rad, roll_rad))
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)


@given(ANGLES)
def test_positive_roll_lowers_the_right_side_of_the_camera(roll_rad: float) -> None:
    right = camera_axes(camera(roll_rad=roll_rad))[0]
    assert right[2] == pytest.approx(-math.sin(roll_rad))


def test_a_map_has_the_rear_below_and_the_right_side_on_the_right() -> None:
    rows, columns = map_pixels(BEV, [0.0, 10.0, -64.0], [0.0, 5.0, -64.0])
    assert rows.tolist() == [128, 108, 256]
    assert columns.tolist() == [128, 118, 256]


@given(st.floats(-100, 100), st.floats(-100, 100))
def test_pixels_of_a_map_lead_back_to_the_ground(x_m: float, y_m: float) -> None:
    assert ground_of_pixels(BEV, *map_pixels(BEV, x_m, y_m)) == pytest.approx((x_m, y_m), abs=1e-9)
