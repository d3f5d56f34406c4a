"""Ego history in the frame of the nominal: analytic drives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from branchdrive.contract.columns import TICK_TABLES
from branchdrive.leakage.replays import AVAILABILITY_NAMES, EGO_NAMES, ego_frames

Array = NDArray[np.float64]
TIME_S = np.arange(-16, 1) * 0.25


def drive(
    heading_rad: float, speed_mps: Array, x_m: float = 0.0, y_m: float = 0.0
) -> tuple[Array, Array, Array, Array]:
    """A straight drive that ends at a place, one group and one action."""
    way = np.concatenate([np.cumsum(speed_mps[::-1] * -0.25)[::-1][1:], [0.0]])
    fields = x_m + np.cos(heading_rad) * way, y_m + np.sin(heading_rad) * way, np.full(17, heading_rad), speed_mps
    x, y, yaw, speed = (field[None, None] for field in fields)
    return x, y, yaw, speed


def column(frames: Array, name: str) -> Array:
    return np.asarray(frames[0, 0, :, EGO_NAMES.index(name)])


def test_every_table_of_ticks_has_a_share() -> None:
    assert sorted(AVAILABILITY_NAMES) == sorted(TICK_TABLES)


def test_a_replay_that_ends_beside_its_nominal_keeps_the_offset() -> None:
    frames = ego_frames(*drive(np.pi / 2, np.full(17, 8.0), x_m=-1.5, y_m=20.0), [[0.0, 20.0, np.pi / 2]])
    np.testing.assert_allclose(column(frames, "x_m"), 8.0 * TIME_S[1:], atol=1e-12)
    np.testing.assert_allclose(column(frames, "y_m"), 1.5, atol=1e-12)
    for name in ("yaw_rad", "accel_mps2", "yaw_rate_radps"):
        np.testing.assert_allclose(column(frames, name), 0.0, atol=1e-12)


def test_accelerations_are_backward_differences() -> None:
    frames = ego_frames(*drive(0.0, 10.0 + 2.0 * TIME_S), [[0.0, 0.0, 0.0]])
    np.testing.assert_allclose(column(frames, "accel_mps2"), 2.0)
    np.testing.assert_allclose(column(frames, "speed_mps"), 10.0 + 2.0 * TIME_S[1:])


def test_headings_wrap() -> None:
    x, y, _, speed = drive(0.0, np.full(17, 5.0))
    yaw = np.angle(np.exp(1j * (np.pi + 0.4 * TIME_S)))[None, None]
    frames = ego_frames(x, y, yaw, speed, [[0.0, 0.0, -np.pi]])
    np.testing.assert_allclose(column(frames, "yaw_rate_radps"), 0.4)
    np.testing.assert_allclose(column(frames, "yaw_rad"), 0.4 * TIME_S[1:], atol=1e-12)


def test_a_missing_observation_is_missing_where_it_is_needed() -> None:
    x, y, yaw, speed = (np.array(field) for field in drive(0.0, np.full(17, 5.0)))
    for field in (x, y, yaw, speed):
        field[0, 0, 4] = np.nan
    frames = ego_frames(x, y, yaw, speed, [[0.0, 0.0, 0.0]])
    missing = {name: np.flatnonzero(np.isnan(column(frames, name))).tolist() for name in EGO_NAMES}
    assert missing == {name: [3] if name in EGO_NAMES[:4] else [3, 4] for name in EGO_NAMES}


@pytest.mark.parametrize(("shape", "pose"), [((1, 1, 16), (1, 3)), ((1, 17), (1, 3)), ((1, 1, 17), (2, 3))])
def test_wrong_shapes_are_refused(shape: tuple[int, ...], pose: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="shape"):
        ego_frames(*(np.zeros(shape) for _ in range(4)), np.zeros(pose))


@pytest.mark.parametrize("value", [np.inf, 1e308, -1e308])
def test_what_is_out_of_range_is_missing_or_finite(value: float) -> None:
    x, y, yaw, speed = (np.array(field) for field in drive(0.0, np.full(17, 5.0)))
    x[0, 0, 3], y[0, 0, 3], speed[0, 0, 3], speed[0, 0, 4] = value, -value, value, -value
    frames = ego_frames(x, y, yaw, speed, [[-value, 0.0, 1.0]])
    assert not np.isinf(frames).any()
