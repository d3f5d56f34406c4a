"""A dataset says the same wherever it is: in a folder, in memory, in a bucket, in an archive, on the web."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import obstore
import pytest
from obstore.store import MemoryStore
from tests import hub_server, synthetic
from tests.bucket_server import BucketServer, serving, use
from tests.places import files_of, packed
from tests.sampling import sampled
from tests.validator.engine.datasets import write
from tests.validator.engine.rules.release import detached_draft, release_draft

from branchdrive.cli.main import run as run_command
from branchdrive.engine.cache import Cache
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.model.reader import open_model
from branchdrive.pilot.pilot import read_pilot
from branchdrive.pilot.report import examine_pilot
from branchdrive.raw.reader import open_dataset
from branchdrive.runtime.executor import isolated

SHARD = "raw/shard-00001"


@dataclass
class Places:
    """One dataset in every place."""

    folder: Path
    server: BucketServer

    def at(self, kind: str) -> Place:
        """The dataset in a place of a kind."""
        if kind == "memory":
            memory = MemoryStore()
            for path, content in files_of(self.folder).items():
                obstore.put(memory, path, content)
            return open_store(memory)
        return {
            "folder": self.folder,
            "bucket": f"s3://bucket/{self.folder.name}",
            "archive": self.folder.with_suffix(".zip"),
            "archive in a bucket": f"s3://bucket/{self.folder.name}.zip",
            "web": f"{self.server.url}/bucket/{self.folder.name}",
        }[kind]


def spread(folder: Path, server: BucketServer) -> Places:
    """Put a dataset everywhere."""
    packed(folder, folder.with_suffix(".zip"))
    server.fill(folder, folder.name)
    server.objects[f"{folder.name}.zip"] = folder.with_suffix(".zip").read_bytes()
    return Places(folder, server)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[BucketServer]:
    with serving() as running:
        use(running, monkeypatch)
        yield running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A valid dataset with media and few attempts, which no test changes."""
    folder, tables = tmp_path_factory.mktemp("places") / "drive", synthetic.with_few_attempts(synthetic.media_tables())
    synthetic.write_dataset(folder, tables, synthetic.media_descriptor())
    return folder


@pytest.fixture(scope="module")
def expected(folder: Path) -> dict[str, Any]:
    """What the report on the folder says."""
    return told(folder)


@pytest.fixture
def raw(folder: Path, server: BucketServer) -> Places:
    """The same in every place."""
    return spread(folder, server)


def told(place: Place, **options: Any) -> dict[str, Any]:
    """What a report says, but for where the dataset is."""
    report: dict[str, Any] = validate(place, **options).to_json()
    del report["dataset"]["path"]
    return report


KINDS = ("memory", "bucket", "archive", "archive in a bucket")


@pytest.mark.parametrize("kind", KINDS)
def test_reports_on_a_raw_dataset_are_equal(raw: Places, expected: dict[str, Any], kind: str) -> None:
    assert expected["verdict"] == "valid"
    assert told(raw.at(kind)) == expected


@pytest.mark.parametrize("kind", sampled(["bucket", "archive"], every=2))
def test_reports_of_worker_processes_are_equal(raw: Places, expected: dict[str, Any], kind: str) -> None:
    assert told(raw.at(kind), executor=isolated(1)) == expected


@pytest.mark.parametrize("kind", sampled(["bucket", "archive"], every=2))
def test_a_cache_serves_every_place(raw: Places, expected: dict[str, Any], tmp_path: Path, kind: str) -> None:
    folder, taken = tmp_path / "cache", []
    for place in (raw.at(kind), raw.folder, raw.at(kind)):
        found = told(place, cache=Cache(folder))
        taken.append(found.pop("cached")["shards"])
        found["conditions"] = [line for line in found["conditions"] if "judged by an earlier run" not in line]
        assert found == {key: value for key, value in expected.items() if key != "cached"}
    num_shards = validate(raw.folder).dataset.num_shards
    assert taken == [0, num_shards, num_shards]


def test_a_cache_inside_the_folder_of_a_dataset_is_refused_however_it_is_named(folder: Path) -> None:
    for place in (folder, str(folder), open_store(folder)):
        with pytest.raises(UsageError, match="lies inside the dataset"):
            validate(place, cache=Cache(folder / "cache"))


