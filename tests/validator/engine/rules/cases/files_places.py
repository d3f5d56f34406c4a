"""Defects and limits of places: files and folders that a dataset has no place for."""

from __future__ import annotations

import pickle

from tests.synthetic import MEDIA_FILE, base_tables
from tests.validator.engine.rules.case import SHARD_0, SHARD_1, boundary, mutant
from tests.validator.engine.rules.draft import Draft

from branchdrive.formats.parquet import encode_table


@mutant("BD-LAY-009", at={"file": "NOTES.md"})
def file_in_the_root(d: Draft) -> None:
    d.before_seal(lambda root: (root / "NOTES.md").write_text("hello"))


@mutant("BD-LAY-009", at={"file": "raw/shard-2"})
def folder_that_is_no_shard(d: Draft) -> None:
    d.before_seal(lambda root: (root / "raw" / "shard-2").mkdir())


@mutant("BD-LAY-009", at={"file": f"{SHARD_0}/notes.bin"})
def media_without_a_claim(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_0 / "notes.bin").write_bytes(b""))


@mutant("BD-LAY-009", base="bare", at={"file": f"{SHARD_0}/evidence.parquet"})
def table_without_a_claim(d: Draft) -> None:
    content = encode_table(base_tables()[SHARD_0]["evidence"])
    d.before_seal(lambda root: (root / SHARD_0 / "evidence.parquet").write_bytes(content))


@mutant("BD-LAY-009", base="media", at={"file": f"{SHARD_0}/front"})
def folder_in_a_shard(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_0 / "front").mkdir())


@mutant("BD-LAY-009", base="media", at={"file": f"{SHARD_0}/controls.parquet.tmp"})
def working_file_beside_media(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_0 / "controls.parquet.tmp").write_bytes(b"PAR1"))


def _beside_media(d: Draft, name: str, content: bytes) -> None:
    d.before_seal(lambda root: (root / SHARD_0 / name).write_bytes(content))


@mutant("BD-LAY-009", base="media", at={"file": f"{SHARD_0}/views.dat"})
def pickle_beside_media(d: Draft) -> None:
    _beside_media(d, "views.dat", pickle.dumps({"view": b"\xff\xd8\xff"}, protocol=4))


@mutant("BD-LAY-009", base="media", at={"file": f"{SHARD_0}/views.PKL"})
def pickle_by_its_name(d: Draft) -> None:
    """A pickle of protocol 0, which is text and known by its name alone."""
    _beside_media(d, "views.PKL", pickle.dumps([1], protocol=0))


@mutant("BD-LAY-009", base="media", at={"file": f"{SHARD_0}/views"}, findings=3)
def programs_and_a_script_beside_media(d: Draft) -> None:
    _beside_media(d, "views", b"\x7fELF\x02\x01\x01")
    _beside_media(d, "views.bin", b"MZ\x90\x00\x03")
    _beside_media(d, "views.txt", b"#!/bin/sh\n")


@boundary("BD-LAY-009", base="media")
def media_of_other_forms_that_no_row_names(d: Draft) -> None:
    _beside_media(d, "views.mp4", b"\x00\x00\x00\x18ftypmp42")
    _beside_media(d, "views.raw", b"\x80\x01\x80\x06")
    _beside_media(d, "views.none", b"")


@boundary("BD-LAY-009", base="media")
def media_under_any_suffix(d: Draft) -> None:
    d.set("frames", "file", "views.of-g0.dat")
    for folder in (SHARD_0, SHARD_1):
        d.before_seal(lambda root, shard=folder: (root / shard / MEDIA_FILE).rename(root / shard / "views.of-g0.dat"))


@mutant("BD-LAY-009", at={"file": "canonical"})
def layer_that_is_not_claimed(d: Draft) -> None:
    d.before_seal(lambda root: (root / "canonical").mkdir())
