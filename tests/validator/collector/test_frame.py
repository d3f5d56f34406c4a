"""Adapters convert as the table of chapter 2 says."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive import Frame, box_centre, full_extents

CARLA = Frame(is_left_handed=True, is_degrees=True)


def test_a_left_handed_frame_in_degrees_is_turned() -> None:
    assert CARLA.vector(3.0, 4.0) == (3.0, -4.0)
    assert CARLA.yaw_rad(90.0) == pytest.approx(-np.pi / 2)
    assert CARLA.rate(180.0) == pytest.approx(-np.pi)
    assert CARLA.lateral(2.0) == -2.0


def test_headings_are_wrapped_and_rates_are_not() -> None:
    assert CARLA.yaw_rad(270.0) == pytest.approx(np.pi / 2)
    assert CARLA.rate(-720.0) == pytest.approx(4 * np.pi)
    assert Frame().yaw_rad(2 * np.pi + 0.5) == pytest.approx(0.5)


def test_the_recorded_frame_stays() -> None:
    assert (*Frame().vector(3.0, 4.0), Frame().yaw_rad(0.25), Frame().rate(7.0)) == (3.0, 4.0, 0.25, 7.0)


COMPASS = Frame(is_degrees=True, is_compass=True)


@pytest.mark.parametrize(
    ("heading_deg", "way"),
    [(0.0, (0.0, 1.0)), (90.0, (1.0, 0.0)), (180.0, (0.0, -1.0)), (270.0, (-1.0, 0.0)), (45.0, (0.5**0.5, 0.5**0.5))],
)
def test_a_compass_heading_points_where_its_vehicle_drives(heading_deg: float, way: tuple[float, float]) -> None:
    """North is y, east is x: yaw is the angle of the way from x."""
    yaw_rad = COMPASS.yaw_rad(heading_deg)
    assert (np.cos(yaw_rad), np.sin(yaw_rad)) == pytest.approx(way, abs=1e-12)
    assert COMPASS.vector(*way) == way


@pytest.mark.parametrize("frame", [COMPASS, Frame(is_left_handed=True, is_degrees=True, is_compass=True)])
def test_a_compass_turns_clockwise_whatever_the_hand_of_its_positions(frame: Frame) -> None:
    turned = np.diff(frame.yaw_rad(np.array([10.0, 12.0])))
    assert turned == pytest.approx([-np.radians(2.0)])
    assert frame.rate(2.0) == pytest.approx(-np.radians(2.0))


def test_positions_to_the_south_are_turned_and_their_headings_stay_those_of_the_compass() -> None:
    screen = Frame(is_left_handed=True, is_degrees=True, is_compass=True)  # x to the east, y to the south
    assert screen.vector(0.0, -1.0) == (0.0, 1.0)
    assert screen.yaw_rad(0.0) == pytest.approx(np.pi / 2)


def test_arrays_keep_their_shape() -> None:
    values = np.array([10.0, 350.0])
    assert CARLA.yaw_rad(values) == pytest.approx(np.radians([-10.0, 10.0]))
    assert CARLA.vector(values, values)[1].shape == (2,)


@pytest.mark.parametrize(("yaw_rad", "expected"), [(0.0, (11.4, 20.5)), (np.pi / 2, (9.5, 21.4)), (np.pi, (8.6, 19.5))])
def test_a_box_centre_lies_ahead_of_the_rear_axle(yaw_rad: float, expected: tuple[float, float]) -> None:
    assert box_centre(10.0, 20.0, yaw_rad, 1.4, 0.5) == pytest.approx(expected)


def test_a_turn_about_the_rear_axle_moves_the_centre_only() -> None:
    """The velocity of the centre across the heading is the yaw rate times its lead, as for any rigid body."""
    step_rad = 1e-6
    centres = [box_centre(0.0, 0.0, yaw, 1.4) for yaw in (0.3, 0.3 + step_rad)]
    moved = np.subtract(centres[1], centres[0]) / step_rad
    assert moved == pytest.approx([-1.4 * np.sin(0.3), 1.4 * np.cos(0.3)], abs=1e-5)


def test_extents_are_full() -> None:
    assert full_extents(2.45, 1.0, 0.75) == (4.9, 2.0, 1.5)
