"""What commands read beside tables, changed at one place: descriptor, manifest and waivers."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from tests.changed_input import changed_contents, poor_end, poor_ends

from branchdrive import open_dataset
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.errors import BranchDriveError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest

WAIVERS = {
    "waivers": [
        {"rule": rule, "location": "raw/*", "reason": "known for long enough", "expires": "2099-01-01", "max_count": 3}
        for rule in ("BD-ACT-003", "BD-CTL-001")
    ]
}


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("size", [8, pytest.param(80, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("path", [DESCRIPTOR_FILE, MANIFEST_FILE])
def test_validation_of_a_changed_dataset_ends_in_a_verdict(
    valid_root: Path, tmp_path: Path, path: str, size: int
) -> None:
    root = shutil.copytree(valid_root, tmp_path / "dataset")
    assert poor_ends(root, path, size, ("validate", root)) == []


def test_a_changed_dataset_is_opened_or_refused_in_words(valid_root: Path, tmp_path: Path) -> None:
    root, refused = shutil.copytree(valid_root, tmp_path / "dataset"), 0
    for path in (DESCRIPTOR_FILE, MANIFEST_FILE):
        original = (root / path).read_bytes()
        for what, content in changed_contents(path, original, 60):
            (root / path).write_bytes(content)
            if path != MANIFEST_FILE:
                write_manifest(Folder(root), build_manifest(Folder(root)))
            try:
                open_dataset(root).rollouts()
            except BranchDriveError as error:
                refused += 1
                assert str(error).isprintable(), (path, what)
        (root / path).write_bytes(original)
    assert refused > 40


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("size", [15, pytest.param(100, marks=pytest.mark.thorough)])
def test_changed_waivers_are_applied_or_refused_in_words(valid_root: Path, tmp_path: Path, size: int) -> None:
    file = tmp_path / "waivers.json"
    assert schema_mismatches(WAIVERS, "waivers.schema.json") == []
    ends = []
    for what, content in changed_contents(file.name, json.dumps(WAIVERS).encode(), size):
        file.write_bytes(content)
        ends.append((what, poor_end("validate", valid_root, "--waivers", file)))
    assert [end for end in ends if end[1]] == []
