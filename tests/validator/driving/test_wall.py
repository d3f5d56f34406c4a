"""Parts of walls inside of boxes, against points sampled along every wall."""

from __future__ import annotations

import numpy as np

from branchdrive.contract.limits import spec_limits
from branchdrive.driving.box import Boxes
from branchdrive.driving.surface import Work
from branchdrive.driving.wall import Walls

NUM_SAMPLES = 4001

SQUARES, PAIRS = spec_limits().max_map_squares, spec_limits().max_map_pairs


def _inside(walls: list[np.ndarray], boxes: Boxes, *, reach_m: float) -> dict[tuple[int, int], list[float]]:
    """Points inside each box, of each wall that reaches into it: x and y of the middle of every part."""
    lengths = np.array([len(wall) for wall in walls])
    x, y = np.concatenate(walls).T
    filed = Walls(np.zeros(len(walls), np.int64), lengths, x, y, reach_m=reach_m, most_squares=SQUARES)
    found: dict[tuple[int, int], list[float]] = {}
    for part in filed.inside(np.zeros(len(boxes.x_m), np.int64), boxes, Work(PAIRS)):
        for box, wall, *middle in zip(*(values.tolist() for values in part), strict=True):
            found.setdefault((box, wall), []).extend(middle)
    return found


def _boxes(*rows: tuple[float, ...]) -> Boxes:
    return Boxes(*np.array(rows, float).T)


def test_walls_reach_into_the_boxes_that_hold_some_of_their_points() -> None:
    rng = np.random.default_rng(3)
    starts = rng.uniform(-30, 30, (40, 1, 2))
    walls = list(starts + rng.uniform(-9, 9, (40, 3, 2)))
    boxes = Boxes(*rng.uniform(-30, 30, (2, 60)), rng.uniform(-np.pi, np.pi, 60), np.full(60, 4.7), np.full(60, 1.9))
    expected = set()
    for number, wall in enumerate(walls):
        share = np.linspace(0, 2, NUM_SAMPLES)
        x, y = (np.interp(share, [0, 1, 2], wall[:, axis]) for axis in (0, 1))
        dx, dy = x - boxes.x_m[:, None], y - boxes.y_m[:, None]
        cos, sin = np.cos(boxes.yaw_rad)[:, None], np.sin(boxes.yaw_rad)[:, None]
        ahead, left = np.abs(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
        expected |= {(int(box), number) for box in np.flatnonzero(((ahead < 2.35) & (left < 0.95)).any(axis=1))}

    found = _inside(walls, boxes, reach_m=2.6)
    assert len(expected) > 20
    assert found.keys() >= expected
    assert len(found.keys() - expected) <= 2  # shorter than the samples are apart
    for (box, _), middles in found.items():
        x, y = np.reshape(middles, (-1, 2)).T
        assert (np.hypot(x - boxes.x_m[box], y - boxes.y_m[box]) <= 2.6).all()


def test_the_part_inside_is_described_by_its_middle() -> None:
    found = _inside([np.array([[-10.0, 0.5], [1.0, 0.5]])], _boxes((0, 0, 0, 4, 2)), reach_m=3.0)
    assert found == {(0, 0): [-0.5, 0.5]}


def test_walls_along_a_side_are_outside_and_walls_within_are_inside() -> None:
    box = _boxes((0, 0, 0, 4, 2))
    assert not _inside([np.array([[-1.0, 1.0], [1.0, 1.0]])], box, reach_m=3.0)
    assert not _inside([np.array([[2.0, -1.0], [2.0, 1.0]])], box, reach_m=3.0)
    assert _inside([np.array([[-1.0, 0.0], [1.0, 0.0]])], box, reach_m=3.0).keys() == {(0, 0)}


def test_boxes_of_other_towns_meet_no_wall() -> None:
    filed = Walls(np.array([1]), np.array([2]), np.array([-1.0, 1.0]), np.zeros(2), reach_m=3.0, most_squares=SQUARES)
    assert not [part for part in filed.inside(np.array([0]), _boxes((0, 0, 0, 4, 2)), Work(PAIRS)) if len(part.box)]
