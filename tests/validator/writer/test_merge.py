"""Datasets of several machines become one, whose bytes are theirs; what contradicts is refused."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from tests.each import each
from tests.validator.writer.crashing import NAME_EVENTS
from tests.validator.writer.invented import ATTEMPTS, make_descriptor, write_group
from tests.waiting import PATIENCE_S

import branchdrive as bd
from branchdrive.cli.main import run
from branchdrive.collector.part import Part
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, STAGING_DIR
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.runtime.file_lock import FileLock
from branchdrive.writer import merge
from branchdrive.writer.merge import merge_datasets

REPOSITORY = Path(__file__).parents[3]


def write(
    root: Path, groups: Iterable[tuple[int, str]], *, has_media: bool = False, size: int = 2, **fields: Any
) -> str:
    """A dataset with these groups at these places; its identity."""
    descriptor = make_descriptor(has_evidence=False, has_media=has_media).model_copy(update=fields)
    ticks = (0, 5) if has_media else ()
    with bd.DatasetWriter(root, descriptor, groups_per_shard=size) as writer:
        for index, group_id in groups:
            with writer.begin_group(group_id, index=index) as group:
                write_group(group, ATTEMPTS[:1], has_evidence=False, frame_ticks=ticks)
        writer.finalize()


def named(places: Iterable[int], name: str = "g") -> list[tuple[int, str]]:
    return [(place, f"{name}{place}") for place in places]


def contents(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two datasets with shards of the same numbers; read-only by agreement."""
    folder = tmp_path_factory.mktemp("parts")
    write(folder / "a", [*named(range(3), "a"), (6, "a6")])
    write(folder / "b", named((0, 3), "b"))
    return folder / "a", folder / "b"


@pytest.mark.parametrize("num_parts", [1, 2, 3])
def test_parts_of_a_collection_make_the_whole_file_by_file(tmp_path: Path, num_parts: int) -> None:
    write(tmp_path / "whole", named(range(7)), has_media=True)
    roots = [tmp_path / f"part{k}" for k in range(1, num_parts + 1)]
    for k, root in enumerate(roots, start=1):
        write(root, named(Part(k, num_parts).places(7, groups_per_shard=2)), has_media=True)
    report = merge_datasets(roots[::-1], tmp_path / "merged")
    assert contents(tmp_path / "merged") == contents(tmp_path / "whole")
    assert (report.num_shards, report.num_groups, report.num_rollouts, report.is_renumbered) == (4, 7, 7, False)
    assert report.identity == build_manifest(Folder(tmp_path / "whole")).identity


def test_shards_of_the_same_numbers_follow_each_other(tmp_path: Path, parts: tuple[Path, Path]) -> None:
    before = [contents(root) for root in parts]
    report = merge_datasets(parts, tmp_path / "c")
    assert [contents(root) for root in parts] == before
    assert (report.num_shards, report.num_groups, report.is_renumbered) == (5, 6, True)
    came_from = [(parts[0], 0), (parts[0], 1), (parts[0], 3), (parts[1], 0), (parts[1], 1)]
    for number, (root, own) in enumerate(came_from):
        shard = tmp_path / f"c/raw/shard-{number:05d}"
        assert contents(shard) == contents(root / f"raw/shard-{own:05d}")
        assert all(path.samefile(root / f"raw/shard-{own:05d}" / path.name) for path in shard.iterdir())
    assert build_manifest(Folder(tmp_path / "c")).render() == (tmp_path / "c" / MANIFEST_FILE).read_bytes()
    found = bd.validate(tmp_path / "c")
    assert found.verdict == bd.validate(parts[0]).verdict
    assert not [f for f in found.findings if f.rule.startswith(("BD-LAY", "BD-DOC", "BD-KEY", "BD-TAB"))]


def identity_of(root: Path) -> str:
    return build_manifest(Folder(root)).identity


