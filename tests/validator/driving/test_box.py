"""Box gaps: against shapely, against analytic truth, and under symmetries."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.validator.driving.oracle import boxes, gap_m, polygons

from branchdrive.driving.box import Boxes, box_gap

NUM_PAIRS = 3000
TOLERANCE_M = 1e-9


def random_boxes(rng: np.random.Generator, spread_m: float, low_m: float, high_m: float) -> Boxes:
    """Boxes with centres in a square and extents spread evenly in logarithm."""
    extents = np.exp(rng.uniform(np.log(low_m), np.log(high_m), (2, NUM_PAIRS)))
    return Boxes(
        rng.uniform(-spread_m, spread_m, NUM_PAIRS),
        rng.uniform(-spread_m, spread_m, NUM_PAIRS),
        rng.uniform(-math.pi, math.pi, NUM_PAIRS),
        extents[0],
        extents[1],
    )


@pytest.mark.parametrize(
    ("spread_m", "low_m", "high_m"),
    [
        pytest.param(30, 0.5, 15, id="traffic"),
        pytest.param(3, 0.5, 10, id="mostly overlapping"),
        pytest.param(10, 0.001, 30, id="thin"),
        pytest.param(100, 0.1, 100, id="very different sizes"),
    ],
)
def test_gap_is_that_of_the_polygons(spread_m: float, low_m: float, high_m: float) -> None:
    rng = np.random.default_rng(20)
    a, b = (random_boxes(rng, spread_m, low_m, high_m) for _ in range(2))
    np.testing.assert_allclose(box_gap(a, b).gap_m, gap_m(a, b), rtol=0, atol=TOLERANCE_M)


def test_gap_of_parallel_boxes_is_that_of_the_polygons() -> None:
    rng = np.random.default_rng(21)
    a, b = (random_boxes(rng, 20, 1, 10) for _ in range(2))
    turns = rng.integers(0, 4, NUM_PAIRS) * (math.pi / 2)
    a, b = a._replace(yaw_rad=turns * 0 + 0.3), b._replace(yaw_rad=0.3 + turns)
    np.testing.assert_allclose(box_gap(a, b).gap_m, gap_m(a, b), rtol=0, atol=TOLERANCE_M)


SQUARE = (0.0, 0.0, 0.0, 2.0, 2.0)
DIAGONAL = math.sqrt(2)


@dataclass(frozen=True)
class Truth:
    """Two boxes whose gap and direction are known."""

    a: tuple[float, float, float, float, float]
    b: tuple[float, float, float, float, float]
    gap_m: float
    normal: tuple[float, float] = (0.0, 0.0)


ANALYTIC = {
    "side by side": Truth(SQUARE, (5, 0, 0, 2, 2), 3, (1, 0)),
    "behind": Truth(SQUARE, (-4, 0.5, 0, 2, 2), 2, (-1, 0)),
    "to the left": Truth(SQUARE, (0.3, 7, 0, 2, 4), 4, (0, 1)),
    "corner to corner": Truth(SQUARE, (5, 6, 0, 2, 2), 5, (0.6, 0.8)),
    "corner to side": Truth(SQUARE, (4, 0, math.pi / 4, 2, 2), 3 - DIAGONAL, (1, 0)),
    "side to corner": Truth((4, 0, math.pi / 4, 2, 2), SQUARE, 3 - DIAGONAL, (-1, 0)),
    "corner to corner, turned": Truth((0, 0, math.pi / 4, 2, 2), (5, 0, math.pi / 4, 2, 2), 5 - 2 * DIAGONAL, (1, 0)),
    "a quarter turn swaps the extents": Truth(SQUARE, (6, 0, math.pi / 2, 10, 2), 4, (1, 0)),
    "touching sides": Truth(SQUARE, (2, 0, 0, 2, 2), 0),
    "touching corners": Truth(SQUARE, (2, 2, 0, 2, 2), 0),
    "overlapping": Truth(SQUARE, (1.5, 0.5, 0.4, 2, 2), 0),
    "equal": Truth(SQUARE, SQUARE, 0),
    "nested": Truth((0, 0, 0.7, 20, 20), (1, 1, 0.2, 1, 1), 0),
    "nested the other way": Truth((1, 1, 0.2, 1, 1), (0, 0, 0.7, 20, 20), 0),
    "crossing with no corner inside": Truth((0, 0, 0, 20, 1), (0, 0, math.pi / 2, 20, 1), 0),
    "crossing askew with no corner inside": Truth((0, 0, 0.3, 20, 1), (0.5, -0.5, 1.5, 20, 1), 0),
    "almost touching": Truth(SQUARE, (2 + 1e-9, 0, 0, 2, 2), 1e-9, (1, 0)),
}


@each("truth", ANALYTIC.values(), ids=ANALYTIC)
def test_gap_and_direction_are_the_analytic_ones(truth: Truth) -> None:
    found = box_gap(boxes(truth.a), boxes(truth.b))
    assert found.gap_m[0] == pytest.approx(truth.gap_m, abs=1e-12)
    if truth.gap_m == 0:
        assert found.gap_m[0] == 0
    assert (found.normal_x[0], found.normal_y[0]) == pytest.approx(truth.normal, abs=1e-6)


def test_no_pairs_give_no_gaps() -> None:
    found = box_gap(boxes(), boxes())
    assert [len(field) for field in found] == [0, 0, 0]


coordinates = st.floats(-100, 100)
extents = st.floats(0.01, 50)
box_rows = st.tuples(coordinates, coordinates, st.floats(-math.pi, math.pi), extents, extents)


@given(box_rows, box_rows)
def test_exchanging_the_boxes_turns_the_direction_round(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    there, back = box_gap(boxes(a), boxes(b)), box_gap(boxes(b), boxes(a))  # type: ignore[arg-type]
    assert there.gap_m[0] == pytest.approx(back.gap_m[0], abs=TOLERANCE_M)
    if there.gap_m[0] > 1e-6:
        assert there.normal_x[0] == pytest.approx(-back.normal_x[0], abs=1e-6)
        assert there.normal_y[0] == pytest.approx(-back.normal_y[0], abs=1e-6)


@given(box_rows, box_rows, st.floats(-math.pi, math.pi), st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_moving_both_boxes_rigidly_moves_the_direction_alone(
    a: tuple[float, ...], b: tuple[float, ...], turn_rad: float, shift_x_m: float, shift_y_m: float
) -> None:
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)

    def moved(box: Boxes) -> Boxes:
        return box._replace(
            x_m=cos * box.x_m - sin * box.y_m + shift_x_m,
            y_m=sin * box.x_m + cos * box.y_m + shift_y_m,
            yaw_rad=box.yaw_rad + turn_rad,
        )

    pair = boxes(a), boxes(b)  # type: ignore[arg-type]
    before, after = box_gap(*pair), box_gap(*map(moved, pair))
    assert after.gap_m[0] == pytest.approx(before.gap_m[0], abs=1e-8)
    if before.gap_m[0] > 1e-3:
        turned = cos * before.normal_x - sin * before.normal_y, sin * before.normal_x + cos * before.normal_y
        assert after.normal_x[0] == pytest.approx(turned[0][0], abs=1e-4)
        assert after.normal_y[0] == pytest.approx(turned[1][0], abs=1e-4)


def test_half_a_turn_changes_no_box() -> None:
    rng = np.random.default_rng(22)
    a, b = (random_boxes(rng, 20, 0.5, 10) for _ in range(2))
    turned = box_gap(a._replace(yaw_rad=a.yaw_rad + math.pi), b._replace(yaw_rad=b.yaw_rad - math.pi))
    np.testing.assert_allclose(turned.gap_m, box_gap(a, b).gap_m, rtol=0, atol=TOLERANCE_M)


def test_direction_is_a_unit_vector_from_the_first_box_to_the_second() -> None:
    rng = np.random.default_rng(23)
    a, b = (random_boxes(rng, 30, 0.5, 10) for _ in range(2))
    found = box_gap(a, b)
    apart = found.gap_m > 0
    assert apart.sum() > NUM_PAIRS / 2
    np.testing.assert_allclose(np.hypot(found.normal_x, found.normal_y), apart, atol=1e-9)
    # Moved along the direction by the gap, the first box touches the second; moved by less, it does not.
    for share, touches in ((1 - 1e-6, False), (1 + 1e-6, True)):
        step = share * found.gap_m
        near = a._replace(x_m=a.x_m + step * found.normal_x, y_m=a.y_m + step * found.normal_y)
        meets = shapely.intersects(polygons(near), polygons(b))
        assert (meets[apart & (found.gap_m > 0.01)] == touches).all()


@pytest.mark.parametrize("tiny_m", [5e-324, 1e-310, 1e-200])
def test_direction_of_a_vanishing_gap_is_finite(tiny_m: float) -> None:
    found = box_gap(boxes((0, 0, 0, 0, 0)), boxes((tiny_m, 0, 0, 0, 0)))
    assert found.gap_m[0] == tiny_m
    assert (found.normal_x[0], found.normal_y[0]) == (1, 0)
