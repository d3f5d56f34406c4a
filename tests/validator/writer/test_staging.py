"""What a kill leaves can be listed, closed, abandoned, and looked into while it is there."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import pytest
from tests.validator.collector.straight import NUM_FEW, ShortRoad, few_policies

import branchdrive as bd
from branchdrive.cli.main import run, validate_run
from branchdrive.contract.layout import MANIFEST_FILE, STAGING_DIR
from branchdrive.writer.staging import abandon_group, close_group, snapshot, staged_groups

TOWN = [bd.lane_element(f"lane-{y}", [-50.0, 250.0], [y, y], 10.5, 13.5) for y in range(0, 4000, 100)]
STREAMS = ("ego_route_state", "actor_risk_evidence", "map", "controls", "route_result")
DESCRIPTOR = few_policies(streams=STREAMS)
OPTIONS: dict[str, Any] = {"num_groups": 2, "maps": {"StraightRoad": TOWN}, "groups_per_shard": 1, "num_replays": 0}


WHOLE, BEGUN = 1 + NUM_FEW, 3
"""Rollouts of a whole group, and of the second where it is killed."""


class KilledError(Exception):
    """Stands for a kill."""


class Dying(ShortRoad):
    """Is killed at the fourth rollout of its second group."""

    left = 0

    def reset(self, seed: int) -> bd.Scene:
        Dying.left -= 1
        if Dying.left < 0:
            raise KilledError
        return super().reset(seed)


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("killed") / "dataset"
    Dying.left = WHOLE + BEGUN  # again where a worker makes the fixture a second time
    with pytest.raises(KilledError):
        bd.collect_dataset(root, DESCRIPTOR, {"Parked": Dying}, **OPTIONS)
    return root


@pytest.fixture
def root(killed: Path, tmp_path: Path) -> Path:
    import shutil

    return Path(shutil.copytree(killed, tmp_path / "dataset"))


def staging(*arguments: object) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    return run(["staging", *map(str, arguments)], out, err), out.getvalue(), err.getvalue()


def contents(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()}


def test_what_is_open_is_listed(root: Path) -> None:
    assert staging(root) == (
        0,
        "     1  g00001-parked  open  3 rollouts\n"
        "1 staged group: 1 open\n"
        "The collector's command goes on with open groups; --close and --abandon settle one without it.\n",
        "",
    )


def test_a_snapshot_is_valid_and_changes_nothing(root: Path) -> None:
    before = contents(root)
    with snapshot(root) as copy:
        report = bd.validate(copy)
        assert sorted(path.name for path in copy.iterdir()) == [MANIFEST_FILE, "branchdrive.json", "raw"]
    assert report.verdict == "valid"
    assert (report.dataset.num_groups, report.dataset.num_rollouts) == (2, WHOLE + BEGUN)
    assert report.funnel is not None
    assert list(report.funnel.groups.values()) == [2, 1, 1, 1, 1]
    assert not copy.exists()
    assert contents(root) == before


def test_a_snapshot_of_another_disk_is_copied(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    with snapshot(root) as linked:
        expected = contents(linked)
    monkeypatch.setattr(os, "link", refuse)
    with snapshot(root) as copied:
        assert contents(copied) == expected


def test_the_validator_looks_into_a_running_collection(root: Path) -> None:
    out, err = io.StringIO(), io.StringIO()
    with bd.DatasetWriter(root, DESCRIPTOR, groups_per_shard=1, maps={"StraightRoad": TOWN}) as writer:
        group = writer.begin_group("g00001-parked")
        assert [facts.state for facts in staged_groups(root)] == ["written now"]
        assert validate_run([str(root), "--staging", "--format", "json"], out, err) == 0
        group.release()
    report = json.loads(out.getvalue())
    assert report["verdict"] == "valid"
    assert report["dataset"]["path"] == f"{root} (staging)"
    assert report["dataset"]["num_rollouts"] == WHOLE + BEGUN


def test_a_closed_group_goes_into_the_dataset_as_it_is(root: Path) -> None:
    assert staging(root, "--close", "g00001-parked")[1] == (
        "     1  g00001-parked  closed  3 rollouts\n1 staged group: 1 closed\n"
    )
    report = bd.collect_dataset(root, DESCRIPTOR, {"Parked": ShortRoad}, **OPTIONS)
    assert report.num_found == 2
    assert bd.open_dataset(root).rollouts().num_rows == WHOLE + BEGUN
    assert not (root / STAGING_DIR).exists()


def test_an_abandoned_group_is_collected_anew(root: Path) -> None:
    assert staging(root, "--abandon", "g00001-parked") == (0, "0 staged groups\n", "")
    report = bd.collect_dataset(root, DESCRIPTOR, {"Parked": ShortRoad}, **OPTIONS)
    assert [(group.num_reused, group.num_simulated) for group in report.groups] == [(0, WHOLE)]


def test_a_group_that_a_shard_holds_comes_back_as_it_was(root: Path) -> None:
    bd.collect_dataset(root, DESCRIPTOR, {"Parked": ShortRoad}, **OPTIONS)
    with bd.DatasetWriter(root, DESCRIPTOR, groups_per_shard=1, maps={"StraightRoad": TOWN}) as writer:
        writer.begin_group("g00000-parked").release()
        assert staged_groups(root)[0].is_committed
        abandon_group(root, "g00000-parked")
        writer.finalize()
    assert bd.open_dataset(root).rollouts().num_rows == 2 * WHOLE


@pytest.mark.parametrize("settle", [close_group, abandon_group])
def test_a_group_that_is_written_is_left_alone(root: Path, settle: Any) -> None:
    with bd.DatasetWriter(root, DESCRIPTOR, groups_per_shard=1, maps={"StraightRoad": TOWN}) as writer:
        group = writer.begin_group("g00001-parked")
        with pytest.raises(bd.UsageError, match="is written now; wait for its collector or stop it"):
            settle(root, "g00001-parked")
        group.release()
    with pytest.raises(bd.UsageError, match="has no staged group 'other'"):
        settle(root, "other")


def test_an_unfinished_collection_is_no_fault_of_its_manifest(tmp_path: Path) -> None:
    root = tmp_path / "dataset"
    with bd.DatasetWriter(root, DESCRIPTOR, groups_per_shard=1, maps={"StraightRoad": TOWN}) as writer:
        writer.begin_group("g00001-parked").release()
        report = bd.validate(root)
    (found,) = [finding for finding in report.findings if finding.rule == "BD-LAY-001"]
    assert found.found == "no manifest: writing was interrupted or goes on, as its working area says"
    assert found.to_json()["remedy"].startswith("Where a collection was interrupted, run the same command again")


def test_without_a_staging_area_or_a_rollout_there_is_nothing_to_look_at(tmp_path: Path) -> None:
    code, _, err = staging(tmp_path)
    assert (code, err) == (
        2, f"branchdrive: {tmp_path}: has no staging area, so that no collection runs or was cut off there\n",
    )  # fmt: skip
    (tmp_path / "rendered/.staging/render").mkdir(parents=True)
    assert (
        "no collection runs or was cut off there; .staging belongs to a rendering," in staging(tmp_path / "rendered")[2]
    )
    with bd.DatasetWriter(tmp_path / "new", DESCRIPTOR, maps={"StraightRoad": TOWN}):
        pass
    with pytest.raises(bd.UsageError, match="no rollout is finished yet"), snapshot(tmp_path / "new"):
        pass
