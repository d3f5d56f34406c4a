"""Time to draw the images of an observation, on one core: six views around the ego, and the semantic view.

Places lie on the lanes of a town, each with sixteen vehicles and four pedestrians around the ego. The ground of a
place is loaded before the clock starts: a drive comes to a new one every few seconds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from benchmarks.row import Row
from branchdrive_reference.rendering.encoding import encoded
from branchdrive_reference.rendering.patch import Town
from branchdrive_reference.rendering.renderer import Renderer
from branchdrive_reference.rendering.rig import cameras_of
from branchdrive_reference.rendering.snapshot import Actors, Snapshot
from branchdrive_reference.town.elements import town_elements
from branchdrive_reference.town.town import TOWN_NAMES, town

__all__ = ["measure_ms", "rows"]

_NUM_PLACES, _NUM_VEHICLES, _NUM_PEDESTRIANS = 3, 16, 4
_REPEATS = 30


def _places() -> list[Snapshot]:
    """States at the middles of some lanes, with others on a grid around the ego."""
    lanes = [one for one in town_elements(town(TOWN_NAMES[0])) if one["kind"] == "lane" and len(one["x_m"]) > 2]
    chosen = [lanes[index] for index in np.linspace(0, len(lanes) - 1, _NUM_PLACES).astype(int)]
    return [_state(float(lane["x_m"][1]), float(lane["y_m"][1]), yaw) for yaw, lane in enumerate(chosen)]


def _state(x_m: float, y_m: float, yaw_rad: float) -> Snapshot:
    count = _NUM_VEHICLES + _NUM_PEDESTRIANS
    number = np.arange(count)
    turn, reach_m = 2.4 * number, 8.0 + 2.5 * number  # a spiral fills the place evenly
    classes = np.array(["vehicle"] * _NUM_VEHICLES + ["pedestrian"] * _NUM_PEDESTRIANS, object)
    is_vehicle = classes == "vehicle"
    actors = Actors(
        classes,
        x_m + reach_m * np.cos(turn),
        y_m + reach_m * np.sin(turn),
        np.asarray(0.3 * number),
        np.where(is_vehicle, 4.6, 0.5),
        np.where(is_vehicle, 1.9, 0.6),
        np.where(is_vehicle, 1.5, 1.75),
    )
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    route = np.array([x_m, y_m]) + np.linspace(0, 100, 51)[:, None] * ahead
    return Snapshot(x_m, y_m, yaw_rad, 4.7, 1.9, 1.5, actors, "green", None, route)


def measure_ms(work: Callable[[Snapshot], object], states: Sequence[Snapshot]) -> float:
    """Process milliseconds of some work for one state: the least mean over states, whatever else the machine does."""
    for state in states:
        work(state)
    times_ms = []
    for _ in range(_REPEATS):
        begin_s = time.process_time()
        for state in states:
            work(state)
        times_ms.append(1000 * (time.process_time() - begin_s) / len(states))
    return min(times_ms)


def rows() -> Iterator[Row]:
    """Times against the budget."""
    states, elements = _places(), town_elements(town(TOWN_NAMES[0]))
    for stream, what, bar in (
        ("rgb_surround", "six views 160x90", "<= 3 ms"),
        ("semantic_bev", "semantic view", "<= 0.3 ms"),
    ):
        renderer = Renderer(Town(elements), "clear-noon", cameras_of((stream,)))
        yield Row(f"{what}, drawn, one core", f"{measure_ms(renderer.images, states):.2f} ms", bar)
        images = [image for state in states for image in renderer.images(state).values()]
        begin_s = time.process_time()
        num_bytes = sum(len(encoded(image)) for image in images)
        spent_ms = 1000 * (time.process_time() - begin_s) / len(states)
        yield Row(f"{what}, encoded", f"{spent_ms:.2f} ms, {num_bytes / len(states) / 1000:.1f} kB")
