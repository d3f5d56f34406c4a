"""Versions that a bucket lists in the place of bytes: where it is asked for, and where these were read before."""

from __future__ import annotations

import json
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import obstore
import pytest
from obstore.store import MemoryStore
from tests.audits import remember_audits
from tests.bucket_server import BucketServer, serving, use
from tests.places import files_of, packed
from tests.validator.engine.datasets import OTHER_FOLDER, cells, write
from tests.validator.engine.test_cache import without_cache

from branchdrive.cli.main import run
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.engine.cache import Cache
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.private_folder import PrivateFolder

URL = "s3://bucket/drive"
SHARDS = {"raw/shard-00000", OTHER_FOLDER}
LINE = "the versions that the store lists stood for the bytes of 2 of 2 shards, which were not read"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, root: Path) -> Iterator[BucketServer]:
    remember_audits(monkeypatch)
    with serving() as running:
        use(running, monkeypatch)
        running.fill(root, "drive")
        yield running


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The valid dataset of two shards, which no test changes."""
    return write(tmp_path_factory.mktemp("trusted") / "dataset")


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache", trust_versions=True)


def test_of_a_dataset_that_is_kept_nothing_is_read_but_its_documents(server: BucketServer, cache: Cache) -> None:
    filling = validate(URL, cache=cache)
    assert filling.cached is not None and not filling.cached.by_version
    server.requests.clear()
    report = validate(URL, cache=cache)
    assert server.requests == [("GET", ""), ("GET", f"drive/{MANIFEST_FILE}"), ("GET", f"drive/{DESCRIPTOR_FILE}")]
    assert report.cached is not None and report.cached.shards == report.cached.by_version == SHARDS
    assert without_cache(report) == without_cache(filling)
    assert report.conditions[-1] == LINE
    document = json.loads(json.dumps(report.to_json()))
    assert document["cached"]["by_version"] == 2
    assert schema_mismatches(document, "report.schema.json") == []


def test_versions_are_noted_where_results_are_taken_by_digest(server: BucketServer, cache: Cache) -> None:
    validate(URL, cache=Cache(cache.path))
    noting = validate(URL, cache=cache).cached
    assert noting is not None and (noting.shards, noting.by_version) == (SHARDS, set())
    taking = validate(URL, cache=cache).cached
    assert taking is not None and taking.by_version == SHARDS


def test_an_object_of_another_version_is_read(server: BucketServer, cache: Cache, tmp_path: Path) -> None:
    validate(URL, cache=cache)
    server.fill(write(tmp_path / "changed", cells("observations", "speed_mps", {3: 1000.0})), "drive")
    report = validate(URL, cache=cache)
    assert report.cached is not None and report.cached.shards == report.cached.by_version == {OTHER_FOLDER}
    assert report.verdict == "invalid"
    assert without_cache(report) == without_cache(validate(URL))


def test_damaged_notes_are_none(server: BucketServer, cache: Cache) -> None:
    validate(URL, cache=cache)
    folder = Path(cache.path)
    notes = [path for path in folder.iterdir() if path.stat().st_size < 4000]
    assert len(notes) == 2
    notes[0].write_bytes(notes[0].read_bytes()[:-1])
    PrivateFolder(folder).put(notes[1].stem, b'{"raw/shard-00009/x": "0"}')
    report = validate(URL, cache=cache)
    assert report.cached is not None
    assert (report.cached.num_damaged, report.cached.by_version, report.cached.shards) == (0, set(), SHARDS)
    again = validate(URL, cache=cache).cached
    assert again is not None and again.by_version == SHARDS


def test_a_store_that_lies_about_versions_is_an_error_where_it_is_judged_again(
    server: BucketServer, cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.bucket_server._tag", lambda content: f'"{len(content)}"')
    validate(URL, cache=cache)
    key = f"drive/{OTHER_FOLDER}/actors.parquet"
    content = server.objects[key]
    server.objects[key] = content[:1000] + bytes([content[1000] ^ 1]) + content[1001:]
    assert validate(URL, cache=cache).verdict == "valid"  # whose versions are trusted is believed
    report = validate(URL, cache=Cache(cache.path, recheck=1.0, trust_versions=True))
    assert (report.verdict, report.exit_code) == ("error", 4)
    (error,) = report.errors
    assert f"{OTHER_FOLDER}/actors.parquet: the store gives other bytes for one version" in error


def test_versions_are_of_one_place_and_one_time(server: BucketServer, monkeypatch: pytest.MonkeyPatch) -> None:
    path = DESCRIPTOR_FILE
    bucket = Bucket.open_url(URL)
    known = {bucket.lasting_version(path)}
    for other in (f"{URL}-2", "s3://bucket/drive/raw/.."):
        known.add(Bucket(other, bucket.versions).lasting_version(path))
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    known.add(bucket.lasting_version(path))
    assert len(known) == 4 and None not in known
    assert bucket.lasting_version("none") is None
    (version,) = {bucket.versions[path]}
    for weak in ({"e_tag": None}, {"e_tag": 'W/"1"'}, {"modified": None}):
        changed = type(version)(**{**vars(version), **weak})
        assert Bucket(URL, {path: changed}).lasting_version(path) is None


def test_only_buckets_have_versions_to_trust(root: Path, server: BucketServer, cache: Cache, tmp_path: Path) -> None:
    memory = MemoryStore()
    for path, content in files_of(root).items():
        obstore.put(memory, path, content)
    places: list[Place] = [
        root, packed(root, tmp_path / "drive.zip"), open_store(memory), f"{server.url}/bucket/drive"
    ]  # fmt: skip
    for place in places:
        with pytest.raises(UsageError, match="only a bucket lists versions that can be trusted"):
            validate(place, cache=cache)
    with pytest.raises(UsageError, match="a strict validation"):
        validate(URL, cache=cache, strict=True)
    stderr = StringIO()
    assert run(["validate", URL, "--trust-versions"], StringIO(), stderr) == 2
    assert "name one with `--cache`" in stderr.getvalue()
    stdout = StringIO()
    for _ in range(2):
        assert run(["validate", URL, "--trust-versions", "--cache", str(cache.path)], stdout, StringIO()) == 0
    assert LINE in " ".join(stdout.getvalue().split())