@pytest.mark.parametrize("kind", ["bucket", "archive"])
def test_reports_on_what_is_wrong_are_equal(tmp_path: Path, server: BucketServer, kind: str) -> None:
    folder = write(tmp_path / "drive")
    (folder / SHARD / "controls.parquet").unlink()
    (folder / SHARD / "actors.parquet").write_bytes(b"other")
    (folder / "raw/notes.txt").write_text("x")
    (folder / ".branchdriveignore").write_text("scratch\n")
    (folder / "scratch").write_text("x")
    expected = told(folder)
    assert expected["verdict"] == "invalid"
    assert told(spread(folder, server).at(kind)) == expected


def test_reports_on_a_release_are_equal(tmp_path: Path, server: BucketServer, monkeypatch: pytest.MonkeyPatch) -> None:
    places = spread(release_draft().write(tmp_path / "release"), server)
    expected = told(places.folder)
    assert expected["verdict"] == "valid"
    plain = open_model(places.folder).targets("test").scalars
    assert told(places.at("bucket")) == expected
    for kind in ("bucket", "archive"):
        assert np.array_equal(open_model(places.at(kind)).targets("test").scalars, plain, equal_nan=True)
    with hub_server.serving() as hub:
        hub_server.use(hub, monkeypatch)
        hub.fill(places.folder)
        ours = open_model("hf://datasets/org/name@main").targets("test").scalars
    assert np.array_equal(ours, plain, equal_nan=True)


def test_a_detached_release_and_its_raw_layer_may_be_in_two_places(tmp_path: Path, server: BucketServer) -> None:
    draft = detached_draft(with_raw=True)
    release = spread(draft.write(tmp_path / "release"), server)
    assert draft.raw is not None
    raw = spread(draft.raw.write(tmp_path / "source"), server)
    expected, found = told(release.folder, raw=raw.folder), told(release.at("bucket"), raw=raw.at("archive"))
    assert expected["verdict"] == "valid"
    assert found["dataset"].pop("raw_path") == str(raw.at("archive"))
    del expected["dataset"]["raw_path"]
    assert found == expected


def test_a_pilot_is_examined_anywhere(raw: Places) -> None:
    def said(kind: str) -> dict[str, Any]:
        report = examine_pilot(read_pilot(raw.at(kind)), None, num_kills=1)
        return {section.name: section.to_json() for section in report.sections if section.name != "cost"}

    assert said("bucket") == said("archive") == said("folder")


@pytest.mark.parametrize("kind", KINDS)
def test_rollouts_and_images_are_read_from_anywhere(raw: Places, kind: str) -> None:
    ours, plain = open_dataset(raw.at(kind)), open_dataset(raw.folder)
    assert ours.groups == plain.groups
    mine, theirs = ours.group(ours.groups[0]), plain.group(plain.groups[0])
    assert mine.nominal.tables["controls"] == theirs.nominal.tables["controls"]
    camera = plain.descriptor.cameras[0].name
    assert mine.nominal.frames(camera)[0].read() == theirs.nominal.frames(camera)[0].read()


