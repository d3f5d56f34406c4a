"""The semantic view: each class and channel where the map and the recorded state have it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.reference_impl.rendering.stage_set import CAR, moved, snapshot, straight_town

from branchdrive.contract.camera import TopDownCamera
from branchdrive.contract.semantic_bev import ROUTE_WIDTH_M, SemanticChannel, SemanticClass, classes_of
from branchdrive.driving.projection import ground_of_pixels
from branchdrive_reference.rendering.patch import Tile
from branchdrive_reference.rendering.rig import cameras_of
from branchdrive_reference.rendering.semantic import SemanticView
from branchdrive_reference.rendering.snapshot import Snapshot

(BEV,) = (camera for camera in cameras_of(("semantic_bev",)) if isinstance(camera, TopDownCamera))
_TOWN = straight_town()
_ROWS, _COLUMNS = np.mgrid[:256, :256]
AHEAD_M, LEFT_M = ground_of_pixels(BEV, _ROWS + 0.5, _COLUMNS + 0.5)
"""What the centre of each pixel looks at, in the ego's frame."""


def drawn(state: Snapshot) -> np.ndarray:
    return SemanticView(BEV).draw(_TOWN.patch(Tile.of(state.x_m, state.y_m)), state)


def beyond_box(ahead_m: float, left_m: float, yaw_rad: float, extents: tuple[float, ...]) -> np.ndarray:
    """How far the centre of each pixel lies outside a box along its worse axis; negative inside."""
    x, y = AHEAD_M - ahead_m, LEFT_M - left_m
    along, across = math.cos(yaw_rad) * x + math.sin(yaw_rad) * y, math.cos(yaw_rad) * y - math.sin(yaw_rad) * x
    return np.maximum(np.abs(along) - extents[0] / 2, np.abs(across) - extents[1] / 2)


@pytest.mark.parametrize("pose", [(20.0, 0.0, 0.0), (-30.3, 12.4, 1.0), (40.1, -22.2, -2.2), (5.2, 3.6, math.pi)])
def test_a_vehicle_covers_the_pixels_whose_centres_lie_in_its_box(pose: tuple[float, float, float]) -> None:
    ahead_m, left_m, yaw_rad = pose
    view = drawn(snapshot([("vehicle", ahead_m, left_m - 1.75, yaw_rad)]))
    covered = (view & SemanticChannel.OTHER_VEHICLE) != 0
    outside_m = beyond_box(ahead_m, left_m, yaw_rad, CAR)
    assert covered[outside_m < -0.3].all()
    assert not covered[outside_m > 0.3].any()
    assert covered.sum() == pytest.approx((outside_m < 0).sum(), rel=0.25)
    np.testing.assert_array_equal(covered & (classes_of(view) != SemanticClass.VEHICLE), False)


def test_the_ego_is_in_the_middle_with_the_class_of_a_vehicle() -> None:
    view = drawn(snapshot())
    ego = (view & SemanticChannel.EGO) != 0
    assert ego[beyond_box(0, 0, 0, (4.7, 1.9)) < -0.3].all()
    np.testing.assert_array_equal(ego, classes_of(view) == SemanticClass.VEHICLE)
    assert not ((view & SemanticChannel.OTHER_VEHICLE) != 0).any()


def test_people_are_seen_however_thin_they_are_and_lie_above_vehicles() -> None:
    view = drawn(
        snapshot([("pedestrian", 10.1, 7.3, 0.0), ("vehicle", 20.0, 0.0, 0.0), ("pedestrian", 20.0, 0.0, 0.0)])
    )
    rows, columns = np.nonzero(classes_of(view) == SemanticClass.PEDESTRIAN)
    places = np.stack([AHEAD_M[rows, columns], LEFT_M[rows, columns]], axis=1)
    for ahead_m, left_m in ((10.1, 9.05), (20.0, 1.75)):
        assert np.abs(places - [ahead_m, left_m]).max(axis=1).min() < 0.55


def test_static_objects_have_no_class() -> None:
    np.testing.assert_array_equal(drawn(snapshot([("static", 10.0, -1.75, 0.0)])), drawn(snapshot()))


