"""Signals and signs: the ego's signal shows the recorded state, and no two kinds look alike."""

from __future__ import annotations

from dataclasses import replace

import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from tests.reference_impl.drawing.invented import scene_of, write_invented

from branchdrive_reference.drawing.legend import draw_legend
from branchdrive_reference.drawing.scene import DrawnScene
from branchdrive_reference.drawing.signs import draw_signs
from branchdrive_reference.drawing.view import View
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.elements import town_elements
from branchdrive_reference.town.lane import Lane, Turn
from branchdrive_reference.town.town import TOWN_NAMES, town

NETWORK = town(TOWN_NAMES[0])
NAMES = {Control.SIGNAL: "signal (state unknown)", Control.STOP: "stop sign", Control.YIELD: "give-way sign"}
HALF_M = 60.0


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> DrawnScene:
    return scene_of(write_invented(tmp_path_factory.mktemp("invented") / "d"))


def arriving(junction: str) -> list[Lane]:
    """Lanes that end at the control of a junction."""
    lanes = [lane for lane in NETWORK.lanes.values() if lane.junction == junction and lane.turn is Turn.FOLLOW]
    is_signal = NETWORK.junctions[junction].control is Control.SIGNAL
    return [lane for lane in lanes if is_signal or lane.way[0] not in NETWORK.junctions[junction].major]


def around(junction: str) -> View:
    centre = NETWORK.junctions[junction]
    return View(centre.x_m, centre.y_m, 0.4, (-HALF_M, HALF_M), (-HALF_M, HALF_M))


def controlled(control: Control) -> str:
    return next(name for name, junction in NETWORK.junctions.items() if junction.control is control)


def drawn(scene: DrawnScene, junction: str) -> dict[str, dict[str, object]]:
    axes = Figure().add_axes((0, 0, 1, 1))
    mapped = replace(scene, elements=town_elements(NETWORK))
    return {name: dict(post) for name, post in draw_signs(axes, around(junction), mapped).items()}


@pytest.mark.parametrize("control", Control)
def test_signs_are_those_of_the_junctions_in_view(scene: DrawnScene, control: Control) -> None:
    junction = controlled(control)
    assert set(drawn(scene, junction)) == ({NAMES[control]} if arriving(junction) else set())


@pytest.mark.parametrize("state", ["red", "yellow", "green"])
def test_the_signal_of_the_ego_has_its_colour_and_its_name(scene: DrawnScene, state: str) -> None:
    junction = controlled(Control.SIGNAL)
    lane = arriving(junction)[0]
    posts = drawn(replace(scene, lane_id=lane.lane_id, traffic_light=state), junction)
    assert set(posts) == {f"ego's signal ({state})", NAMES[Control.SIGNAL]}
    red, green, blue = to_rgb(posts[f"ego's signal ({state})"]["color"])  # type: ignore[arg-type]
    assert max(red, green) > 0.6 > 0.4 > blue
    assert (red > 0.6, green > 0.6) == (state != "green", state != "red")
    assert posts[NAMES[Control.SIGNAL]]["color"] != posts[f"ego's signal ({state})"]["color"]


@pytest.mark.parametrize("state", [None, "blue"])
def test_a_signal_without_known_state_has_none(scene: DrawnScene, state: str | None) -> None:
    junction = controlled(Control.SIGNAL)
    posts = drawn(replace(scene, lane_id=arriving(junction)[0].lane_id, traffic_light=state), junction)
    assert set(posts) == {NAMES[Control.SIGNAL]}


def test_a_stop_sign_is_no_red_signal(scene: DrawnScene) -> None:
    signal, stop = controlled(Control.SIGNAL), controlled(Control.STOP)
    red = replace(scene, lane_id=arriving(signal)[0].lane_id, traffic_light="red")
    post, sign = drawn(red, signal)["ego's signal (red)"], drawn(red, stop)["stop sign"]
    assert sign["marker"] == (8, 0, 22.5) != post["marker"]
    assert sign["markersize"] > 1.5 * post["markersize"]  # type: ignore[operator]


def test_the_legend_names_what_was_drawn(scene: DrawnScene) -> None:
    junction = controlled(Control.SIGNAL)
    posts = drawn(replace(scene, lane_id=arriving(junction)[0].lane_id, traffic_light="red"), junction)
    figure = Figure()
    draw_legend(figure, scene, posts, (0.0, 0.1))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert set(posts) <= set(texts)
    ends = "rollout ends before +6.5 s"
    assert (ends in texts) == any(candidate.ends_early for candidate in scene.candidates)
