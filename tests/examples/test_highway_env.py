"""The collector for highway-env writes what is valid, and its world is the same again after other scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import branchdrive as bd
from branchdrive.collector.drive import drive

pytest.importorskip("highway_env", reason="highway-env is not installed: pip install 'branchdrive[examples]'")
pytestmark = pytest.mark.filterwarnings("ignore")

SEED = 2


def collector() -> Any:
    import examples.highway_env.collector as module

    return module


def positions(world: Any, seed: int) -> list[tuple[float, float]]:
    run = drive(world, seed, bd.load_action_bank().nominal, max_ticks=60)
    return [(ego.x_m, ego.y_m) for ego in run.observations]


def test_groups_of_a_merge_are_valid_and_qualify(tmp_path: Path) -> None:
    module = collector()
    worlds = {"HighwayMerge": module.WORLDS["HighwayMerge"]}
    root, options = tmp_path / "dataset", {**module.options(), "num_replays": 1}
    report = bd.collect_dataset(root, module.describe(1), worlds, num_groups=2, jobs=2, **options)
    assert [group.unbranched_because for group in report.groups] == ["", ""]
    verdict = bd.validate(root)
    assert (verdict.verdict, [finding.message for finding in verdict.findings]) == ("valid", [])
    assert verdict.funnel is not None
    assert set(verdict.funnel.groups.values()) == {2}


def test_a_scene_is_the_same_after_others() -> None:
    """The intersection changes the drivers of every scene in its process."""
    module = collector()
    merge, crossing = (module.HighwayWorld(name) for name in ("HighwayMerge", "IntersectionCrossing"))
    before = positions(merge, SEED)
    positions(crossing, SEED)
    positions(merge, SEED + 1)
    assert positions(merge, SEED) == before


def test_steering_to_the_right_goes_to_the_right() -> None:
    world = collector().HighwayWorld("HighwayMerge")
    world.reset(SEED)
    before = world.observe()
    for _ in range(20):
        world.step(bd.Command(*np.array([0.1, 0.2, 0.0], np.float32)))
    after = world.observe()
    assert after.y_m < before.y_m - 0.5
    assert after.yaw_rad < before.yaw_rad
    assert after.speed_mps == pytest.approx(before.speed_mps + 1.0, abs=1e-6)
