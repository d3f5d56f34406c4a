"""When effects begin is found to a quarter of a tick, whatever the commands are, early and late alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.pilot.onset import ONSET_TICKS, fitted_onset

Array = NDArray[np.float64]
Shape = Callable[[Array, float], Array]

AT_BRANCH = int(np.flatnonzero(ONSET_TICKS == 0)[0])

SHAPES: dict[str, Shape] = {
    "the nominal drives on": lambda ticks, size: np.where(ticks >= 0, size, 0.0),
    "the nominal brakes and eases": lambda ticks, size: np.where(ticks >= 0, size * np.exp(-ticks / 6.0), 0.0),
    "the nominal brakes more and more": lambda ticks, size: np.where(ticks >= 0, size * (0.2 + ticks / 10.0), 0.0),
    "the nominal brakes after two ticks": lambda ticks, size: size * ((ticks >= 0) + 2.0 * (ticks >= 2)),
}


def speed_effects(pushes: Array, delay: int, *, lag: float = 0.0, noise: float = 0.0) -> Array:
    """What a vehicle makes of pushes ``[interventions, ticks]`` that act some ticks later, and lags by some ticks."""
    gains = np.linspace(2.0, 6.0, len(pushes))
    draws = np.random.default_rng(3)
    effects = []
    for gain, push in zip(gains, pushes, strict=True):
        speed, accel, speeds = 0.0, 0.0, {}
        for place in range(AT_BRANCH - 12, len(push)):
            speeds[place] = speed
            wanted = gain * push[place - delay] if 0 <= place - delay < len(push) else 0.0
            accel += (wanted - accel) / (1.0 + lag)
            speed += 0.05 * accel
        effects.append([speeds[AT_BRANCH + OBSERVATION_STRIDE_TICKS * j] for j in range(5)])
    return np.array(effects) + draws.normal(0.0, noise, (len(pushes), 5))


def pushes_of(shape: Shape) -> Array:
    return np.stack([shape(ONSET_TICKS.astype(float), size) for size in (0.3, 0.5, 0.8, 1.0, -0.3, -0.5, -0.8, -1.0)])


@pytest.mark.parametrize("shape", SHAPES)
def test_a_delay_is_found_of_commands_of_any_shape(shape: str) -> None:
    pushes = pushes_of(SHAPES[shape])
    for delay in range(-6, 7):
        onset = fitted_onset(speed_effects(pushes, delay), [pushes])
        assert onset is not None
        assert (onset.ticks, onset.low, onset.high) == (delay, delay, delay)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_lag_delays_and_never_hastens(shape: str) -> None:
    pushes = pushes_of(SHAPES[shape])
    onset = fitted_onset(speed_effects(pushes, 0, lag=2.0), [pushes])
    assert onset is not None
    assert 0.5 <= onset.low <= onset.ticks <= 2.5


def test_noise_widens_the_interval_and_it_holds_the_truth() -> None:
    pushes = pushes_of(SHAPES["the nominal brakes and eases"])
    for delay in (-3, 0, 3):
        exact, noisy = (fitted_onset(speed_effects(pushes, delay, noise=noise), [pushes]) for noise in (0.0, 0.01))
        assert exact is not None
        assert noisy is not None
        assert noisy.low <= delay <= noisy.high
        assert noisy.high - noisy.low >= exact.high - exact.low


def test_pedals_of_other_strength_are_told_apart() -> None:
    """A nominal that lets the throttle go and brakes, against a policy that drives on: each acts with its own gain."""
    ticks = ONSET_TICKS.astype(float)
    sizes = np.linspace(0.2, 1.0, 8)[:, None]
    throttle, brake = sizes * (ticks >= 0), sizes[::-1] * ((ticks >= 3) & (ticks < 9))
    effect = speed_effects(throttle, 1) + 2.5 * speed_effects(brake, 1)
    onset = fitted_onset(effect, [throttle, brake])
    assert onset is not None
    assert onset.ticks == 1


def test_what_no_delay_explains_has_no_onset() -> None:
    pushes = pushes_of(SHAPES["the nominal drives on"])
    constant = np.tile(np.array([1.0, -1.0, 1.0, -1.0, 1.0]), (len(pushes), 1))
    assert fitted_onset(constant, [pushes]) is None
