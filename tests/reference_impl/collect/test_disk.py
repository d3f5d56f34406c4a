"""A collection that does not fit on its disk is refused before it begins."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from branchdrive.errors import PlatformError
from branchdrive_reference.collect.disk import GROUPS_PER_SHARD, disk_need


@pytest.fixture
def free_bytes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """What the disk has free; change the one entry."""
    free = [3 * 2**30]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free[0]))
    return free


def test_shards_grow_with_the_groups_and_staging_does_not(tmp_path: Path) -> None:
    needs = [disk_need(tmp_path, count, jobs=2).needed_bytes for count in (0, 1_000, 2_000, 3_000)]
    assert needs[0] == 0
    assert needs[2] - needs[1] == needs[3] - needs[2]
    assert needs[1] > needs[2] - needs[1]


def test_every_worker_stages_groups_of_its_own(tmp_path: Path) -> None:
    alone, many = (disk_need(tmp_path, 1_000, jobs=jobs).needed_bytes for jobs in (1, 8))
    assert alone < many < 1_000 / GROUPS_PER_SHARD * alone


def test_the_need_reads_well(tmp_path: Path, free_bytes: list[int]) -> None:
    need = disk_need(tmp_path / "not" / "there", 2_467, jobs=2)
    few = disk_need(tmp_path, 10, jobs=2)
    assert str(few) == f"about {few.needed_bytes / 2**20:.0f} MiB needed, 3.0 GiB free"
    assert str(need) == f"about {need.needed_bytes / 2**30:.1f} GiB needed, 3.0 GiB free"
    need.check(tmp_path)
    free_bytes[0] = need.needed_bytes - 1
    with pytest.raises(
        PlatformError, match=r"2,467 groups do not fit on this disk: about .* make room, choose another"
    ):
        disk_need(tmp_path, 2_467, jobs=2).check(tmp_path)


def test_the_disk_is_that_of_the_nearest_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Path] = []
    monkeypatch.setattr(shutil, "disk_usage", lambda path: asked.append(path) or SimpleNamespace(free=0))
    disk_need(tmp_path / "a" / "b", 1, jobs=1)
    assert asked == [tmp_path]
