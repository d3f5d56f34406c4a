"""The map layer, by its pixels: asphalt where the town's lanes and junctions are, ground elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from branchdrive_reference.drawing.palette import BACKDROP
from branchdrive_reference.drawing.roads import draw_roads, lanes_in_view, town_map
from branchdrive_reference.drawing.view import View
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.town import TOWN_NAMES, town

SIDE_PX, SIDE_M = 600, 120.0


def around(network: RoadNetwork, junction: str, heading_rad: float = 0.4) -> View:
    centre = network.junctions[junction]
    half = SIDE_M / 2
    return View(centre.x_m, centre.y_m, heading_rad, (-half, half), (-half, half))


def rendered(network: RoadNetwork, view: View) -> np.ndarray[Any, Any]:
    figure = Figure(figsize=(6, 6), dpi=SIDE_PX / 6)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=view.u_m, ylim=view.v_m, facecolor=BACKDROP["ground"])
    axes.set_axis_on()
    draw_roads(axes, network, view)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3] / 255


def colours_at(image: np.ndarray[Any, Any], view: View, x_m: Any, y_m: Any) -> np.ndarray[Any, Any]:
    u, v = view.place(np.atleast_1d(x_m), np.atleast_1d(y_m))
    column = ((u - view.u_m[0]) / SIDE_M * SIDE_PX).astype(int)
    row = SIDE_PX - 1 - ((v - view.v_m[0]) / SIDE_M * SIDE_PX).astype(int)
    seen = (column > 5) & (column < SIDE_PX - 5) & (row > 5) & (row < SIDE_PX - 5)
    return image[row[seen], column[seen]]


@pytest.mark.parametrize("name", TOWN_NAMES)
def test_lanes_and_junctions_are_asphalt(name: str) -> None:
    network = town(name)
    junction = next(iter(network.junctions))
    view = around(network, junction)
    image = rendered(network, view)
    for lane in lanes_in_view(network, view):
        at = colours_at(image, view, lane.centre.x_m, lane.centre.y_m)
        assert np.abs(at - BACKDROP["carriageway"]).max(initial=0.0) < 0.01, lane.lane_id
    x, y = network.junctions[junction].x_m, network.junctions[junction].y_m
    assert np.abs(colours_at(image, view, x, y) - BACKDROP["carriageway"]).max() < 0.01


@pytest.mark.parametrize("name", TOWN_NAMES)
def test_land_beside_the_road_is_ground(name: str) -> None:
    network = town(name)
    view = around(network, next(iter(network.junctions)))
    share = (np.abs(rendered(network, view) - BACKDROP["ground"]).max(axis=2) < 0.01).mean()
    assert 0.5 < share < 0.95


def test_an_unknown_town_has_no_map() -> None:
    assert town_map("Town12") is None
    assert [town_map(name) for name in TOWN_NAMES] == [town(name) for name in TOWN_NAMES]