def test_the_descriptor_says_where_renumbered_shards_come_from(tmp_path: Path, parts: tuple[Path, Path]) -> None:
    merge_datasets(parts, tmp_path / "c")
    a, b = map(identity_of, parts)
    document = json.loads((tmp_path / "c" / DESCRIPTOR_FILE).read_bytes())
    assert document["collection"].pop("origins") == [
        {"identity": a, "first_shard": 2, "shards": [3]},
        {"identity": b, "first_shard": 3, "shards": [0, 1]},
    ]
    assert document == json.loads((parts[0] / DESCRIPTOR_FILE).read_bytes())
    write(tmp_path / "d", named(range(1), "d"))
    merge_datasets([tmp_path / "d", tmp_path / "c"], tmp_path / "e")
    origins = bd.open_dataset(tmp_path / "e").descriptor.collection.origins
    c = identity_of(tmp_path / "c")
    assert [(o.identity, o.first_shard, o.shards) for o in origins] == [
        (c, 1, (0, 1)), (a, 3, (3,)), (b, 4, (0, 1)),
    ]  # fmt: skip


def test_a_writer_goes_on_with_a_merged_dataset(tmp_path: Path, parts: tuple[Path, Path]) -> None:
    root = tmp_path / "c"
    merge_datasets(parts, root)
    kept = [contents(part) for part in parts]
    with bd.DatasetWriter(root, bd.open_dataset(root).descriptor, groups_per_shard=2) as writer:
        assert writer.places == {"a0": 0, "a1": 1, "a2": 2, "a6": 4, "b0": 6, "b3": 9}
        with writer.begin_group("b3") as group:
            assert [rollout.record["attempt"] for rollout in group.rollouts] == [1]
            write_group(group, ATTEMPTS[1:2], has_evidence=False)
        with writer.begin_group("free", index=8) as group:
            write_group(group, ATTEMPTS[:1], has_evidence=False)
        with pytest.raises(UsageError, match="place 4 of group `x` is taken by group `a6`"):
            writer.begin_group("x", index=4)
        writer.finalize()
    assert len(bd.open_dataset(root).group("b3").rollouts) == 2
    with bd.DatasetWriter(root, bd.open_dataset(root).descriptor, groups_per_shard=2) as writer:
        assert writer.places["b3"] == 9
    assert [contents(part) for part in parts] == kept