def test_a_dataset_on_the_hub_says_the_same_in_worker_processes_too(
    folder: Path, expected: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with hub_server.serving() as hub:
        hub_server.use(hub, monkeypatch)
        commit = hub.fill(folder, "drive")
        report = validate("hf://org/name@main/drive", executor=isolated(1)).to_json()
        ours, plain = open_dataset("hf://org/name/drive"), open_dataset(folder)
    assert report["dataset"].pop("path") == f"hf://org/name@{commit}/drive"
    assert report == expected
    assert ours.groups == plain.groups


def test_commands_say_what_is_wrong_with_the_hub_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with hub_server.serving() as hub:
        hub_server.use(hub, monkeypatch)
        hub.commit({"top": b""})
        for url, status, code in (("hf://org/none", None, 2), ("hf://org/name", 403, 4), ("hf://org/name", 500, 4)):
            if status is not None:
                hub.status["revision"] = status
            out, err = io.StringIO(), io.StringIO()
            assert run_command(["validate", url], out, err) == code, err.getvalue()
            assert (out.getvalue(), err.getvalue().count("\n")) == ("", 1)


def test_a_report_takes_one_listing_and_one_request_a_file(raw: Places, server: BucketServer) -> None:
    server.requests.clear()
    validate(raw.at("bucket"))
    assert server.num("GET") == 1 + len(files_of(raw.folder))
    assert server.num("HEAD") == 0
    assert sum(key == "" for _, key in server.requests) == 1


def test_an_image_takes_one_request(raw: Places, server: BucketServer) -> None:
    dataset = open_dataset(raw.at("bucket"))
    frames = dataset.group(dataset.groups[0]).nominal.frames(dataset.descriptor.cameras[0].name)
    server.requests.clear()
    frames[1].read()
    assert [key.rsplit("/", 1)[1] for _, key in server.requests] == ["media.bin"]


def test_the_web_says_what_it_cannot_see(raw: Places, expected: dict[str, Any]) -> None:
    found = told(raw.at("web"))
    assert found["verdict"] == "partial"
    [rule] = [rule for rule in found["rules"] if rule not in expected["rules"]]
    assert (rule["id"], rule["status"]) == ("BD-LAY-004", "skipped")
    assert "lists nothing" in rule["reason"]


CHANGES: dict[str, Callable[[dict[str, bytes], str], object]] = {
    "changed": lambda objects, key: objects.update({key: objects[key][:-1] + b"\0"}),
    "grown": lambda objects, key: objects.update({key: objects[key] + b"\0"}),
    "removed": lambda objects, key: objects.pop(key),
}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        *(("controls.parquet", change) for change in CHANGES),
        *sampled((("media.bin", change) for change in CHANGES), every=3),
    ],
)
def test_what_changes_after_the_listing_is_a_finding_on_its_file(
    raw: Places, server: BucketServer, name: str, change: str
) -> None:
    store = open_store(raw.at("bucket"))
    CHANGES[change](server.objects, f"drive/{SHARD}/{name}")
    report = validate(store)
    assert report.verdict == "invalid"
    incomplete = "BD-BNK-001"  # few attempts make no whole bank
    files = {finding.location.get("file") for finding in report.findings if finding.rule != incomplete}
    assert files == {f"{SHARD}/{name}"}
    how = "removed" if change == "removed" else "changed"
    assert any(f"was {how} after it was listed" in finding.message for finding in report.findings)


@pytest.mark.parametrize("has_cache", [False, True])
def test_a_store_that_fails_ends_the_run_and_gives_no_verdict(
    raw: Places, server: BucketServer, tmp_path: Path, has_cache: bool
) -> None:
    server.faults[f"drive/{SHARD}/controls.parquet"] = ["403"]
    out, errors = io.StringIO(), io.StringIO()
    options = ["--cache", str(tmp_path / "cache")] if has_cache else []
    assert run_command(["validate", str(raw.at("bucket")), *options], out, errors) == 4
    assert out.getvalue() == ""
    assert errors.getvalue().count("\n") == 1
    assert "refuses access" in errors.getvalue()
    assert "-of-the-test" not in errors.getvalue()


@pytest.mark.parametrize("key", ["drive/raw//x", "drive/../x", "drive/raw/a\x01"])
def test_keys_that_no_folder_could_hold_are_findings(raw: Places, server: BucketServer, key: str) -> None:
    server.objects[key] = b"x"
    report = validate(raw.at("bucket"))
    assert report.verdict == "invalid"
    [finding] = report.findings
    assert finding.rule == "BD-LAY-007"
    assert "is none that a folder could hold" in finding.message


def test_an_object_beside_a_folder_of_its_name_is_a_finding(raw: Places, server: BucketServer) -> None:
    server.objects[f"drive/{SHARD}"] = b"x"
    report = validate(raw.at("bucket"))
    assert [one.location for one in report.findings if one.rule == "BD-LAY-006"] == [{"file": SHARD}]


def test_no_dataset_is_wrong_usage(tmp_path: Path, server: BucketServer) -> None:
    errors = io.StringIO()
    assert run_command(["validate", "s3://bucket/nothing"], io.StringIO(), errors) == 2
    assert "holds no dataset" in errors.getvalue()


def test_commands_that_read_take_every_place(raw: Places) -> None:
    said = {}
    for kind in ("folder", "bucket", "archive"):
        out = io.StringIO()
        assert run_command(["study", str(raw.at(kind))], out, io.StringIO()) == 0
        said[kind] = out.getvalue()
    assert said["folder"] == said["bucket"] == said["archive"]
    out = io.StringIO()
    assert run_command(["diff", str(raw.at("archive")), str(raw.at("bucket"))], out, io.StringIO()) == 0
    assert out.getvalue() == "files equal by their manifests, data equal\n"


def test_a_place_is_a_value(raw: Places) -> None:
    store = open_store(raw.at("bucket"))
    assert isinstance(store, Store)
    assert open_store(store) is store
