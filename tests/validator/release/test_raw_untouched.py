"""A build reads the raw layer and never writes it; its manifest lines stay, and the identity covers every layer."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.validator.engine.rules.case import NO_SUBJECT
from tests.validator.release.running import breaches, build, manifest_lines, raw_state

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.engine.validate import validate
from branchdrive.formats.manifest import Manifest, parse_manifest


def manifest(root: Path) -> Manifest:
    found, problems = parse_manifest((root / MANIFEST_FILE).read_bytes())
    assert problems == []
    return found


def test_raw_files_keep_bytes_times_and_inodes(dataset: Path) -> None:
    before, lines = raw_state(dataset), manifest_lines(dataset, "raw")
    assert len(before) > 2
    build(dataset)
    build(dataset, seed=1)
    assert raw_state(dataset) == before
    assert manifest_lines(dataset, "raw") == lines


def test_raw_files_of_a_detached_release_stay_where_they_are(raw: Path, tmp_path: Path) -> None:
    before = raw_state(raw)
    build(raw, output=tmp_path / "release")
    assert raw_state(raw) == before
    assert not (tmp_path / "release/raw").exists()
    assert manifest_lines(tmp_path / "release", "raw") == []


def test_the_identity_covers_raw_canonical_quality_and_model(raw: Path, built: Path) -> None:
    found = manifest(built)
    assert {*found.layers} == {"raw", "canonical", "quality", "model", "media"}
    assert found.layers["raw"] == manifest(raw).layers["raw"]
    assert found.identity != manifest(raw).identity
    derived = Manifest.of(found.files)
    assert (derived.layers, derived.identity) == (found.layers, found.identity)
    assert validate(built).dataset.identity == found.identity


@pytest.mark.parametrize("path", ["README.md", "LICENCE.txt", "raw/shard-00000/media.bin"])
def test_the_identity_does_not_cover_texts_and_media(built: Path, path: str) -> None:
    found = manifest(built)
    files = {name: digest for name, digest in found.files.items() if name != path}
    assert path in found.files
    assert Manifest.of(files).identity == found.identity


def test_what_is_built_is_valid(audited: Path) -> None:
    assert breaches(audited) == set()
    left = [tally.rule_id for tally in validate(audited).tallies if tally.status == "skipped"]
    redrawn = {"BD-LKG-003", "BD-LKG-012"}  # as an audit of the full protocol drew
    of_optional_tables = {"BD-MOD-022", "BD-MOD-023"}
    assert set(left) <= {*redrawn, *of_optional_tables, *NO_SUBJECT}


def test_media_and_their_lines_stay(dataset: Path, built: Path, tmp_path: Path) -> None:
    """Files outside of the layers that the manifest lists are kept where they belong to raw."""
    before = {path: digest for path, digest in manifest(dataset).files.items() if path.startswith("raw/")}
    build(dataset, stages=["canonical"])
    after = manifest(dataset).files
    assert {path: digest for path, digest in after.items() if path.startswith("raw/")} == before
    assert set(after) - set(before) == {
        "branchdrive.json", "canonical/attempts-00000.parquet", "canonical/records-00000.parquet",
        "canonical/source.json",
    }  # fmt: skip
    assert shutil.copytree(dataset, tmp_path / "copy").is_dir()
    assert validate(tmp_path / "copy").verdict == "valid"
