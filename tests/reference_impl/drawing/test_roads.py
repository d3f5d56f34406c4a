"""The map layer, by its pixels: asphalt where the town's lanes and junctions are, ground elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from branchdrive_reference.drawing.palette import BACKDROP
from branchdrive_reference.drawing.roads import draw_roads, elements_in_view
from branchdrive_reference.drawing.view import View
from branchdrive_reference.town.elements import town_elements
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
    draw_roads(axes, town_elements(network), view)
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
    lanes = [element for element in elements_in_view(town_elements(network), view) if element["kind"] == "lane"]
    assert lanes
    for element in lanes:
        centre = network.lanes[element["lane_id"]].centre
        at = colours_at(image, view, centre.x_m, centre.y_m)
        assert np.abs(at - BACKDROP["carriageway"]).max(initial=0.0) < 0.01, element["lane_id"]
    x, y = network.junctions[junction].x_m, network.junctions[junction].y_m
    assert np.abs(colours_at(image, view, x, y) - BACKDROP["carriageway"]).max() < 0.01


@pytest.mark.parametrize("name", TOWN_NAMES)
def test_land_beside_the_road_is_ground(name: str) -> None:
    network = town(name)
    view = around(network, next(iter(network.junctions)))
    share = (np.abs(rendered(network, view) - BACKDROP["ground"]).max(axis=2) < 0.01).mean()
    assert 0.5 < share < 0.95


ROAD: dict[str, Any] = {
    "element_id": "a", "kind": "lane", "lane_id": "a", "x_m": np.array([-50.0, 50.0]), "y_m": np.zeros(2),
    "width_m": np.array([4.0, 8.0]), "marking": None,
}  # fmt: skip
VIEW = View(0.0, 0.0, 0.0, (-SIDE_M / 2, SIDE_M / 2), (-SIDE_M / 2, SIDE_M / 2))


def drawn(*elements: dict[str, Any]) -> np.ndarray[Any, Any]:
    figure = Figure(figsize=(6, 6), dpi=SIDE_PX / 6)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=VIEW.u_m, ylim=VIEW.v_m, facecolor=BACKDROP["ground"])
    draw_roads(axes, elements, VIEW)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3] / 255


def test_a_lane_of_growing_width_is_as_wide_as_the_map_says() -> None:
    image = drawn(ROAD)
    places = np.array([[-30.0, 2.0], [-30.0, 3.2], [30.0, 3.2], [30.0, 4.2]])
    colours = [colours_at(image, VIEW, x, y)[0] for x, y in places]
    is_road = [np.abs(colour - BACKDROP["carriageway"]).max() < 0.02 for colour in colours]
    assert is_road == [True, False, True, False]


@pytest.mark.parametrize(("kind", "colour"), [("wall", "ink"), ("kerb", "kerb")])
def test_walls_and_kerbs_are_lines_of_their_own(kind: str, colour: str) -> None:
    line = {**ROAD, "kind": kind, "y_m": np.full(2, 20.0), "width_m": None}
    strip = drawn(line)[SIDE_PX // 2 - 104 : SIDE_PX // 2 - 96, SIDE_PX // 2]
    assert (np.abs(strip - BACKDROP[colour]).max(axis=1) < 0.1).any()


def test_a_marking_that_nobody_declares_is_an_edge() -> None:
    border = {**ROAD, "kind": "lane_border", "width_m": None}
    assert (drawn({**border, "marking": "purple"}) == drawn(border)).all()