def test_cycles_are_vehicles() -> None:
    view = drawn(snapshot([("cycle", 10.25, -1.5, 0.0)]))
    assert ((view & SemanticChannel.OTHER_VEHICLE) != 0).any()


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.0])
def test_the_road_is_drivable_and_the_rest_is_not(yaw_rad: float) -> None:
    view = drawn(moved(snapshot(), yaw_rad=yaw_rad))
    across = math.sin(yaw_rad) * AHEAD_M + math.cos(yaw_rad) * LEFT_M - 1.75
    drivable = (view & SemanticChannel.DRIVABLE_AREA) != 0
    assert drivable[np.abs(across) < 3.1].all()
    assert not drivable[np.abs(across) > 3.9].any()
    assert (classes_of(view)[np.abs(across) > 6.5] == SemanticClass.NOTHING).all()
    assert set(np.unique(classes_of(view)[drivable])) >= {SemanticClass.ROAD, SemanticClass.LANE_MARKING}


@pytest.mark.parametrize("yaw_rad", [0.0, 0.013, 0.4, 1.1])
def test_lines_are_unbroken_where_the_paint_is(yaw_rad: float) -> None:
    view = drawn(moved(snapshot(), yaw_rad=yaw_rad))
    across = math.sin(yaw_rad) * AHEAD_M + math.cos(yaw_rad) * LEFT_M - 1.75
    along = math.cos(yaw_rad) * AHEAD_M - math.sin(yaw_rad) * LEFT_M
    marked = (classes_of(view) == SemanticClass.LANE_MARKING) & (np.abs(across) < 0.6)
    for place_m in (*np.arange(-55.0, -3.0, 0.5), *np.arange(3.0, 55.0, 0.5)):  # the ego may cover what lies between
        assert (marked & (np.abs(along - place_m) < 0.5)).any()


def test_the_rest_of_the_route_begins_at_the_ego() -> None:
    view = drawn(snapshot())
    route = (view & SemanticChannel.REMAINING_ROUTE) != 0
    assert route[(np.abs(LEFT_M) < 0.7) & (AHEAD_M > 0.6)].all()
    assert not route[(np.abs(LEFT_M) > 1.4) | (AHEAD_M < -1.4)].any()


@pytest.mark.parametrize("heading_rad", [0.0, 0.3, 0.8, 1.2, 2.5])
def test_the_route_is_a_band_of_its_width(heading_rad: float) -> None:
    """Straight on and round bends, as its area says it."""
    steps = np.concatenate([np.full(20, heading_rad), heading_rad + np.linspace(0.0, 1.0, 20)])
    places = np.cumsum(2.0 * np.stack([np.cos(steps), np.sin(steps)], axis=1), axis=0) - (0.0, 1.75)
    view = drawn(moved(snapshot(), route_m=np.concatenate([[[0.0, -1.75]], places])))
    route = ((view & SemanticChannel.REMAINING_ROUTE) != 0) & (np.hypot(AHEAD_M, LEFT_M) < 50.0)
    ways = np.hypot(places[:, 0], places[:, 1] + 1.75)
    assert route.sum() / BEV.px_per_m**2 / (2.0 * (ways < 50.0).sum()) == pytest.approx(ROUTE_WIDTH_M, rel=0.1)


@pytest.mark.parametrize(
    ("light", "kind"),
    [("red", SemanticClass.RED_LIGHT), ("yellow", SemanticClass.YELLOW_LIGHT), ("green", SemanticClass.GREEN_LIGHT)],
)
def test_the_light_stands_at_its_signal_and_its_line(light: str, kind: SemanticClass) -> None:
    lit = classes_of(drawn(snapshot(light=light))) == kind
    assert lit[np.hypot(AHEAD_M - 30.0, LEFT_M + 3.25) < 0.7].all()
    assert lit[(np.abs(AHEAD_M - 30.0) < 0.3) & (np.abs(LEFT_M) < 1.2)].all()
    assert not lit[np.hypot(AHEAD_M - 30.0, LEFT_M + 1.0) > 4.5].any()
    assert not np.isin(classes_of(drawn(snapshot())), list(SemanticClass)[5:8]).any()


def test_a_stop_sign_is_where_it_stands() -> None:
    sign = classes_of(drawn(snapshot())) == SemanticClass.STOP_SIGN
    assert sign[np.hypot(AHEAD_M + 30.0, LEFT_M - 6.75) < 0.7].all()
    assert not sign[np.hypot(AHEAD_M + 30.0, LEFT_M - 6.75) > 1.8].any()
