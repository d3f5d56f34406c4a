"""Paths for kernels agree with the exact polyline, whatever the hint on the same bend."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.each import each
from tests.reference_impl.geometry.paths import path_of

from branchdrive_reference.geometry.polyline import bezier, interpolate, locate, project

LINE = bezier(np.array([0.0, 40.0, 60.0, 60.0]), np.array([0.0, 0.0, 15.0, 60.0]), 90)
PATH = path_of(LINE)


@each("hint", [0, 30, 89, 500])
@each("offset_m", [-6.0, -1.0, 0.0, 2.5, 6.0])
def test_projection_finds_the_nearest_foot_point(hint: int, offset_m: float) -> None:
    for arc_m in np.linspace(1.0, LINE.length_m - 1.0, 23):
        x, y, _ = interpolate(PATH, arc_m, offset_m)
        truth = LINE.position(np.array([x]), np.array([y]))
        arc, offset, segment = project(PATH, x, y, hint)
        assert math.isclose(arc, truth.progress_m[0], abs_tol=1e-9)
        assert math.isclose(offset, truth.offset_m[0], abs_tol=1e-9)
        assert segment == locate(PATH, arc)


def test_interpolation_undoes_projection() -> None:
    for arc_m in np.linspace(0.0, LINE.length_m, 17):
        x, y, tangent = interpolate(PATH, arc_m, 0.0)
        assert project(PATH, x, y, 0)[0] == pytest.approx(arc_m, abs=1e-9)
        assert -0.01 <= tangent <= math.pi / 2 + 0.01


def test_arc_length_zero_may_lie_inside_the_path() -> None:
    shifted = path_of(LINE, arc_zero_m=25.0)
    assert interpolate(shifted, -25.0, 0.0)[:2] == (0.0, 0.0)
    assert locate(shifted, -25.0) == 0
    assert project(shifted, 0.0, 0.0, 40)[0] == -25.0


def test_ends_go_on_straight() -> None:
    x, y, _ = interpolate(PATH, LINE.length_m + 10.0, 0.0)
    assert math.hypot(x - LINE.x_m[-1], y - LINE.y_m[-1]) == pytest.approx(10.0)
