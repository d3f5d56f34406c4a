"""A cache in a bucket: what it gives is what a folder gives, and what it does wrong costs no verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import timedelta
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from tests.audits import remember_audits
from tests.bucket_server import BucketServer, Fault, serving, use
from tests.validator.engine.datasets import OTHER_FOLDER, write
from tests.validator.engine.test_cache import without_cache

from branchdrive.cli.main import run
from branchdrive.engine.cache import Cache, CacheUse
from branchdrive.engine.validate import validate
from branchdrive.errors import PlatformError, UsageError
from branchdrive.formats import entry, object_client
from branchdrive.formats.entry import DamagedError
from branchdrive.formats.private_prefix import PrivatePrefix
from branchdrive.runtime.executor import isolated

URL = "s3://bucket/team/cache"
SHARDS = {"raw/shard-00000", OTHER_FOLDER}


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[BucketServer]:
    backoff = {"init_backoff": timedelta(milliseconds=1), "max_backoff": timedelta(milliseconds=2), "base": 2}
    retries = {"max_retries": 2, "retry_timeout": timedelta(milliseconds=500), "backoff": backoff}
    monkeypatch.setattr(object_client, "BRIEF_RETRIES", retries)
    monkeypatch.setattr(object_client, "BRIEF_TIMEOUTS", {"timeout": timedelta(milliseconds=500)})
    with serving() as running:
        use(running, monkeypatch)
        yield running


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The valid dataset of two shards, which no test changes."""
    return write(tmp_path_factory.mktemp("cached") / "dataset")


@pytest.fixture(autouse=True)
def audits(monkeypatch: pytest.MonkeyPatch) -> None:
    remember_audits(monkeypatch)


@pytest.fixture(scope="module")
def expected(root: Path) -> str:
    return without_cache(validate(root))


def entries(server: BucketServer) -> list[str]:
    return sorted(key for key in server.objects if key.startswith("team/cache/"))


def test_what_one_run_keeps_another_takes_by_one_request_a_shard(
    root: Path, expected: str, server: BucketServer
) -> None:
    filling = validate(root, cache=Cache(URL))
    assert (without_cache(filling), filling.cached) == (expected, CacheUse())
    assert (server.num("GET"), server.num("PUT"), len(server.requests)) == (2, 2, 4)
    assert server.checked == [key for method, key in server.requests if method == "PUT"]
    server.requests.clear()
    taking = validate(root, cache=Cache(f"{URL}/", recheck=1.0))
    assert without_cache(taking) == expected
    assert taking.cached == CacheUse(SHARDS, versions={taking.validator_version}, num_rechecked=2)
    assert sorted(server.requests) == [("GET", key) for key in entries(server)]


def test_workers_share_it_for_a_dataset_in_a_bucket(root: Path, expected: str, server: BucketServer) -> None:
    server.fill(root, "drive")
    for num_taken in (0, 2):
        report = validate("s3://bucket/drive", cache=Cache(URL), executor=isolated(2))
        assert report.cached is not None and len(report.cached.shards) == num_taken
        assert without_cache(report).replace("s3://bucket/drive", str(root)) == expected
    assert len(entries(server)) == 2