def test_what_presents_a_dataset_may_differ_and_is_that_of_the_first(tmp_path: Path) -> None:
    write(tmp_path / "a", named(range(2)), title="First")
    write(tmp_path / "b", named(range(2, 4)), title="Second", keywords=("driving",))
    merge_datasets([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    assert (tmp_path / "c" / DESCRIPTOR_FILE).read_bytes() == (tmp_path / "a" / DESCRIPTOR_FILE).read_bytes()


def other_seed(folder: Path) -> None:
    write(folder / "b", named((2, 3)), dataset_id="other", dataset_version="0.2.0")


def same_group(folder: Path) -> None:
    write(folder / "b", [(2, "g1"), (3, "g3")])


def other_size(folder: Path) -> None:
    write(folder / "b", named((3,)), size=3)


def unfinished(folder: Path) -> None:
    write(folder / "b", named((2,)))
    (folder / "b" / MANIFEST_FILE).unlink()


def staged(folder: Path) -> None:
    write(folder / "b", named((2,)))
    (folder / "b" / STAGING_DIR).mkdir()


def derived(folder: Path) -> None:
    write(folder / "b", named((2,)), layers=("raw", "canonical"))


def licensed(folder: Path) -> None:
    write(folder / "b", named((2,)))
    (folder / "b/LICENCE.txt").write_text("mine\n")
    write_manifest(Folder(folder / "b"), build_manifest(Folder(folder / "b")))


def output_exists(folder: Path) -> None:
    write(folder / "b", named((2,)))
    (folder / "c").mkdir()


CONTRADICTIONS: dict[Callable[[Path], None], str] = {
    other_seed: r"b: has another descriptor than .*a \(dataset_id is 'other', not 'invented'; dataset_version is "
    r"'0.2.0', not '0.1.0'\); merged datasets are of one collection, and only `title`, `description`, `url`, "
    "`keywords` may differ",
    same_group: r"group 'g1' is in .*a/raw/shard-00000 and .*b/raw/shard-00001, the first of 1; collect each group",
    other_size: r"b/raw/shard-00001: was written with 3 places a shard, .*a/raw/shard-00000 with 2 places; a writer",
    unfinished: r"b: has no MANIFEST.sha256; name a dataset, whose collection has finished",
    staged: r"b: has work of a command that runs or was cut off in .staging; finish that first",
    derived: r"b: claims the layers `raw`, `canonical`, and what is derived of a part does not hold of the whole",
    licensed: r"b: 'LICENCE.txt' is not that of .*a; let both have one, or neither",
    output_exists: r"c: is there already; name a folder that does not exist",
}


@each("contradiction", {case.__name__: case for case in CONTRADICTIONS})
def test_the_first_contradiction_is_told_and_leaves_nothing(
    tmp_path_factory: pytest.TempPathFactory, contradiction: str
) -> None:
    folder = tmp_path_factory.mktemp("contradiction")
    write(folder / "a", named(range(2)))
    case = next(case for case in CONTRADICTIONS if case.__name__ == contradiction)
    case(folder)
    before = contents(folder)
    with pytest.raises(UsageError, match=CONTRADICTIONS[case]):
        merge_datasets([folder / "a", folder / "b"], folder / "c")
    assert contents(folder) == before
    assert {path.name for path in folder.iterdir()} <= {"a", "b"} | ({"c"} if case is output_exists else set())


def test_a_part_is_named_once_and_the_output_lies_outside(tmp_path: Path, parts: tuple[Path, Path]) -> None:
    with pytest.raises(UsageError, match="is named twice"):
        merge_datasets([parts[0], parts[0]], tmp_path / "c")
    with pytest.raises(UsageError, match="lies inside"):
        merge_datasets([parts[0]], parts[0] / "c")
    with pytest.raises(UsageError, match="its parent is not a folder"):
        merge_datasets([parts[0]], tmp_path / "no/c")
    with pytest.raises(UsageError, match="nothing to merge"):
        merge_datasets([], tmp_path / "c")


def copy_of(part: Path, root: Path) -> Path:
    return Path(shutil.copytree(part, root))


def refuse(*_: object, **__: object) -> None:
    raise OSError(18, "Invalid cross-device link")


def test_where_nothing_can_be_linked_bytes_are_copied_and_compared(
    tmp_path: Path, parts: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    merge_datasets(parts, tmp_path / "linked")
    monkeypatch.setattr(os, "link", refuse)
    report = merge_datasets(parts, tmp_path / "copied")
    assert contents(tmp_path / "copied") == contents(tmp_path / "linked")
    assert report.num_copied == sum(path.startswith("raw/") for path in contents(tmp_path / "copied"))
    damaged = copy_of(parts[1], tmp_path / "damaged")
    file = damaged / "raw/shard-00000/controls.parquet"
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(DatasetError, match=r"damaged: 'raw/shard-00000/controls.parquet' has the digest .* restore"):
        merge_datasets([parts[0], damaged], tmp_path / "c")
    assert not (tmp_path / "c").exists()


def drop(path: Path) -> None:
    path.unlink()


def link_out(path: Path) -> None:
    path.rename(path.with_name("there"))
    path.symlink_to("there")


def flip(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1] + b"x")


@pytest.mark.parametrize(
    ("name", "damage", "message"),
    [
        ("raw/shard-00000/controls.parquet", drop, "does not exist"),
        ("raw/shard-00000/controls.parquet", link_out, "cannot be opened without following links"),
        ("raw/shard-00000/rollouts.parquet", flip, "has the digest .* and MANIFEST.sha256 lists .*; restore the file"),
        (DESCRIPTOR_FILE, drop, "does not exist"),
        (MANIFEST_FILE, flip, "MANIFEST.sha256 is malformed: .*; run `branchdrive-validate`"),
    ],
)
def test_a_damaged_part_is_refused(
    tmp_path: Path, parts: tuple[Path, Path], name: str, damage: Callable[[Path], None], message: str
) -> None:
    damaged = copy_of(parts[1], tmp_path / "damaged")
    damage(damaged / name)
    with pytest.raises(DatasetError, match=message):
        merge_datasets([parts[0], damaged], tmp_path / "c")
    assert [path.name for path in tmp_path.iterdir()] == ["damaged"]


def test_killed_before_any_change_of_names_it_begins_anew(
    tmp_path: Path, parts: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    merge_datasets(parts, tmp_path / "expected")
    expected = contents(tmp_path / "expected")
    before = [contents(root) for root in parts]
    place, left = tmp_path / "place", tmp_path / "left"
    place.mkdir()
    left.mkdir()
    is_watched, kills = True, count(1)

    def keep(event: str, _: tuple[object, ...]) -> None:
        nonlocal is_watched
        if is_watched and event in NAME_EVENTS | {"os.link"}:
            is_watched = False
            shutil.copytree(place, left / str(next(kills)), copy_function=os.link)
            is_watched = True

    sys.addaudithook(keep)
    merge_datasets(parts, place / "c")
    is_watched = False
    assert next(kills) > 20
    for killed in left.iterdir():
        if not (killed / "c").exists():
            merge_datasets(parts, killed / "c")
        assert contents(killed / "c") == expected
        assert [path.name for path in killed.iterdir()] == ["c"] or (killed / ".c.lock").exists()
    assert [contents(root) for root in parts] == before


PROGRAM = """
import sys
from pathlib import Path
from branchdrive.writer.merge import merge_datasets
print("begins", flush=True)
merge_datasets(sys.argv[1:3], sys.argv[3])
"""


def test_killed_at_random_moments_it_leaves_the_parts_and_ends_the_same(
    tmp_path: Path, parts: tuple[Path, Path]
) -> None:
    merge_datasets(parts, tmp_path / "expected")
    for wait_s in (0.0, 0.05, 0.2):
        child = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *map(str, parts), str(tmp_path / "c")],
            stdout=subprocess.PIPE,
            cwd=REPOSITORY,
        )
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(wait_s)
        os.kill(child.pid, signal.SIGKILL)
        child.communicate(timeout=PATIENCE_S)
        if (tmp_path / "c").exists():  # whole, or not there
            assert contents(tmp_path / "c") == contents(tmp_path / "expected")
            shutil.rmtree(tmp_path / "c")
    merge_datasets(parts, tmp_path / "c")
    assert contents(tmp_path / "c") == contents(tmp_path / "expected")


def test_nobody_else_merges_there_meanwhile(tmp_path: Path, parts: tuple[Path, Path]) -> None:
    with FileLock(tmp_path / ".c.lock"), pytest.raises(UsageError, match="another command merges there"):
        merge_datasets(parts, tmp_path / "c")


def test_too_many_files_are_refused_before_anything_is_made(
    tmp_path: Path, parts: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = replace(merge.spec_limits(), max_files=10)
    monkeypatch.setattr(merge, "spec_limits", lambda: limits)
    with pytest.raises(UsageError, match=r"would have 16 files beside its manifest, which lists at most 10; merge"):
        merge_datasets(parts, tmp_path / "c")
    assert not any(tmp_path.iterdir())


def test_the_command_says_what_it_made(tmp_path: Path, parts: tuple[Path, Path]) -> None:
    out, err = io.StringIO(), io.StringIO()
    output = tmp_path / "c"
    assert run(["merge", *map(str, parts), "--output", str(output)], out, err) == 0
    assert out.getvalue() == (
        "parts     2\n"
        "shards    5 renumbered\n"
        "groups    6 with 6 rollouts\n"
        f"dataset   {output}\n"
        f"identity  {identity_of(output)}\n"
        f"next      branchdrive-validate {output}\n"
    )
    assert run(["merge", *map(str, parts), "--output", str(output)], out, err) == 2
    assert err.getvalue() == f"branchdrive: {output}: is there already; name a folder that does not exist\n"


def test_progress_is_told_shard_by_shard(tmp_path: Path, parts: tuple[Path, Path]) -> None:
    told: list[tuple[int, int, str]] = []
    merge_datasets(parts, tmp_path / "c", progress=lambda *step: told.append(step))
    assert [step[:2] for step in told] == [(number, 10) for number in range(11)]
    assert told[0][2] == f"checking {parts[0]}/raw/shard-00000"
    assert told[9][2] == f"placing {parts[1]}/raw/shard-00001"
