"""Defects and limits of names beside a dataset: companions and the ignore file."""

from __future__ import annotations

import os
from pathlib import Path

from tests.synthetic_release import raw_tables
from tests.validator.engine.rules.benchmark_release import (
    BenchmarkDraft,
)
from tests.validator.engine.rules.case import (
    SHARD_0,
    SHARD_1,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest


@mutant("BD-LAY-009", at={"file": ".gitattributes"})
def companion_that_the_manifest_lists(d: Draft) -> None:
    def list_it(root: Path) -> None:
        (root / ".gitattributes").write_text("*.parquet filter=lfs\n")
        (root / MANIFEST_FILE).write_bytes(build_manifest(Folder(root), [".gitattributes"]).render())

    d.after_seal(list_it)


@boundary("BD-LAY-004", "BD-LAY-006", "BD-LAY-009", "BD-LAY-010")
def companions_of_every_kind(d: Draft) -> None:
    def add(root: Path) -> None:
        (root / ".git" / "objects" / "ab").mkdir(parents=True)
        (root / ".git" / "objects" / "ab" / "c:\\").write_bytes(b"")
        (root / ".git" / "hooks").symlink_to("/nowhere")
        (root / ".cache" / "huggingface").mkdir(parents=True)
        (root / ".huggingface").symlink_to("/etc")
        os.mkfifo(root / ".gitattributes")
        (root / "README.md").write_text("What this is.\n")
        (root / SHARD_0 / ".DS_Store").write_bytes(b"\0")
        (root / "raw" / "Thumbs.db").write_bytes(b"\0")
        (root / "notes [1].txt").write_text("mine\n")
        (root / "figures").mkdir()
        (root / "figures" / "one.png").write_bytes(b"")
        (root / ".branchdriveignore").write_text("# mine\n\nnotes [?].*\nfig*/\n")

    d.after_seal(add)


@mutant("BD-LAY-009", at={"file": "Canonical"})
def ignored_folder_that_some_systems_take_for_a_layer(d: Draft) -> None:
    def add(root: Path) -> None:
        (root / "Canonical").mkdir()
        (root / ".branchdriveignore").write_text("C*\n")

    d.after_seal(add)


# BD-LAY-010


@mutant("BD-LAY-010", at={"file": ".branchdriveignore"})
def ignore_file_with_too_many_patterns(d: Draft) -> None:
    lines = "name\n" * (spec_limits().max_ignore_patterns + 1)
    d.after_seal(lambda root: (root / ".branchdriveignore").write_text(lines))


@mutant("BD-LAY-010", at={"file": ".branchdriveignore"})
def ignore_file_too_large(d: Draft) -> None:
    text = "#" * spec_limits().max_ignore_bytes + "\n"
    d.after_seal(lambda root: (root / ".branchdriveignore").write_text(text))


@mutant("BD-LAY-010", at={"file": ".branchdriveignore"})
def ignore_file_with_a_path(d: Draft) -> None:
    d.after_seal(lambda root: (root / ".branchdriveignore").write_text("raw/shard-00000/late.bin\n"))


@mutant("BD-LAY-010", at={"file": ".branchdriveignore"})
def ignore_file_that_is_a_link(d: Draft) -> None:
    d.after_seal(lambda root: (root / ".branchdriveignore").symlink_to("/etc/hostname"))


@mutant("BD-LAY-004", at={"file": f"{SHARD_1}/late.parquet"}, base="media", name="file_that_an_ignore_file_cannot_hide")
def ignored_file_of_a_shard(d: Draft) -> None:
    def add(root: Path) -> None:
        (root / SHARD_1 / "late.parquet").write_bytes(b"late")
        (root / ".branchdriveignore").write_text("*\n")

    d.after_seal(add)


@boundary("BD-LAY-010", "BD-LAY-009")
def ignore_file_as_long_as_allowed(d: Draft) -> None:
    limits = spec_limits()
    text = "".join(f"{i}\n" for i in range(limits.max_ignore_patterns))
    text += "#" * (limits.max_ignore_bytes - len(text))
    d.before_seal(lambda root: (root / ".branchdriveignore").write_text(text))


# BD-LAY-009


@mutant("BD-LAY-009", at={"file": "benchmark/notes.txt"}, base="benchmark")
def file_of_no_kind_beside_results(d: BenchmarkDraft) -> None:
    d.texts["benchmark/notes.txt"] = "notes"


@mutant("BD-LAY-009", at={"file": "model"}, base="release")
def last_layer_without_a_claim(d: ReleaseDraft) -> None:
    d.descriptor["layers"] = ["raw", "canonical", "quality"]
    d.reseal("card")


@mutant("BD-LAY-009", at={"file": "raw"}, base="alone")
def raw_layer_in_a_detached_release(d: ReleaseDraft) -> None:
    d.tables.update(raw_tables())


# Several places: what violates a rule is counted


@mutant("BD-LAY-004", base="media", at={"file": f"{SHARD_1}/late.bin"}, findings=2)
def files_of_two_shards_that_came_late(d: Draft) -> None:
    d.after_seal(lambda root: [(root / shard / "late.bin").write_bytes(b"late") for shard in (SHARD_0, SHARD_1)])
