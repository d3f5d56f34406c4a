"""Test-set accesses that a dataset and its detached release have recorded are kept, all of them, and each once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import build, call, contents
from tests.validator.release.test_stages import entries

from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import LEDGER_FILE as LEDGER
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError
from branchdrive.quality.ledger import RELEASE_ACCESS, accesses


def test_a_detached_release_takes_over_the_accesses_of_its_dataset(release: Path, tmp_path: Path) -> None:
    before = contents(release)
    code, out, _ = call("build", release, "--output", tmp_path / "other", "--seed", str(SEED + 1), "--no-leakage")
    assert code == 0
    assert "The test partition was accessed 2 times" in out
    assert entries(tmp_path / "other")[:3] == entries(release)
    assert len(accesses(RELEASE_ACCESS, {"entries": entries(tmp_path / "other")})) == 2
    assert validate(tmp_path / "other", raw=release).verdict == "valid"
    assert contents(release) == before
    first = contents(tmp_path / "other")
    build(release, output=tmp_path / "other", seed=SEED + 1)
    assert contents(tmp_path / "other") == first


def test_later_accesses_of_the_dataset_reach_the_release(release: Path, tmp_path: Path) -> None:
    build(release, output=tmp_path / "other")
    assert entries(tmp_path / "other") == entries(release)
    build(release, seed=SEED + 1)
    build(release, output=tmp_path / "other")
    assert entries(tmp_path / "other") == entries(release)
    assert len(accesses(RELEASE_ACCESS, {"entries": entries(release)})) == 2
    assert validate(tmp_path / "other", raw=release).verdict == "valid"


def test_a_ledger_of_the_dataset_that_cannot_be_read_is_refused(release: Path, tmp_path: Path) -> None:
    sound = entries(release)
    (release / LEDGER).write_bytes(dump_json({"entries": "none"}))
    with pytest.raises(DatasetError, match=LEDGER):
        build(release, output=tmp_path / "other")
    (release / LEDGER).write_bytes(dump_json({"entries": sound[1:]}))
    with pytest.raises(DatasetError, match="expected 1, found 2; restore the file"):
        build(release, output=tmp_path / "other")
    shutil.rmtree(tmp_path / "other", ignore_errors=True)
    (release / LEDGER).unlink()
    build(release, output=tmp_path / "other")
    assert len(accesses(RELEASE_ACCESS, {"entries": entries(tmp_path / "other")})) == 1
