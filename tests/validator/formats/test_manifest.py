from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.contract.layout import MANIFEST_FILE, unsafe_reason
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import (
    SAFE_PATH,
    WELL_FORMED,
    Manifest,
    build_manifest,
    parse_manifest,
    write_manifest,
)

DIGEST = "0" * 64
HEAD = b"# branchdrive-manifest 0.1\n"
IDENTITY = b"# dataset " + b"1" * 64 + b"\n"
LAYER = b"# layer %s " + b"3" * 64 + b"\n"
FILE = b"2" * 64 + b"  raw/shard-00000/rollouts.parquet\n"

PARTS = st.sampled_from(
    ["raw", "shard-00000", "shard-00001", "canonical", "media", "a", "b.parquet", "rollouts.parquet", "ä"]
)
FILES = st.dictionaries(
    st.lists(PARTS, min_size=1, max_size=4).map("/".join).filter(lambda path: unsafe_reason(path) is None),
    st.text("0123456789abcdef", min_size=64, max_size=64),
    max_size=12,
)


def sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def test_layer_digests_and_identity_follow_the_definition() -> None:
    files = {
        "raw/shard-00000/rollouts.parquet": sha256("r"),
        "raw/shard-00000/media.tar": sha256("m"),
        "raw/shard-00000/controls.parquet": sha256("c"),
        "canonical/links.parquet": sha256("l"),
        "benchmark/results.json": sha256("b"),
        "branchdrive.json": sha256("d"),
    }
    raw = sha256(f"{sha256('c')}  raw/shard-00000/controls.parquet\n{sha256('r')}  raw/shard-00000/rollouts.parquet\n")
    canonical = sha256(f"{sha256('l')}  canonical/links.parquet\n")
    manifest = Manifest.of(files)
    assert list(manifest.layers) == ["raw", "canonical", "benchmark", "media"]
    assert manifest.layers["raw"] == raw
    assert manifest.identity == sha256(f"layer raw {raw}\nlayer canonical {canonical}\n")


def test_media_and_results_do_not_change_the_identity() -> None:
    files = {"raw/shard-00000/rollouts.parquet": DIGEST}
    more = files | {"raw/shard-00000/media.tar": DIGEST, "benchmark/x.json": DIGEST, "README.md": DIGEST}
    assert Manifest.of(files).identity == Manifest.of(more).identity
    assert Manifest.of(files).identity != Manifest.of(files | {"model/x.parquet": DIGEST}).identity


@given(FILES)
def test_what_is_rendered_parses_to_the_same_manifest(files: dict[str, str]) -> None:
    manifest = Manifest.of(files)
    parsed, found = parse_manifest(manifest.render())
    assert (parsed, found) == (manifest, [])


@given(FILES, st.data())
def test_the_order_of_files_means_nothing(files: dict[str, str], data: st.DataObject) -> None:
    shuffled = dict(data.draw(st.permutations(list(files.items()))))
    assert Manifest.of(shuffled).render() == Manifest.of(files).render()


@given(st.binary(max_size=300))
def test_any_bytes_parse_to_mismatches_not_exceptions(content: bytes) -> None:
    _, found = parse_manifest(content)
    assert found


