"""The printed promise: its numbers are those of the protocol, and its limits are in it."""

from __future__ import annotations

import numpy as np
from tests.each import each

from branchdrive.benchmark.guard.calibration import (
    ALPHA,
    CONDITIONAL,
    DELTA,
    GLOBAL_MARGIN,
    GUARANTEE,
    LEARN_THEN_TEST,
    conformal,
)
from branchdrive.benchmark.guard.path import TOLERANCE_M


def test_the_numbers_are_those_of_the_protocol() -> None:
    assert f"more than {TOLERANCE_M:g} m below" in GUARANTEE
    assert f"at most {ALPHA:g}." in GUARANTEE
    assert f"probability at least {1 - DELTA:g} " in LEARN_THEN_TEST
    assert f"at most {ALPHA:g}." in LEARN_THEN_TEST


@each(
    "limit",
    [
        "exchangeable",
        "before any calibration outcome was read",
        "on average only",
        "not given that the selector intervenes",
        "collisions",
        "outside of the bank",
        "closed-loop",
        "another simulator",
        "its separation and its utility",
        "Every profile is calibrated by itself",
        "a choice among profiles after their results is not covered",
        "given one calibration set the rate can exceed 0.05",
    ],
)
def test_the_limits_are_part_of_the_text(limit: str) -> None:
    assert limit in GUARANTEE


def test_the_average_is_not_what_one_calibration_set_has() -> None:
    """Uniform risks of independent clusters along a fine path: the mean keeps to the rate, many sets do not."""
    assert f"exceed {ALPHA:g}" in CONDITIONAL
    rng = np.random.default_rng(3)
    path = np.linspace(0, 0.5, 102)
    clusters = [str(place) for place in range(60)]
    rates = []
    for _ in range(150):
        latent = rng.random(60)
        place = conformal(latent < path[:, None], clusters, min_groups=60).place
        rates.append(path[place])
    assert np.mean(rates) <= ALPHA
    assert 0.1 < np.mean(np.array(rates) > ALPHA) < 0.4


def test_the_global_margin_promises_nothing() -> None:
    assert "without a finite-sample guarantee" in GLOBAL_MARGIN
