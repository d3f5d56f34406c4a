"""Parts of an audit on disk are believed where this builder put them and they have their form, and nowhere else."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from tests.validator.release.running import build, contents

from branchdrive.contract.document import parse_json
from branchdrive.contract.layout import LEAKAGE_FILE, STAGING_DIR
from branchdrive.release import leakage as stored
from branchdrive.release.leakage import StoredParts

SCORE = {
    "accuracy": 0.1,
    "accuracy_interval": [0.0, 0.2],
    "log_likelihood": -2.5,
    "p_accuracy": 0.5,
    "p_log_likelihood": 0.5,
    "identical": False,
}
PART = {"score": SCORE, "training": None}
KEY = "0" * 64


@pytest.fixture
def kept(tmp_path: Path) -> StoredParts:
    """Parts in an empty folder."""
    return StoredParts.of(tmp_path, KEY)


def test_a_part_comes_back(kept: StoredParts, audited: Path) -> None:
    gate = parse_json((audited / LEAKAGE_FILE).read_bytes())["gate"]
    for name, part in (("gate", gate), ("13-way/availability", PART)):
        assert kept.get(name) is None
        kept.put(name, part)
        assert kept.get(name) == part


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b"{}",
        b"1",
        b"[" * 100_000,
        b'{"score": NaN, "training": null}',
        json.dumps({**PART, "more": 1}).encode(),
        json.dumps({**PART, "name": "ego"}).encode(),
        json.dumps({"score": None, "training": None}).encode(),
        json.dumps({"score": {**SCORE, "p_accuracy": 0}, "training": None}).encode(),
        json.dumps({"score": {**SCORE, "accuracy": "high"}, "training": None}).encode(),
        json.dumps({**PART, "training": {"num_epochs": 1}}).encode(),
    ],
)
def test_a_part_of_another_form_is_computed_again(kept: StoredParts, content: bytes) -> None:
    for name in ("12-way/ego", "gate"):
        kept.put(name, PART)
        (kept.folder / f"{name.replace('/', '-')}.json").write_bytes(content)
        assert kept.get(name) is None
        kept.put(name, PART)
    assert kept.get("gate") is None  # a classifier's part is no gate
    assert kept.get("12-way/ego") == PART


def test_links_are_not_followed(kept: StoredParts, tmp_path: Path) -> None:
    (tmp_path / "outside.json").write_text(json.dumps(PART))
    (kept.folder / "12-way-ego.json").symlink_to(tmp_path / "outside.json")
    assert kept.get("12-way/ego") is None
    kept.put("12-way/ego", {**PART, "training": {"num_epochs": 1, "best_epoch": 1}})
    assert json.loads((tmp_path / "outside.json").read_text()) == PART
    shutil.rmtree(kept.folder)
    (tmp_path / "outside").mkdir()
    kept.folder.symlink_to(tmp_path / "outside")
    StoredParts.of(tmp_path, KEY).put("12-way/ego", PART)
    assert list((tmp_path / "outside").iterdir()) == []


@pytest.mark.parametrize("other", ["version", "specification", "key", "folder"])
def test_parts_are_of_one_program_one_specification_one_audit_and_one_folder(
    kept: StoredParts, tmp_path: Path, other: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept.put("12-way/ego", PART)
    area, key = tmp_path, KEY
    match other:
        case "version":
            monkeypatch.setattr(stored, "version", lambda _: "99")
        case "specification":
            monkeypatch.setattr(stored, "SPEC_VERSION", "99")
        case "key":
            key = "1" * 64
        case "folder":
            area = shutil.copytree(tmp_path, tmp_path.with_name(f"{tmp_path.name}-copy"))
    assert StoredParts.of(area, key).get("12-way/ego") is None


def test_a_planted_part_is_not_taken(built: Path, audited: Path, tmp_path: Path) -> None:
    """Of a dataset that came with a cache: that of an interrupted build elsewhere, with a gate that passes."""
    root = shutil.copytree(built, tmp_path / "release")

    def interrupt(stage: str, done: int, _: int, _note: str) -> None:
        if (stage, done) == ("leakage", 2):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build(root, stages=["leakage"], progress=interrupt)
    (folder,) = (root / STAGING_DIR / "build").glob("leakage-*")
    gate: dict[str, Any] = json.loads((folder / "gate.json").read_bytes())
    (folder / "gate.json").write_text(json.dumps({**gate, "reason": "planted"}))
    copy = shutil.copytree(root, tmp_path / "copy")
    build(copy, stages=["leakage", "model"])
    assert contents(copy) == contents(audited)
