"""What a map has around a tile, wherever its elements begin and end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from branchdrive_reference.rendering.marking import Pieces, painted_pieces
from branchdrive_reference.rendering.patch import NOTHING, ROAD, SIDEWALK, Patch, Tile, Town

TILE = Tile(0, 0)
ALONG = np.array([0.8, 0.6])
LEFT = np.array([-0.6, 0.8])
MIDDLE_M = np.array([32.0, 32.0])


def element(points_m: Any, **columns: Any) -> dict[str, Any]:
    points = np.asarray(points_m, float)
    return {"element_id": "e", "lane_id": None, "x_m": points[:, 0], "y_m": points[:, 1], **columns}


def line(half_m: float, **columns: Any) -> dict[str, Any]:
    """A straight line through the middle of the tile, oblique to its edges."""
    return element([MIDDLE_M - half_m * ALONG, MIDDLE_M + half_m * ALONG], **columns)


def lane(half_m: float) -> dict[str, Any]:
    return line(half_m, kind="lane", width_m=np.array([3.5, 3.5]), speed_limit_mps=13.9)


def patch_of(*elements: dict[str, Any]) -> Patch:
    return Town(elements).patch(TILE)


@pytest.mark.parametrize("half_m", [5e3, 5e4, 5e6])
def test_a_long_road_lies_where_a_short_one_does(half_m: float) -> None:
    found, expected = patch_of(lane(half_m)).ground, patch_of(lane(500.0)).ground
    assert {*np.unique(expected)} == {NOTHING, ROAD, SIDEWALK}
    assert (found != expected).mean() < 1e-3


def test_a_wide_area_covers_what_lies_in_it() -> None:
    corners = [[-8e3, -6e3], [8e3, 6e3], [8e3 - 60, 6e3 + 80], [-8e3 - 60, -6e3 + 80]]
    patch = patch_of(element(np.asarray(corners) + MIDDLE_M, kind="road_area"))
    rows, columns = np.mgrid[: len(patch.ground), : len(patch.ground)]
    world = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ patch.to_world.T
    aside_m = (world[..., :2] - MIDDLE_M) @ LEFT
    assert (patch.ground[(aside_m > 1) & (aside_m < 99)] == ROAD).all()
    assert (patch.ground[(aside_m < -1) | (aside_m > 101)] == NOTHING).all()


@pytest.mark.parametrize("marking", ["solid", "broken"])
def test_paint_of_a_long_line_is_where_that_of_the_whole_line_is(marking: str) -> None:
    border = line(5e3, kind="lane_border", marking=marking)
    found, whole = patch_of(border).paint, painted_pieces(border)
    assert len(found) < len(whole) / 10
    places = np.arange(-150.0, 150.0, 0.37)
    np.testing.assert_array_equal(_is_painted(found, places), _is_painted(whole, places))


def _is_painted(pieces: Pieces, places_m: np.ndarray) -> np.ndarray:
    """Whether places along the line, from the middle of the tile, lie in a piece."""
    begins, ends = ((end_m - MIDDLE_M) @ ALONG for end_m in (pieces.start_m, pieces.end_m))
    return np.asarray(np.any((begins <= places_m[:, None]) & (places_m[:, None] <= ends), axis=1))


def test_a_line_of_the_longest_positions_takes_few_pieces() -> None:
    patch = patch_of(
        element([[-1e7, -1e7], [1e7, 1e7], [1e7, 0.5e7], [-1e7, -1e7]], kind="lane_border", marking="broken"),
        element([[-1e7, -1e7], [1e7, -1e7], [0, 1e7]], kind="crossing"),
    )
    assert 20 < len(patch.paint) < 1000


def test_a_line_that_comes_back_is_there_twice() -> None:
    there_and_back = element([[-9e3, 10], [9e3, 10], [9e3, 50], [-9e3, 50]], kind="kerb")
    lines = patch_of(there_and_back).elements
    assert [{float(y) for y in one["y_m"].round(9)} for one in lines] == [{10.0}, {50.0}]
    assert all(one["x_m"].min() < -148 and one["x_m"].max() > 212 for one in lines)


def test_a_long_line_that_passes_by_is_left_out() -> None:
    assert patch_of(element([[-9e3, 0], [0, 9e3]], kind="kerb")).elements == ()
