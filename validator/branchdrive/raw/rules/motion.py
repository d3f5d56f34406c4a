"""Motion rules: pose, speed, yaw rate and accelerations of the ego agree with each other within physical bounds.

Source: spec/05-raw-streams.md#motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.raw.motion import displacement_m, lateral_mps2, longitudinal_mps2, max_displacement_m, turn_rad
from branchdrive.raw.shard_view import ShardView

Array = NDArray[np.float64]


def _marked(
    view: ShardView, subjects: Mask, marked: Mask, column: str, text: Callable[[int], tuple[str, str]]
) -> Check:
    """Check of attempts by marked observations, each described by its row."""
    summary = view.observations.by_rollout(marked)

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        tick = int(view.observations.tick[row])
        return Mismatch({"table": "observations", "column": column, "tick": tick}, *text(row), int(summary.count[i]))

    return Check.of_subjects(subjects, subjects & summary.any, describe)


@rule("BD-MOT-001")
def displacement_agrees_with_speed(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The way between two observations is that of their speeds and headings."""
    residual, speed = displacement_m(view), view.observations["speed_mps"].astype(np.float64)
    most = max_displacement_m(speed, np.roll(speed, 1))
    yield _marked(
        view, subjects, residual > most, "x_m",
        lambda row: (
            f"a displacement within {most[row]:.2f} m of what speed and heading give",
            f"{residual[row]:.2f} m away from it",
        ),
    )  # fmt: skip


@rule("BD-MOT-002")
def turn_agrees_with_yaw_rate(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The turn between two observations is that of their yaw rates."""
    residual, most = turn_rad(view), physical_bounds().turn_rad
    yield _marked(
        view, subjects, residual > most, "yaw_rad",
        lambda row: (
            f"a turn within {most:g} rad of what the yaw rate gives", f"{residual[row]:.3f} rad away from it",
        ),
    )  # fmt: skip


@rule("BD-MOT-003")
def accelerations_are_of_the_past(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No acceleration and no yaw rate at tick 0; elsewhere accelerations agree with speeds and yaw rates."""
    observations, most, checks = view.observations, physical_bounds().acceleration_mps2, []
    for column in ("accel_longitudinal_mps2", "accel_lateral_mps2", "yaw_rate_radps"):
        values = observations[column]

        def at_start(row: int, values: NDArray[np.float32] = values) -> tuple[str, str]:
            return "0 at tick 0, which has no past", f"{values[row]:g}"

        checks.append(_marked(view, subjects, (observations.tick == 0) & (values != 0), column, at_start))
    residuals = {"accel_longitudinal_mps2": longitudinal_mps2(view), "accel_lateral_mps2": lateral_mps2(view)}
    for column, residual in residuals.items():

        def later(row: int, residual: Array = residual) -> tuple[str, str]:
            expected = f"an acceleration within {most:g} m/s2 of what speed and yaw rate give"
            return expected, f"{residual[row]:.1f} m/s2 away from it"

        checks.append(_marked(view, subjects, residual > most, column, later))
    yield Check.of_any(*checks)
