"""Worlds with cameras: their images reach the dataset, around the branch and at the tick that they show."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.validator.collector.straight import NUM_FEW, EmptyRoad, ShortRoad, few_policies
from tests.validator.formats.image_files import png
from tests.validator.writer.invented import camera

import branchdrive as bd
from branchdrive.contract.timing import WINDOW_OFFSETS

STREAMS = ("ego_route_state", "actor_risk_evidence", "controls", "route_result", "rgb_top_down")
TOP_DOWN = camera("top_down", "rgb_top_down")
FILMED = few_policies(streams=STREAMS, cameras=(TOP_DOWN,))


def shot(tick: int) -> bytes:
    """An image that shows its tick."""
    return png(np.full((4, 5, 3), tick % 256, np.uint8))


class FilmedRoad(ShortRoad):
    """Films itself from above."""

    tick = 0

    def reset(self, seed: int) -> bd.Scene:
        self.tick = 0
        return super().reset(seed)

    def step(self, command: bd.Command) -> None:
        self.tick += 1
        super().step(command)

    def frames(self) -> Mapping[str, bytes]:
        return {"top_down": shot(self.tick)}


class FilmedEmptyRoad(FilmedRoad, EmptyRoad):
    """Never branches."""


class StillRoad(FilmedRoad):
    """Shows the same image wherever the ego stands, as a plain road looks."""

    def frames(self) -> Mapping[str, bytes]:
        return {"top_down": shot(0)}


class MisnamingRoad(FilmedRoad):
    """Calls its camera otherwise than the descriptor."""

    def frames(self) -> Mapping[str, bytes]:
        return {"topdown": shot(self.tick)}


class BlindRoad(FilmedRoad):
    """Loses its camera."""

    def frames(self) -> Mapping[str, bytes]:
        return {}


def collect(root: Path, world: Any, described: bd.Descriptor = FILMED, **options: Any) -> bd.Dataset:
    arguments: dict[str, Any] = {"num_groups": 1, "num_replays": 0, **options}
    bd.collect_dataset(root, described, {"Parked": world}, **arguments)
    return bd.open_dataset(root)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> bd.Dataset:
    return collect(tmp_path_factory.mktemp("filmed") / "dataset", FilmedRoad)


def test_images_cover_the_windows_of_every_rollout(filmed: bd.Dataset) -> None:
    group = filmed.group(filmed.groups[0])
    assert len(group.rollouts) == 1 + NUM_FEW
    for rollout in group.rollouts:
        assert rollout.branch_tick is not None
        frames = rollout.frames("top_down")
        assert frames.ticks.tolist() == [rollout.branch_tick + offset for offset in WINDOW_OFFSETS]
        assert [frame.read() for frame in frames] == [shot(tick) for tick in frames.ticks.tolist()]


def test_the_structured_part_is_that_of_a_world_without_cameras(filmed: bd.Dataset, tmp_path: Path) -> None:
    plain = collect(tmp_path / "plain", FilmedRoad, few_policies(streams=STREAMS[:-1]))
    names = [path.relative_to(plain.root) for path in plain.root.rglob("*.parquet") if path.stem != "rollouts"]
    assert names
    assert all((plain.root / name).read_bytes() == (filmed.root / name).read_bytes() for name in names)
    assert plain.rollouts() == filmed.rollouts()


def test_all_saved_observations_are_filmed_on_request(tmp_path: Path) -> None:
    dataset = collect(tmp_path / "all", FilmedEmptyRoad, all_frames=True)
    (rollout,) = dataset.group(dataset.groups[0]).rollouts
    assert rollout.frames("top_down").ticks.tolist() == rollout.column("observations", "tick").tolist()


def test_a_recommendation_on_images_is_a_note_and_costs_no_group(tmp_path: Path) -> None:
    report = bd.collect_dataset(tmp_path / "dataset", FILMED, {"Parked": StillRoad}, num_groups=1, num_replays=0)
    (group,) = report.groups
    assert (group.num_simulated, group.unbranched_because, group.refused_because) == (1 + NUM_FEW, "", "")
    assert group.note.startswith("BD-FRM-010 Does not hold: Images follow the drive: ")
    verdict = bd.validate(tmp_path / "dataset")
    assert verdict.funnel is not None
    assert (verdict.verdict, verdict.funnel.qualified) == ("valid", 1)


def test_a_rollout_without_a_branch_keeps_no_image(tmp_path: Path) -> None:
    dataset = collect(tmp_path / "unbranched", FilmedEmptyRoad)
    (rollout,) = dataset.group(dataset.groups[0]).rollouts
    assert len(rollout.frames("top_down")) == 0


@pytest.mark.parametrize(
    ("world", "message"),
    [
        (ShortRoad, r"cameras `top_down`, and the world ShortRoad has no method `frames`"),
        (BlindRoad, r"`frames` gives no image of `top_down` at tick 0; it gave none; give one of every camera"),
        (MisnamingRoad, r"`frames` gives no image of `top_down` at tick 0; it gave `topdown`; give one"),
    ],
)
def test_a_world_that_does_not_film_what_is_declared_is_an_error(tmp_path: Path, world: Any, message: str) -> None:
    with pytest.raises(bd.UsageError, match=message):
        collect(tmp_path / "dataset", world)
