"""The panels beside the map: touches at gap 0, rollouts that end early, and what the table claims."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tests.reference_impl.drawing.invented import scene_of, write_invented

from branchdrive_reference.drawing.futures import CONTACT_MARKER, END_MARKER
from branchdrive_reference.drawing.legend import draw_outcomes, draw_separation, draw_speed
from branchdrive_reference.drawing.palette import candidate_colours
from branchdrive_reference.drawing.scene import HORIZON_TICKS, Candidate, DrawnScene


def driven(like: Candidate, last_tick: int, touch_tick: int | None = None) -> Candidate:
    """A candidate 3.5 m away from everything at 7 m/s, which may touch something all the same."""
    tick = np.arange(-80, last_tick + 1, 5)
    still = np.zeros(len(tick))
    return Candidate(like.policy, tick, still, still, still, still + 7.0, still + 3.5, tick == touch_tick)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> DrawnScene:
    """Three candidates: one that lasts, one that ends early, and one that touches something and ends early."""
    invented = scene_of(write_invented(tmp_path_factory.mktemp("invented") / "d"))
    nominal, ending, touching = invented.candidates[:3]
    candidates = (driven(nominal, HORIZON_TICKS), driven(ending, 65), driven(touching, 90, 40))
    return replace(invented, candidates=candidates)


def marks(axes: Axes, marker: object) -> list[tuple[float, float]]:
    lines = [line for line in axes.lines if line.get_marker() == marker]
    places = [np.stack([line.get_xdata(), line.get_ydata()], axis=1) for line in lines]
    return [(float(x), float(y)) for x, y in np.concatenate(places)]


def test_a_touch_lies_at_gap_0_and_on_the_speed(scene: DrawnScene) -> None:
    gaps, speeds = (Figure().add_subplot() for _ in range(2))
    draw_separation(gaps, scene, candidate_colours(scene.bank))
    draw_speed(speeds, scene, candidate_colours(scene.bank))
    assert marks(gaps, CONTACT_MARKER["marker"]) == [(2.0, 0.0)]
    assert marks(speeds, CONTACT_MARKER["marker"]) == [(2.0, 7.0)]


def test_curves_that_end_early_have_an_end(scene: DrawnScene) -> None:
    axes = Figure().add_subplot()
    draw_separation(axes, scene, candidate_colours(scene.bank))
    assert marks(axes, END_MARKER["marker"]) == [(3.25, 3.5), (4.5, 3.5)]


def test_the_table_claims_no_more_than_was_recorded(scene: DrawnScene) -> None:
    axes = Figure().add_subplot()
    draw_outcomes(axes, scene, candidate_colours(scene.bank))
    rows: dict[float, list[str]] = {}
    for text in axes.texts:
        rows.setdefault(text.get_position()[1], []).append(text.get_text())
    _, nominal, ending, touching = (rows[height] for height in sorted(rows, reverse=True))
    assert nominal[1:] == ["3.5 m", "7.0 m/s", "none"]
    assert ending[1:] == ["3.5 m", "7.0 m/s", "none (to +3.25 s)"]
    assert touching[1:] == ["0.0 m", "7.0 m/s", "+2.00 s"]