@each(
    ("content", "line", "message"),
    [
        (b"", 1, "empty file"),
        (b"# branchdrive-manifest 9.9\n" + IDENTITY, 1, "expected '# branchdrive-manifest 0.1'"),
        (HEAD + FILE, 2, "no dataset identity"),
        (HEAD + IDENTITY + FILE[:-1], 3, "no line feed"),
        (HEAD + IDENTITY + FILE.replace(b"\n", b"\r\n"), None, "control"),
        (HEAD + IDENTITY + b"\n", 3, "found ''"),
        (HEAD + IDENTITY + FILE.replace(b"2", b"G"), 3, "hexadecimal"),
        (HEAD + IDENTITY + FILE.replace(b"  raw", b" *raw"), 3, "two blanks"),
        (HEAD + IDENTITY + DIGEST.encode() + b"  ../../etc/passwd\n", None, "leaves its folder"),
        (HEAD + IDENTITY + DIGEST.encode() + b"  /etc/passwd\n", None, "absolute"),
        (HEAD + IDENTITY + DIGEST.encode() + b"  raw/\x00\n", None, "control"),
        (HEAD + IDENTITY + DIGEST.encode() + b"  raw/\x1b[2J\n", None, "control"),
        (HEAD + IDENTITY + DIGEST.encode() + b"  raw/\xff\n", 3, "not UTF-8"),
        (HEAD + IDENTITY + DIGEST.encode() + b"  " + b"x" * 10_000_000 + b"\n", 3, "more than a digest"),
        (HEAD + IDENTITY + DIGEST.encode() + b"  MANIFEST.sha256\n", 3, "itself"),
        (HEAD + IDENTITY + FILE + FILE, 4, "listed twice"),
        (HEAD + IDENTITY + FILE + DIGEST.encode() + b"  a\n", 4, "out of order"),
        (HEAD + IDENTITY + FILE + b"# note\n", 4, "stand above"),
        (HEAD + b"# note\n" + IDENTITY, 2, "no layer or dataset line"),
        (HEAD + IDENTITY + IDENTITY, 3, "repeats one"),
        (HEAD + LAYER % b"media" + LAYER % b"raw" + IDENTITY, 3, "order"),
        (HEAD + LAYER % b"raw" + LAYER % b"raw" + IDENTITY, 3, "once each"),
        (HEAD + LAYER % b"other" + IDENTITY, 2, "found 'other'"),
        (HEAD + IDENTITY + LAYER % b"raw", 3, "order"),
    ],
)  # fmt: skip
def test_a_defect_is_reported_with_its_line(content: bytes, line: int | None, message: str) -> None:
    _, found = parse_manifest(content)
    (text,) = [mismatch.found for mismatch in found if message in mismatch.found]
    assert text.startswith("path " if line is None else f"line {line} ")


def test_a_bad_line_does_not_hide_the_good_ones() -> None:
    manifest, found = parse_manifest(HEAD + IDENTITY + b"nonsense\n" + FILE)
    assert len(found) == 1
    assert list(manifest.files) == ["raw/shard-00000/rollouts.parquet"]


def test_only_unsafe_paths_are_marked_as_such() -> None:
    _, found = parse_manifest(HEAD + IDENTITY + b"nonsense\n" + DIGEST.encode() + b"  ../x\n")
    assert [mismatch.expected for mismatch in found] == [WELL_FORMED, SAFE_PATH]


def test_mismatches_are_bounded() -> None:
    _, found = parse_manifest(HEAD + b"\n" * 1_000_000)
    assert len(found) == 100
    assert "too many problems" in found[-1].found


def test_limits_on_size_and_number_of_files_hold() -> None:
    limits = replace(spec_limits(), max_files=1, max_manifest_bytes=1000)
    _, found = parse_manifest(HEAD + IDENTITY + FILE + DIGEST.encode() + b"  z\n" * 3, limits)
    assert ["more than 1 files" in mismatch.found for mismatch in found] == [True]
    _, found = parse_manifest(b"#" * 1001, limits)
    assert found[0].found.startswith("line 0 ")


def test_the_manifest_of_a_folder_lists_every_other_file(tmp_path: Path) -> None:
    (tmp_path / "raw/shard-00000").mkdir(parents=True)
    (tmp_path / ".staging/groups").mkdir(parents=True)
    (tmp_path / ".staging/groups/x").write_bytes(b"x")
    (tmp_path / "raw/shard-00000/rollouts.parquet").write_bytes(b"r")
    (tmp_path / "branchdrive.json").write_bytes(b"d")
    manifest = build_manifest(Folder(tmp_path))
    assert dict(manifest.files) == {"branchdrive.json": sha256("d"), "raw/shard-00000/rollouts.parquet": sha256("r")}
    write_manifest(Folder(tmp_path), manifest)
    assert build_manifest(Folder(tmp_path)) == manifest
    assert (tmp_path / MANIFEST_FILE).read_bytes() == manifest.render()


def test_a_text_of_somebody_is_no_card_before_there_is_a_release(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_bytes(b"mine")
    assert not build_manifest(Folder(tmp_path)).files
    (tmp_path / "quality").mkdir()
    assert dict(build_manifest(Folder(tmp_path)).files) == {"README.md": sha256("mine")}


@pytest.mark.parametrize("kind", ["link", "link to folder", "fifo", "unsafe name"])
def test_a_folder_with_other_than_plain_files_has_no_manifest(tmp_path: Path, kind: str) -> None:
    match kind:
        case "link":
            (tmp_path / "x").symlink_to("/etc/hostname")
        case "link to folder":
            (tmp_path / "x").symlink_to("/etc")
        case "fifo":
            os.mkfifo(tmp_path / "x")
        case _:
            (tmp_path / "a\nb").write_bytes(b"")
    with pytest.raises(DatasetError):
        build_manifest(Folder(tmp_path))
