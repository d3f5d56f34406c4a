"""Images are functions of their own state: equal states give equal bytes, whatever was drawn before."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.rendering.stage_set import moved, snapshot, straight_town

from branchdrive.contract.camera import TopDownCamera
from branchdrive.errors import UsageError
from branchdrive_reference.rendering.encoding import encoded
from branchdrive_reference.rendering.palette import paint_of
from branchdrive_reference.rendering.renderer import Renderer
from branchdrive_reference.rendering.rig import MEDIA_STREAMS, cameras_of

_CAMERAS = cameras_of(MEDIA_STREAMS)
_STATES = [
    snapshot([("vehicle", 12.0, -1.75, 0.1), ("pedestrian", 5.0, 3.0, 0.0)], light="red"),
    snapshot([("cycle", 99.0, 2.0, 3.0)], x_m=90.0, light="green"),
    moved(snapshot(), yaw_rad=1.0),
]


def renderer(environment: str = "clear-noon") -> Renderer:
    return Renderer(straight_town(), environment, _CAMERAS)


def images_bytes(drawing: Renderer, number: int) -> dict[str, bytes]:
    return {name: encoded(image) for name, image in drawing.images(_STATES[number]).items()}


def test_equal_states_give_equal_bytes_in_any_order() -> None:
    one, other = renderer(), renderer()
    forward = [images_bytes(one, number) for number in (0, 1, 2, 0)]
    backward = [images_bytes(other, number) for number in (2, 1, 0)]
    assert forward[3] == forward[0] == backward[2]
    assert forward[1] == backward[1]


def test_every_camera_shows_something_of_its_own() -> None:
    images = list(images_bytes(renderer(), 0).values())
    assert len(set(images)) == len(_CAMERAS) == 8


def test_images_have_the_declared_sizes() -> None:
    images = renderer().images(_STATES[0])
    for camera in _CAMERAS:
        channels = () if camera.stream == "semantic_bev" else (3,)
        assert images[camera.name].shape == (camera.height_px, camera.width_px, *channels)


def test_night_is_darker_and_changes_no_semantic_view() -> None:
    day, night = (renderer(name).images(_STATES[0]) for name in ("clear-noon", "rain-night"))
    assert night["front"].mean() < 0.6 * day["front"].mean()
    np.testing.assert_array_equal(night["bev"], day["bev"])


def test_headlamps_light_what_lies_ahead_at_night_alone() -> None:
    day, fog, night = (renderer(name).images(snapshot())["front"].astype(float) for name in ("noon", "fog", "night"))
    middle, aside = np.s_[60:75, 75:85], np.s_[60:75, 0:10]
    rear = renderer("night").images(snapshot())["rear"].astype(float)
    gains = [
        (image[middle].mean() / image[aside].mean()) / (day[middle].mean() / day[aside].mean())
        for image in (fog, night)
    ]
    assert gains[0] == pytest.approx(1.0, abs=0.1)
    assert gains[1] > 1.3
    assert night[middle].mean() > 1.3 * rear[middle].mean()


def test_lamps_shine_far_at_night() -> None:
    state = snapshot([("vehicle", 45.0, -1.75, 0.0)], light="red")
    red = renderer("night").images(state)["front"].astype(int)
    excess = red[..., 2] - red[..., :2].max(axis=2)
    rows, columns = np.nonzero(excess > 60)
    assert {*(columns < 90)} == {True, False}  # the car ahead, and the signal beside the road
    dark = renderer("night").images(snapshot())["front"].astype(int)
    assert (dark[..., 2] - dark[..., :2].max(axis=2)).max() < 40
    assert rows.max() < 60


def test_a_colour_tells_no_number_of_an_actor() -> None:
    assert paint_of("vehicle", 4.6, 1.9, 1.5) == paint_of("vehicle", 4.6, 1.9, 1.5)
    assert len({paint_of("vehicle", length, 1.9, 1.5) for length in (4.0, 4.3, 4.6, 4.9, 5.2)}) > 1


def test_an_rgb_map_is_not_drawn() -> None:
    flat = TopDownCamera(
        name="top_down", stream="rgb_top_down", width_px=64, height_px=64, px_per_m=1.0, origin_row_px=32.0,
        origin_column_px=32.0,
    )  # fmt: skip
    with pytest.raises(UsageError, match="top_down"):
        Renderer(straight_town(), "clear-noon", [flat])
