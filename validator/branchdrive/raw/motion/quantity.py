"""What is calibrated of recorded motion and of the declared vehicle, and which values are right.

Source: spec/07-rules.md#calibration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask

__all__ = ["OF_VEHICLE", "QUANTITIES", "Quantity", "is_none_of_one", "share_text", "wrong_of_one"]


class Quantity(NamedTuple):
    """What is calibrated.

    Attributes:
        table: Table of the column.
        column: The recorded column.
        least: The least value that is right, of the quantity named by `text`.
        most: The largest.
        text: What the values bound, in words.
        of_one: The least and the largest value that is right of a single attempt; ``None`` where all may be.
    """

    table: str
    column: str
    least: float
    most: float
    text: str
    of_one: tuple[float, float] | None = None

    @property
    def expected(self) -> str:
        """What the values bound, and the bounds."""
        return _bounded(self.text, self.least, self.most)

    @property
    def expected_of_one(self) -> str:
        """The same of a single attempt."""
        return _bounded(self.text, *(self.of_one or (-np.inf, np.inf)))

    @property
    def expected_of_stretch(self) -> str:
        """The same of the observations of an attempt up to the branch, or from it on."""
        return _bounded(self.text, LEAST_OF_STRETCH, (self.of_one or (-np.inf, np.inf))[1])


def _bounded(text: str, least: float, most: float) -> str:
    return f"{text}: {least:g} {'or more' if most == np.inf else f'to {most:g}'}"


QUANTITIES = {
    "speed": Quantity(
        "observations", "speed_mps", 0.99, 1.01, "speed as a share of what positions and clock say", (0.98, 1.02)
    ),
    "step": Quantity(
        "observations", "x_m", 0.0, 0.05, "share of the way by which single steps of positions and speeds differ",
        (0.0, 0.1),
    ),
    "yaw_rate": Quantity("observations", "yaw_rate_radps", 0.6, 1.6, "slope of the yaw rate on the turn", (0.25, 4.0)),
    "longitudinal": Quantity(
        "observations", "accel_longitudinal_mps2", 0.5, 2.0, "slope of the acceleration on the change of speed",
        (0.05, 5.0),
    ),
    "lateral": Quantity(
        "observations", "accel_lateral_mps2", 0.5, 2.0, "slope of the acceleration on speed times turn", (0.25, 4.0)
    ),
    "heading": Quantity(
        "observations", "yaw_rad", -3.0, 3.0, "degrees from the heading to the displacement on straight ways",
        (-3.0, 3.0),
    ),
    "steering": Quantity(
        "controls", "applied_steer", 0.0, np.inf, "slope of the turn on speed times steering left", (0.0, np.inf)
    ),
    "drive": Quantity("controls", "applied_throttle", 0.0, np.inf, "slope of the gain of speed on throttle less brake"),
    "pivot": Quantity(
        "observations", "x_m", 0.15, 0.85, "way from the rear axle, which does not slip, to the pose, in wheelbases",
        (0.1, 0.9),
    ),
    "actor_sense": Quantity(
        "actors", "yaw_rad", 0.9, 1.0, "share of the velocity of vehicles along their heading", (0.8, 1.0)
    ),
    "actor_heading": Quantity(
        "actors", "yaw_rad", 0.0, 3.0, "mean degrees between heading and velocity of vehicles on straight ways",
        (0.0, 3.0),
    ),
    "actor_speed": Quantity(
        "actors", "vel_x_mps", 0.95, 1.05, "velocity of vehicles as a share of what positions and clock say", (0.9, 1.1)
    ),
    "pedestrian_speed": Quantity(
        "actors", "vel_x_mps", 0.95, 1.05, "velocity of pedestrians as a share of what positions and clock say",
        (0.7, 1.4),
    ),
    "pedestrian_sense": Quantity(
        "actors", "yaw_rad", 0.0, 1.0, "share of the velocity of pedestrians along their heading"
    ),
    "command": Quantity(
        "observations", "command", 0.0, np.inf, "yaw rate to the side of the navigation command, in rad/s"
    ),
    "speed_lead": Quantity(
        "observations", "speed_mps", -0.55, 0.55, "observations that the speed is ahead of the positions",
        (-0.75, 0.75),
    ),
    "yaw_rate_lead": Quantity(
        "observations", "yaw_rate_radps", -0.55, 0.55, "observations that the yaw rate is ahead of the headings",
        (-0.75, 0.75),
    ),
    "longitudinal_lead": Quantity(
        "observations", "accel_longitudinal_mps2", 0.25, np.inf,
        "observations that the acceleration is ahead of the mean of two changes of speed",
    ),
    "lateral_lead": Quantity(
        "observations", "accel_lateral_mps2", 0.25, np.inf,
        "observations that the acceleration is ahead of the mean of two products of speed and yaw rate",
    ),
    "actor_lead": Quantity(
        "actors", "vel_x_mps", -0.55, 0.55, "observations that the velocity is ahead of the positions", (-0.75, 0.75)
    ),
}  # fmt: skip
"""What is calibrated of recorded motion, by name."""


OF_VEHICLE = {
    "vehicle_turn": Quantity(
        "controls", "applied_steer", 0.8, 1.25, "slope of the turn by the declared vehicle on the recorded turn"
    ),
    "vehicle_brake": Quantity(
        "controls", "applied_brake", 0.8, 1.25, "slope of the deceleration by the declared vehicle on the loss of speed"
    ),
}
"""What is calibrated of the vehicle that the descriptor declares."""


LEAST_OF_STRETCH = -0.25
"""Least slope that is right of the observations up to the branch, or from it on: a smaller one has the wrong sign."""


_SHARES = {
    "speed": "speeds", "actor_speed": "velocities of vehicles", "pedestrian_speed": "velocities of pedestrians",
}  # fmt: skip
"""Quantities that are shares of what positions say."""


def share_text(name: str, value: float) -> str:
    """How far a quantity is above or below what positions say, in words; empty of those that are no share of it."""
    if name not in _SHARES or not np.isfinite(value) or abs(value - 1) < 0.005:
        return ""
    than = "higher" if value > 1 else "lower"
    return f"{_SHARES[name]} are {abs(value - 1):.0%} {than} than the positions say".replace("%", " %")


def is_none_of_one(name: str, values: NDArray[np.float64]) -> Mask:
    """Where values of a quantity are known, and none that is right of a single attempt."""
    least, most = QUANTITIES[name].of_one or (-np.inf, np.inf)
    return np.asarray((values < least) | (values > most))


def wrong_of_one(name: str, values: NDArray[np.float64]) -> Mask:
    """Where values of a quantity between contacts are none that is right of one attempt ``[3, rollouts]``.

    Up to the branch, and from it on, there are few observations, over which a turn may begin or end: there only the
    sign tells.
    """
    least, most = QUANTITIES[name].of_one or (-np.inf, np.inf)
    return np.asarray((values < np.array([[least], [LEAST_OF_STRETCH], [LEAST_OF_STRETCH]])) | (values > most))
