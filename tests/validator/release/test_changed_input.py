"""Builds from a changed dataset of a stranger, with changed variants, and releases beside a changed raw layer."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from tests.changed_input import changed_contents, poor_end, poor_ends

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, SOURCE_FILE

VARIANTS = [{"name": "mine", "title": "Mine", "where": {"extended_valid": True, "core_valid": True}}]


@pytest.mark.parametrize("size", [4, pytest.param(40, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("path", [DESCRIPTOR_FILE, MANIFEST_FILE])
def test_a_changed_dataset_is_built_or_refused_in_words(raw: Path, tmp_path: Path, path: str, size: int) -> None:
    for number, (what, content) in enumerate(changed_contents(path, (raw / path).read_bytes(), size)):
        root = shutil.copytree(raw, tmp_path / str(number))
        (root / path).write_bytes(content)
        assert poor_end("build", root, "--no-leakage") == "", what
        shutil.rmtree(root)


@pytest.mark.parametrize("size", [6, pytest.param(60, marks=pytest.mark.thorough)])
def test_changed_variants_are_built_or_refused_in_words(raw: Path, tmp_path: Path, size: int) -> None:
    file = tmp_path / "variants.json"
    for number, (what, content) in enumerate(changed_contents(file.name, json.dumps(VARIANTS).encode(), size)):
        file.write_bytes(content)
        end = poor_end("build", raw, "--no-leakage", "--output", tmp_path / str(number), "--variants", file)
        assert end == "", what


@pytest.mark.parametrize("size", [2, pytest.param(20, marks=pytest.mark.thorough)])
def test_a_release_beside_a_changed_raw_layer_ends_in_a_verdict(raw: Path, tmp_path: Path, size: int) -> None:
    release, dataset = tmp_path / "release", shutil.copytree(raw, tmp_path / "dataset")
    assert poor_end("build", raw, "--no-leakage", "--output", release) == ""
    command = ("validate", release, "--raw", dataset)
    ends = [*poor_ends(dataset, DESCRIPTOR_FILE, size, command), *poor_ends(dataset, MANIFEST_FILE, size, command)]
    assert ends + poor_ends(release, SOURCE_FILE, size, command) == []
