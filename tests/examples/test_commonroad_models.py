"""The collector for CommonRoad's vehicle models writes what is valid, in the frames of the specification."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import branchdrive as bd

pytest.importorskip("vehiclemodels", reason="vehicle models are not installed: pip install -e '.[examples]'")
pytestmark = pytest.mark.filterwarnings("ignore")


def collector() -> Any:
    import examples.commonroad_models.collector as module

    return module


def test_a_group_is_valid_and_qualifies(tmp_path: Path) -> None:
    module = collector()
    root, options = tmp_path / "dataset", {**module.options(), "num_replays": 1}
    bd.collect_dataset(root, module.describe(1), module.WORLDS, num_groups=1, **options)
    verdict = bd.validate(root)
    assert (verdict.verdict, [finding.message for finding in verdict.findings]) == ("valid", [])
    assert verdict.funnel is not None
    assert set(verdict.funnel.groups.values()) == {1}


def test_steering_to_the_right_goes_to_the_right() -> None:
    world = collector().BendWorld(4.0)
    world.reset(1)
    before = world.observe()
    for _ in range(20):
        world.step(bd.Command(*np.array([0.2, 0.0, 0.0], np.float32)))
    after = world.observe()
    assert after.y_m < before.y_m - 0.5
    assert after.yaw_rad < before.yaw_rad


def test_the_velocity_of_a_box_is_how_its_centre_moves() -> None:
    car = collector().Car(0.0, 10.0)
    for _ in range(10):
        car.step(0.2, 0.0)
    before, velocity = car.box, car.velocity
    car.step(0.2, 0.0)
    after = {name: (car.velocity[name] + velocity[name]) / 2 for name in velocity}
    assert car.box["x_m"] - before["x_m"] == pytest.approx(0.05 * after["vel_x_mps"], abs=2e-3)
    assert car.box["y_m"] - before["y_m"] == pytest.approx(0.05 * after["vel_y_mps"], abs=2e-3)


def test_braking_ends_at_a_standstill() -> None:
    car = collector().Car(0.0, 1.0)
    for _ in range(10):
        car.step(0.0, -8.0)
    assert car.state[3] == pytest.approx(0.0, abs=1e-9)
