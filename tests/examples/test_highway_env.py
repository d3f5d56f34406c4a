"""The collector for highway-env writes what is valid, and its world is the same again after other scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.sampling import THOROUGH

import branchdrive as bd
from branchdrive.collector.drive import drive
from branchdrive.driving.projection import map_pixels
from branchdrive.formats.image_codec import decode_image

pytest.importorskip("highway_env", reason="highway-env is not installed: pip install -e '.[examples]'")
pytestmark = pytest.mark.filterwarnings("ignore")

SEED = 2


def collector() -> Any:
    import examples.highway_env.collector as module

    return module


def with_interventions(described: bd.Descriptor, count: int) -> bd.Descriptor:
    """The descriptor with a bank of the nominal policy and so many interventions."""
    bank = bd.ActionBank(name="few", policies=described.action_bank.policies[: 1 + count])
    return described.model_copy(update={"action_bank": bank, "action_encoding": None})


def positions(world: Any, seed: int) -> list[tuple[float, float]]:
    run = drive(world, seed, bd.load_action_bank().nominal, max_ticks=60)
    return [(ego.x_m, ego.y_m) for ego in run.observations]


def test_a_group_of_a_merge_is_valid_and_qualifies(tmp_path: Path) -> None:
    module = collector()
    worlds = {"HighwayMerge": module.WORLDS["HighwayMerge"]}
    root, options = tmp_path / "dataset", {**module.options(), "num_replays": 1}
    report = bd.collect_dataset(root, with_interventions(module.describe(1), 2), worlds, num_groups=1, **options)
    assert [group.unbranched_because for group in report.groups] == [""]
    verdict = bd.validate(root)
    assert (verdict.verdict, [finding.message for finding in verdict.findings]) == ("valid", [])
    assert verdict.funnel is not None
    assert set(verdict.funnel.groups.values()) == {1}


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


def test_the_filmed_world_shows_vehicles_where_the_camera_has_them() -> None:
    import examples.highway_env.filmed as filmed

    world = filmed.FilmedWorld("HighwayMerge")
    world.reset(SEED)
    for _ in range(90):
        decision = world.expert()
        world.step(bd.Command(*np.array([decision.steer, decision.throttle, decision.brake], np.float32)))
    pixels, ego = decode_image(world.frames()["top_down"]), world.pose(world.ego)
    seen = 0
    for actor in world.actors():
        ahead, left = bd.to_ego_frame(actor.x_m - ego["x_m"], actor.y_m - ego["y_m"], ego["yaw_rad"])
        row, column = map_pixels(filmed.CAMERA, ahead, left)
        if 2 < row < 126 and 2 < column < 126:
            seen += 1
            assert pixels[int(row), int(column)].tolist() == [100, 200, 255]
    assert seen > 0
    assert pixels[96, 64].tolist() == [200, 200, 0]  # the ego


@THOROUGH  # the test before it: the film shows what is there
def test_filmed_groups_are_valid(tmp_path: Path) -> None:
    import examples.highway_env.filmed as filmed

    worlds, options = {"HighwayMerge": filmed.WORLDS["HighwayMerge"]}, {**collector().options(), "num_replays": 0}
    described = with_interventions(filmed.describe(1), 1)
    bd.collect_dataset(tmp_path / "dataset", described, worlds, num_groups=1, **options)
    verdict = bd.validate(tmp_path / "dataset")
    assert [finding.message for finding in verdict.findings if finding.rule.startswith("BD-FRM")] == []
    dataset = bd.open_dataset(tmp_path / "dataset")
    for rollout in dataset.group(dataset.groups[0]).rollouts:
        assert rollout.frames("top_down").pixels().shape == (26, 128, 128, 3)
