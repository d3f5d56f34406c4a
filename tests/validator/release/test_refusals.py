"""What cannot be built is refused in one line with exit code 2, and nothing is half-written."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.synthetic import descriptor, seal_dataset, write_dataset
from tests.synthetic_release import raw_descriptor, raw_tables
from tests.validator.engine import datasets
from tests.validator.engine.rules.draft import Draft
from tests.validator.release.running import breaches, build, call, contents

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, STAGING_DIR
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError

CONTROLS = "raw/shard-00000/controls.parquet"


def refused(*argv: object, exit_code: int = 2) -> str:
    """The one line with which `branchdrive build` refuses."""
    code, out, err = call("build", "--no-leakage", *argv)
    assert (code, out) == (exit_code, ""), err
    assert err.startswith("branchdrive: ")
    assert err.endswith("\n")
    assert err[:-1].isprintable()
    assert "Traceback" not in err
    return err


# --- the raw layer


def _no_manifest(root: Path) -> None:
    (root / MANIFEST_FILE).unlink()


def _damaged(root: Path) -> None:
    content = bytearray((root / CONTROLS).read_bytes())
    content[len(content) // 2] ^= 1
    (root / CONTROLS).write_bytes(content)


def _other(root: Path) -> None:
    (root / CONTROLS).write_bytes((root / "raw/shard-00001/controls.parquet").read_bytes())


def _gone(root: Path) -> None:
    (root / CONTROLS).unlink()


def _gone_and_sealed(root: Path) -> None:
    _gone(root)
    seal_dataset(root)


def _more(root: Path) -> None:
    shutil.copytree(root / "raw/shard-00000", root / "raw/shard-00007")


def _linked(root: Path) -> None:
    (root / "elsewhere").write_bytes((root / CONTROLS).read_bytes())
    (root / CONTROLS).unlink()
    (root / CONTROLS).symlink_to(root / "elsewhere")


def _no_descriptor(root: Path) -> None:
    (root / DESCRIPTOR_FILE).unlink()


def _broken_descriptor(root: Path) -> None:
    (root / DESCRIPTOR_FILE).write_text('{"spec_version": 1')


def _no_raw(root: Path) -> None:
    shutil.rmtree(root / "raw")


RAW: dict[str, tuple[Callable[[Path], object], str]] = {
    "unfinished": (_no_manifest, "has no MANIFEST.sha256: finish the collection before a release is built"),
    "a flipped bit": (_damaged, f"'{CONTROLS}' is not the file that MANIFEST.sha256 lists"),
    "another table": (_other, f"'{CONTROLS}' is not the file that MANIFEST.sha256 lists"),
    "a table less": (_gone, f"'{CONTROLS}' is not the file that MANIFEST.sha256 lists"),
    "a table less, sealed": (_gone_and_sealed, "correct the raw layer first"),
    "a shard more": (_more, "is not the file that MANIFEST.sha256 lists"),
    "a link": (_linked, f"'{CONTROLS}' is not the file that MANIFEST.sha256 lists"),
    "no descriptor": (_no_descriptor, "its descriptor cannot be used"),
    "a broken descriptor": (_broken_descriptor, "its descriptor cannot be used"),
    "no raw layer": (_no_raw, "holds no raw layer; build from the dataset that does"),
}


@pytest.mark.parametrize(("spoil", "message"), RAW.values(), ids=RAW)
def test_a_raw_layer_that_is_not_sound_is_refused(
    dataset: Path, spoil: Callable[[Path], object], message: str, tmp_path: Path
) -> None:
    spoil(dataset)
    before = contents(dataset)
    for place in ([], ["--output", tmp_path / "release"]):
        assert message in refused(dataset, *place)
    assert contents(dataset) == before
    assert not (tmp_path / "release").exists()


@pytest.mark.parametrize("name", [name for name, d in datasets.DEPARTURES.items() if d.verdict == "invalid"])
def test_a_raw_layer_that_breaks_the_format_is_refused(tmp_path: Path, name: str) -> None:
    departure = datasets.DEPARTURES[name]
    root = datasets.write(tmp_path / "dataset", departure.tables())
    before = contents(root)
    err = refused(root)
    assert any(f"breaks {rule}" in err for rule in departure.rules)
    assert contents(root) == before


def test_there_must_be_a_dataset(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert "is not a folder; give the folder that holds branchdrive.json" in refused(tmp_path / "nowhere")
    assert "holds no dataset" in refused(tmp_path / "empty")
    assert list((tmp_path / "empty").iterdir()) == []


@pytest.mark.parametrize("groups", [(0,), (0, 1, 2)])
def test_too_few_groups_leave_a_valid_dataset(tmp_path: Path, groups: tuple[int, ...]) -> None:
    d = Draft(raw_tables(), raw_descriptor())
    folder = "raw/shard-00000"
    ids = [f"g{group}" for group in groups]
    rows = d.tables[folder]["rollouts"].to_pylist()
    kept = [row["rollout_id"] for row in rows if row["group_id"] in ids]
    few = {name: table.filter([value in kept for value in table["rollout_id"].to_pylist()])
           for name, table in d.tables[folder].items() if name != "frames"}  # fmt: skip
    write_dataset(tmp_path / "dataset", {folder: few}, descriptor())
    err = refused(tmp_path / "dataset")
    assert "`; a cluster is never divided; collect more groups, on other routes\n" in err
    assert not (tmp_path / "dataset" / STAGING_DIR).exists()
    assert validate(tmp_path / "dataset").verdict == "valid"


@pytest.mark.parametrize("least", ["1000,1", "1,1000", "15,1"])
def test_a_calibration_partition_that_is_too_large_is_refused(dataset: Path, least: str) -> None:
    less = "collect more groups, on other routes, or ask for fewer groups and clusters with `--calibration`"
    assert less in refused(dataset, "--calibration", least)
    assert not (dataset / STAGING_DIR).exists()
    assert validate(dataset).verdict == "valid"


def test_a_calibration_partition_that_fits_is_drawn(dataset: Path) -> None:
    assert call("build", dataset, "--no-leakage", "--calibration", "2,2")[0] == 0
    assert "calibration" in json.loads((dataset / "quality/population.json").read_bytes())["partitions"]
    assert validate(dataset).verdict == "valid"


# --- options


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--stage", "benchmark"], "argument --stage: invalid choice: 'benchmark'"),
        (["--stage", "leakage"], "`--no-leakage` and `--stage leakage` contradict each other"),
        (["--stage", "model"], "the stage 'model' needs the layer 'quality', which is not there; build it first"),
        (["--seed", "-1"], "argument --seed"),
        (["--seed", "9" * 5000], "argument --seed"),
        (["--seed", "one"], "argument --seed"),
        (["--calibration", "5"], "'5' is not GROUPS,CLUSTERS, two whole numbers above 0"),
        (["--calibration", "0,1"], "'0,1' is not GROUPS,CLUSTERS, two whole numbers above 0"),
        (["--calibration", "1\x1b,1"], "is not GROUPS,CLUSTERS"),
        (["--jobs", "0"], "argument --jobs: '0' is no whole number of at least 1"),
        (["--format", "html"], "argument --format: invalid choice: 'html'"),
        (["--variants", "nowhere\x1b[31m.json"], "nowhere\\x1b[31m.json: No such file or directory"),
    ],
)
def test_wrong_options_are_refused(dataset: Path, options: list[str], message: str) -> None:
    before = contents(dataset)
    assert message in refused(dataset, *options)
    assert contents(dataset) == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "variants.json: "),
        ("{", "variants.json: "),
        ("[" * 100_000, "variants.json: "),
        ('[{"name": "x", "name": "y"}]', "variants.json: "),
        ("[NaN]", "variants.json: "),
        ("\xff", "variants.json: "),
        (" " * (1 << 24), "variants.json: "),
        ("{}", "variants are a list"),
        ("[1]", "variant 0: expected an object with `name`, `title` and `where`"),
        ('[{"name": "x\\u001b", "title": "t", "where": {"eligible": true}}]', "variant 0: `name` must match"),
        ('[{"name": "x", "title": "a\\nb", "where": {"eligible": true}}]', "must be one printable line"),
        ('[{"name": "x", "title": "t", "where": {"group_id": true}}]', "are not flags of `group_quality`"),
        ('[{"name": "x", "title": "t", "where": {"eligible": 1}}]', "`where` must give true or false"),
        ('[{"name": "frozen", "title": "t", "where": {"eligible": true}}]', "the name 'frozen' is taken"),
    ],
)
def test_variants_that_cannot_be_declared_are_refused(dataset: Path, tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "variants.json").write_bytes(text.encode("latin-1"))
    before = contents(dataset)
    assert message in refused(dataset, "--variants", tmp_path / "variants.json")
    assert contents(dataset) == before


def test_an_unknown_stage_is_refused(dataset: Path) -> None:
    for stages in ((), ("raw",), ("canonical", "benchmark")):
        with pytest.raises(UsageError, match="stages are canonical, quality, leakage, model; found"):
            build(dataset, stages=stages)


# --- places


def test_an_output_in_the_dataset_or_around_it_is_refused(dataset: Path, tmp_path: Path) -> None:
    before = contents(tmp_path)
    assert "lies inside" in refused(dataset, "--output", dataset / "release")
    assert "lies inside" in refused(dataset, "--output", dataset / "raw" / "release")
    assert "lies inside" in refused(dataset, "--output", tmp_path)
    (tmp_path / "link").symlink_to(dataset / "raw")
    assert "lies inside" in refused(dataset, "--output", tmp_path / "link")
    assert contents(tmp_path) == before


def test_an_output_that_holds_another_raw_layer_is_refused(raw: Path, dataset: Path) -> None:
    before = contents(dataset)
    assert "holds a raw layer; give a detached release a folder of its own" in refused(raw, "--output", dataset)
    assert contents(dataset) == before


def test_an_output_that_is_a_file_or_a_link_to_nowhere_is_refused(raw: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for place in ("file", "file/release", "link"):
        refused(raw, "--output", tmp_path / place)
    assert (tmp_path / "file").read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize(
    "name", [STAGING_DIR, "canonical", "quality", "README.md", ".branchdrive.json.partial", "MANIFEST.sha256"]
)
@pytest.mark.parametrize("detached", [False, True])
def test_nothing_is_written_through_a_link(raw: Path, tmp_path: Path, name: str, detached: bool) -> None:
    root = tmp_path / "release" if detached else shutil.copytree(raw, tmp_path / "release")
    root.mkdir(exist_ok=True)
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "file").write_text("mine")
    is_folder = "." not in name or name == STAGING_DIR
    (root / name).unlink(missing_ok=True)
    (root / name).symlink_to(outside if is_folder else outside / "file")
    if detached:
        (root / DESCRIPTOR_FILE).write_bytes((raw / DESCRIPTOR_FILE).read_bytes())
    err = refused(raw, "--output", root) if detached else refused(root)
    assert "is a link; a build writes into plain folders only, remove it" in err or "MANIFEST.sha256" in err
    assert contents(outside) == {"file": b"mine"}


@pytest.mark.parametrize("detached", [False, True])
def test_a_text_of_somebodys_own_is_not_overwritten(raw: Path, tmp_path: Path, detached: bool) -> None:
    root = tmp_path / "release" if detached else shutil.copytree(raw, tmp_path / "release")
    root.mkdir(exist_ok=True)
    (root / "README.md").write_text("mine")
    err = refused(raw, "--output", root) if detached else refused(root)
    assert "README.md is a text of your own" in err
    assert (root / "README.md").read_text() == "mine"
    if not detached:
        build(root, stages=["canonical"])
        assert (root / "README.md").read_text() == "mine"
        assert breaches(root) == set()
        (root / "README.md").unlink()
        build(root)
        build(root, seed=7)
        assert breaches(root) == set()


def test_hostile_names_are_printed_safely(raw: Path, tmp_path: Path) -> None:
    root = shutil.copytree(raw, tmp_path / "nö\x1b[31m\u202e\nx")
    (root / MANIFEST_FILE).unlink()
    assert "nö\\x1b[31m\\u202e\\nx" in refused(root)
    (tmp_path / "a\x1bfile").write_text("")
    assert "a\\x1bfile" in refused(raw, "--output", tmp_path / "a\x1bfile" / "release")


def test_a_folder_that_cannot_be_written_is_one_line(
    dataset: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    before = contents(dataset)

    def denied(folder: Path, *_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied", os.fspath(folder))

    monkeypatch.setattr(Path, "mkdir", denied)
    assert "Permission denied" in refused(dataset)
    assert "Permission denied" in refused(dataset, "--output", tmp_path / "release")
    assert contents(dataset) == before


def test_a_full_disk_is_one_line_and_the_next_build_goes_on(
    dataset: Path, built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("branchdrive.release.publish.write_file", full)
        line = refused(dataset, exit_code=4)
    assert line.startswith("branchdrive: No space left on device; make room on its disk")
    build(dataset)
    assert contents(dataset) == contents(built)


def test_a_bank_with_an_encoding_of_its_own_has_no_model_layer(tmp_path: Path) -> None:
    document = raw_descriptor()
    document["action_encoding"] = {**document["action_encoding"], "name": "own-1"}
    root = Draft(raw_tables(), document).write(tmp_path / "dataset")
    before = contents(root)
    for place in ([], ["--stage", "model"], ["--output", tmp_path / "release"]):
        assert "the action encoding 'own-1' is the dataset's own and cannot be computed" in refused(root, *place)
    assert contents(root) == before
    assert not (tmp_path / "release").exists()
    assert call("build", root, "--stage", "canonical", "--stage", "quality")[0] == 0
    assert not (root / STAGING_DIR).exists()
    assert not (root / "model").exists()
    assert "model" not in json.loads((root / DESCRIPTOR_FILE).read_bytes())["layers"]
