"""What a group costs does not grow with the shards before it, and a dataset is finished without reading them again."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.sampling import sampled
from tests.validator.writer.invented import (
    ATTEMPTS,
    branch_fields,
    fill,
    identity_fields,
    make_descriptor,
    result_fields,
    write_dataset,
    write_group,
)

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, STAGING_DIR
from branchdrive.errors import ContractError, UsageError
from branchdrive.formats.folder import Folder
from branchdrive.writer.place_log import LOG_FILE
from branchdrive.writer.staging import staged_groups
from branchdrive.writer.writer import DatasetWriter

COUNTERS = Path("/proc/self/io")
DESCRIPTOR = make_descriptor(has_evidence=False)


def open_writer(root: Path) -> DatasetWriter:
    return DatasetWriter(root, DESCRIPTOR, groups_per_shard=1)


def collect(writer: DatasetWriter, index: int, *, is_placed: bool) -> None:
    with writer.begin_group(f"g{index:04d}", index=index if is_placed else None) as group:
        write_group(group, ATTEMPTS[:1], has_evidence=False, num_ticks=6)
    assert writer.commit() == 1


def counted(work: Callable[[], object]) -> dict[str, int]:
    """System calls that read and write files, and their bytes, as the kernel counts them."""

    def counts() -> dict[str, int]:
        rows = (line.split(": ") for line in COUNTERS.read_text().splitlines())
        return {name: int(value) for name, value in rows if name in ("rchar", "wchar", "syscr", "syscw")}

    before = counts()
    work()
    return {name: value - before[name] for name, value in counts().items()}


@pytest.mark.skipif(not COUNTERS.exists(), reason="the system counts no reads and writes of a process")
@pytest.mark.parametrize("is_placed", sampled([True, False], every=2))
def test_the_thirtieth_shard_costs_what_the_third_does(tmp_path: Path, is_placed: bool) -> None:
    with open_writer(tmp_path) as writer:
        collect(writer, 0, is_placed=is_placed)  # what is loaded once
        costs = [counted(lambda i=i: collect(writer, i, is_placed=is_placed)) for i in range(1, 31)]
    early, late = costs[:5], costs[-5:]
    for name in costs[0]:
        assert min(cost[name] for cost in late) <= 1.02 * min(cost[name] for cost in early), name


def digested(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Paths of files that are read for their digests from now on."""
    paths: list[str] = []
    digest = Folder.digest

    def note(folder: Folder, path: str) -> str:
        paths.append(path)
        return digest(folder, path)

    monkeypatch.setattr(Folder, "digest", note)
    return paths


def test_what_was_committed_is_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    identity = write_dataset(tmp_path / "expected", 3, groups_per_shard=1)
    paths = digested(monkeypatch)
    root = tmp_path / "d"
    assert write_dataset(root, 3, groups_per_shard=1) == identity
    assert paths == [DESCRIPTOR_FILE]


@pytest.mark.parametrize("change", ["time", "size", "inode"])
def test_a_file_that_has_changed_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str) -> None:
    file = tmp_path / "raw/shard-00001/controls.parquet"
    paths = digested(monkeypatch)
    with open_writer(tmp_path) as writer:
        for index in range(3):
            collect(writer, index, is_placed=True)
        content, status = file.read_bytes(), file.stat()
        if change == "time":
            os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns + 1))
        elif change == "size":
            file.write_bytes(content + b"x")
            os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
        else:
            copy = file.with_name("copy")
            copy.write_bytes(content)
            os.utime(copy, ns=(status.st_atime_ns, status.st_mtime_ns))
            copy.rename(file)
        writer.finalize()
    assert paths == [DESCRIPTOR_FILE, "raw/shard-00001/controls.parquet"]


def test_a_finished_dataset_is_read_once_when_it_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_dataset(tmp_path, 3, groups_per_shard=1)
    paths = digested(monkeypatch)
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=1) as writer:
        num_checked = len(paths)
        with writer.begin_group("g9") as group:
            write_group(group)
        writer.finalize()
    assert num_checked == len(set(paths))
    assert paths[num_checked:] == [DESCRIPTOR_FILE]


def unfinished(root: Path) -> None:
    """Three committed groups, and a staged one."""
    with DatasetWriter(root, make_descriptor(), groups_per_shard=1) as writer:
        for index in range(4):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group)
            if index < 3:
                writer.commit()


def without_log(log: Path) -> None:
    log.unlink()


def by_an_earlier_version(log: Path) -> None:
    log.rename(log.with_name("places.json"))


def cut_off(log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-100])


def overwritten(log: Path) -> None:
    content = bytearray(log.read_bytes())
    content[content.index(b"\n") + 50 :] = bytes(len(content) - content.index(b"\n") - 50)
    log.write_bytes(content)


@pytest.mark.parametrize(
    "damage", sampled([without_log, by_an_earlier_version, cut_off, overwritten], every=2), ids=lambda d: d.__name__
)
def test_whatever_becomes_of_the_log_the_dataset_is_the_same(tmp_path: Path, damage: Callable[[Path], None]) -> None:
    write_dataset(tmp_path / "expected", 4, groups_per_shard=1)
    root = tmp_path / "d"
    unfinished(root)
    damage(root / STAGING_DIR / LOG_FILE)
    with DatasetWriter(root, make_descriptor(), groups_per_shard=1) as writer:
        assert writer.places == {f"g{index}": index for index in range(4)}
        assert writer.closed == {"g0", "g1", "g2", "g3"}
        writer.finalize()
    assert (root / MANIFEST_FILE).read_bytes() == (tmp_path / "expected" / MANIFEST_FILE).read_bytes()


def test_a_staging_area_of_an_earlier_version_is_told_from_another(tmp_path: Path) -> None:
    unfinished(tmp_path)
    by_an_earlier_version(tmp_path / STAGING_DIR / LOG_FILE)
    with pytest.raises(UsageError, match="an earlier version of branchdrive began the collection; run the collector's"):
        staged_groups(tmp_path)


def test_a_rollout_of_two_shards_is_found_without_a_log(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=1) as writer:
        for index in range(2):
            with writer.begin_group(f"g{index}", index=index) as group:
                fields = identity_fields("nominal", "nominal", None)
                rollout = group.begin_rollout(**fields, rollout_id="same")
                fill(rollout, (index,), num_ticks=12, is_active=False, has_evidence=True)
                rollout.finish(**result_fields(), **branch_fields("same"))
            writer.commit()
    (tmp_path / STAGING_DIR / LOG_FILE).unlink()
    with (
        DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=1) as writer,
        pytest.raises(ContractError, match=r"rollout ids \['same'\] occur in two groups"),
    ):
        writer.finalize()
