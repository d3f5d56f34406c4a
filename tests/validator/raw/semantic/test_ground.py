"""Which pixels of a semantic map lie off the route: against a search through all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive.contract.camera import TopDownCamera
from branchdrive.contract.semantic_bev import SemanticChannel
from branchdrive.raw.semantic.frame import SemanticFrame
from branchdrive.raw.semantic.ground import _off_route

ROUTE = np.uint8(SemanticChannel.REMAINING_ROUTE)
REACH_M, RANGE_M, SLACK_PX = 5.0, 50.0, 2
HEIGHT, WIDTH = 70, 90


def frame(px_per_m: float) -> SemanticFrame:
    camera = TopDownCamera(
        name="bev", stream="semantic_bev", width_px=WIDTH, height_px=HEIGHT, px_per_m=px_per_m, origin_row_px=40.0,
        origin_column_px=45.5,
    )  # fmt: skip
    return SemanticFrame(camera, 0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("px_per_m", [0.3, 0.7, 1.0, 2.0, 3.3, 10.0])
def test_pixels_off_the_route_are_found(px_per_m: float) -> None:
    rng = np.random.default_rng(int(10 * px_per_m))
    reach = max(int(REACH_M * px_per_m), SLACK_PX)
    outcomes = set()
    for _ in range(60):
        rows, columns = rng.integers(-15, (HEIGHT + 15, WIDTH + 15), (rng.integers(0, 6), 2)).T
        own = [
            rng.integers((max(row - reach, 0), max(column - reach, 0)), (row + reach + 1, column + reach + 1))
            for row, column in zip(rows, columns, strict=True)
            if row + reach > 0 and column + reach > 0
        ]
        own += [rng.integers(0, (HEIGHT, WIDTH)) for _ in range(rng.integers(0, 2))]
        pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
        for row, column in own:
            if row < HEIGHT and column < WIDTH:
                pixels[row, column] = ROUTE
        expected = [
            (row, column)
            for row, column in np.argwhere(pixels)
            if np.hypot(40.0 - row - 0.5, 45.5 - column - 0.5) / px_per_m < RANGE_M - SLACK_PX / px_per_m
            and not ((np.abs(rows - row) <= reach) & (np.abs(columns - column) <= reach)).any()
        ]
        found = _off_route(frame(px_per_m), pixels.shape, *np.nonzero(pixels), rows, columns)
        assert found == (expected[0] if expected else None)
        outcomes.add(found is None)
    assert outcomes == {True, False}