DAMAGES: dict[str, Callable[[bytes, bytes], bytes]] = {
    "a bit is another": lambda one, _: one[:-1] + bytes([one[-1] ^ 1]),
    "cut off": lambda one, _: one[: len(one) // 2],
    "empty": lambda *_: b"",
    "another entry": lambda _, other: other,
    "foreign": lambda *_: b"\x80\x04cos\nsystem\n.",
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_object_is_none_and_gives_way(damage: str, root: Path, expected: str, server: BucketServer) -> None:
    validate(root, cache=Cache(URL))
    one, other = entries(server)
    sound = server.objects[one]
    server.objects[one] = DAMAGES[damage](sound, server.objects[other])
    report = validate(root, cache=Cache(URL))
    assert without_cache(report) == expected
    assert report.cached is not None and (report.cached.num_damaged, len(report.cached.shards)) == (1, 1)
    assert server.objects[one] == sound
    taking = validate(root, cache=Cache(URL)).cached
    assert taking is not None and taking.shards == SHARDS


def test_an_object_that_is_too_large_is_not_read(
    root: Path, server: BucketServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    prefix = PrivatePrefix.at(URL)
    prefix.put("name", b"x" * 1000)
    assert prefix.get("name") == b"x" * 1000
    monkeypatch.setattr("branchdrive.formats.private_prefix.MAX_ENTRY_BYTES", 1000)
    with pytest.raises(DamagedError):
        prefix.get("name")
    monkeypatch.setattr(entry, "MAX_ENTRY_BYTES", 1000)
    prefix.put("other", b"x" * 1000)
    assert [*server.objects] == ["team/cache/name.entry"]


def test_the_first_of_several_writers_stays_and_damage_gives_way_once(server: BucketServer) -> None:
    prefix = PrivatePrefix.at(URL)
    for value in (b"first", b"second"):
        prefix.put("name", value)
    assert prefix.get("name") == b"first"
    assert server.written["team/cache/name.entry"] == 1
    server.objects["team/cache/name.entry"] = b"damaged"
    prefix.put("name", b"third")
    assert prefix.get("name") == b"third"


def fill(root: Path) -> str:
    """Validate with a cache, in a process of a pool."""
    return without_cache(validate(root, cache=Cache(URL)))


def test_two_runs_share_it(root: Path, expected: str, server: BucketServer) -> None:
    assert dict(isolated(2)(fill, [root] * 2)) == {0: expected, 1: expected}
    assert [server.written[key] for key in entries(server)] == [1, 1]


FAULTS: dict[Fault, str] = {
    "503": "answered with status 503",
    "403": "refuses access",
    "cut": "the store",
    "hang": "did not answer in time",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_store_that_fails_is_asked_for_no_second_task(
    fault: Fault, root: Path, expected: str, server: BucketServer
) -> None:
    validate(root, cache=Cache(URL))
    server.faults.update({key: [fault] for key in entries(server)})
    server.requests.clear()
    report = validate(root, cache=Cache(URL))
    assert without_cache(report) == expected
    assert report.cached is not None and report.cached.num_unasked == 2
    (line,) = report.cached.conditions(2)
    assert line.startswith("the cache did not serve 2 tasks, judged without it: s3://bucket/team/cache/")
    assert FAULTS[fault] in line and "secret" not in line and "again later" not in line
    assert line in report.conditions and report.to_json()["cached"]["unasked"] == 2
    assert len({key for _, key in server.requests}) == 1


def test_a_store_that_takes_nothing_costs_no_verdict(root: Path, expected: str, server: BucketServer) -> None:
    validate(root, cache=Cache(URL))
    keys = entries(server)
    server.objects.clear()
    server.faults.update({key: [None, "403"] for key in keys})
    report = validate(root, cache=Cache(URL))
    assert without_cache(report) == expected
    assert report.cached is not None and report.cached.num_unasked == 2
    missing = validate(root, cache=Cache("s3://another/cache"))
    assert missing.cached is not None and "there is no such bucket" in missing.cached.fault
    assert entries(server) == []


def test_a_folder_that_cannot_be_written_costs_no_verdict(
    root: Path, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise PermissionError(13, "Permission denied", str(tmp_path))

    monkeypatch.setattr("branchdrive.formats.private_folder.PrivateFolder.put", refuse)
    report = validate(root, cache=Cache(tmp_path / "cache"))
    assert without_cache(report) == expected
    assert report.cached is not None and "Permission denied" in report.cached.fault


def test_it_does_not_serve_every_validation(root: Path, server: BucketServer, monkeypatch: pytest.MonkeyPatch) -> None:
    server.fill(root, "drive")
    for options in (["--strict"], ["--cache-size", "1"]):
        stderr = StringIO()
        assert run(["validate", str(root), "--cache", URL, *options], StringIO(), stderr) == 2
        assert options[0].strip("-") in stderr.getvalue()
    for url, reason in (
        ("https://example.org/cache", "takes no files"),
        ("ftp://example.org/cache", "no URL of a dataset"),
        ("s3://bucket/drive/cache", "lies inside the dataset"),
    ):
        with pytest.raises(UsageError, match=reason):
            validate("s3://bucket/drive", cache=Cache(url))
    assert server.num("PUT") == 0
    monkeypatch.setattr(object_client, "find_spec", lambda _: None)
    with pytest.raises(PlatformError, match="the extra `cloud`"):
        validate(root, cache=Cache(URL))
