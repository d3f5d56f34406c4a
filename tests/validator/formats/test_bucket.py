"""A bucket on loopback: every version is pinned, faults of the store are no findings, and no secret is shown."""

from __future__ import annotations

import os
import pickle
import signal
from collections.abc import Callable, Iterator
from datetime import timedelta

import obstore
import pytest
from obstore.store import MemoryStore
from tests.bucket_server import BucketServer, Fault, serving, use

from branchdrive.errors import DatasetError, PlatformError, UsageError
from branchdrive.formats import bucket as bucket_module
from branchdrive.formats import object_client
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.place import open_store
from branchdrive.formats.store import Entry

URL = "s3://bucket/data/set"
KEY = "data/set/raw/plain"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[BucketServer]:
    """A bucket with a small folder in it, and a patience that tests have."""
    backoff = {"init_backoff": timedelta(milliseconds=1), "max_backoff": timedelta(milliseconds=2), "base": 2}
    monkeypatch.setattr(
        object_client, "RETRIES", {"max_retries": 4, "retry_timeout": timedelta(seconds=5), "backoff": backoff}
    )
    with serving() as running:
        use(running, monkeypatch)
        running.objects |= {KEY: b"content", "data/set/top": b"top", "data/set2/other": b"x"}
        yield running


def test_it_lists_what_is_below_its_prefix_alone(server: BucketServer) -> None:
    store = open_store(URL)
    assert store.entries()[1] == [Entry("raw", "folder", 0, "raw"), Entry("top", "file", 3, "top")]
    assert (store.names("raw"), store.names("none")) == (["plain"], [])
    assert store.status("raw/plain") == Entry("raw/plain", "file", 7, "raw/plain")
    assert store.status("raw/none") is None
    assert (str(store), store.place("raw/plain")) == (URL, f"{URL}/raw/plain")


@pytest.mark.parametrize("slashes", ["", "/"])
def test_a_slash_at_the_end_says_nothing(server: BucketServer, slashes: str) -> None:
    assert open_store(URL + slashes).read("raw/plain", 7) == b"content"


def test_pages_and_the_order_of_a_listing_change_nothing(server: BucketServer) -> None:
    server.objects |= {f"data/set/many/{number:03d}": b"" for number in range(25)}
    expected = open_store(URL).names("many")
    server.page, server.is_reversed = 10, True
    assert open_store(URL).names("many") == expected == [f"{number:03d}" for number in range(25)]


def test_reading_takes_one_request_and_no_question_before_it(server: BucketServer) -> None:
    store = open_store(URL)
    server.requests.clear()
    assert store.read("raw/plain", 100) == b"content"
    with store.open("raw/plain") as stream:
        stream.seek(3)
        assert stream.read(2) == b"te"
    assert server.requests == [("GET", KEY), ("GET", KEY)]


def test_it_travels_with_its_versions_and_without_secrets(server: BucketServer) -> None:
    store = open_store(URL)
    store.read("raw/plain", 7)
    content = pickle.dumps(store)
    assert b"-of-the-test" not in content
    server.requests.clear()
    travelled = pickle.loads(content)
    assert (travelled.read("raw/plain", 7), server.num("GET", "")) == (b"content", 1)
    assert list(travelled.only(["raw/plain", "none"]).pinned) == ["raw/plain"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda objects: objects.update({KEY: b"CONTENT"}), "was changed after it was listed"),
        (lambda objects: objects.update({KEY: b"content and more"}), "was changed after it was listed"),
        (lambda objects: objects.pop(KEY), "was removed after it was listed"),
    ],
    ids=["changed", "grown", "removed"],
)
@pytest.mark.parametrize("fault", [None, "ignores condition"])
def test_bytes_of_another_version_are_not_read(
    server: BucketServer, change: Callable[[dict[str, bytes]], object], message: str, fault: Fault | None
) -> None:
    store = open_store(URL)
    server.faults[KEY] = [fault]
    change(server.objects)
    for start in (0, 2):
        with store.open("raw/plain") as stream, pytest.raises(DatasetError, match=f"'raw/plain' {message}"):
            stream.seek(start)
            stream.read(3)


def test_an_object_that_changes_while_it_is_read_is_seen(server: BucketServer) -> None:
    server.objects[KEY] = bytes(3 << 20)
    with open_store(URL).open("raw/plain") as stream:
        stream.read(100)
        server.objects[KEY] = b"\1" * (3 << 20)
        with pytest.raises(DatasetError, match="was changed"):
            stream.read(2 << 20)


@pytest.mark.parametrize(
    "faults", [["503", "503", "503", None], ["500", None], ["cut", None]], ids=["throttled", "failed", "cut"]
)
def test_what_goes_by_is_asked_for_again(server: BucketServer, faults: list[Fault | None]) -> None:
    store = open_store(URL)
    server.faults[KEY] = faults
    assert store.read("raw/plain", 7) == b"content"


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("503", "answered with status 503"),
        ("500", "answered with status 500"),
        ("403", "refuses access; look at the credentials"),
        ("cut", "could not be read"),
        ("ignores range", "cannot serve a part"),
        ("hang", "did not answer in time"),
    ],
)
def test_what_does_not_go_by_is_the_fault_of_the_store(
    server: BucketServer, monkeypatch: pytest.MonkeyPatch, fault: Fault, message: str
) -> None:
    monkeypatch.setattr(object_client, "TIMEOUTS", {"timeout": timedelta(milliseconds=300)})
    monkeypatch.setitem(object_client.RETRIES, "retry_timeout", timedelta(milliseconds=500))
    store = open_store(URL)
    server.faults[KEY] = [fault]
    with store.open("raw/plain") as stream:
        stream.seek(1)
        with pytest.raises(PlatformError) as caught:
            stream.read(3)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not any(secret in str(caught.value) for secret in ("-of-the-test", "-of-the-store"))
    assert caught.value.__suppress_context__


def test_a_listing_that_is_refused_is_no_empty_dataset(server: BucketServer) -> None:
    server.faults[""] = ["403"]
    with pytest.raises(PlatformError, match="refuses access"):
        open_store(URL)
    with pytest.raises(UsageError, match="no such bucket"):
        open_store("s3://other-bucket/data")


@pytest.mark.parametrize(
    "url",
    [
        "ftp://host/data", "http://example.org/data", "s3://", "s3:///data", "s3://key:word@bucket/data",
        "s3://bucket/data?X-Amz-Signature=word", "https://host/data#word", "file:///etc",
    ],
)  # fmt: skip
def test_urls_of_other_kinds_and_with_secrets_are_refused_unseen(url: str) -> None:
    with pytest.raises(UsageError, match="is no URL of a dataset") as caught:
        open_store(url)
    assert "word" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "shown"),
    [
        ("data/set/a//b", "a//b"), ("data/set/../b", "../b"), ("data/set/./b", "./b"), ("data/set/a\x01b", r"a\x01b"),
        ("data/set//b", "/b"),
    ],
)  # fmt: skip
def test_keys_that_no_folder_could_hold_are_told(server: BucketServer, key: str, shown: str) -> None:
    server.objects |= {key: b"1", "data/set/branchdrive.json": b"{}"}
    store = open_store(URL)
    assert "is none that a folder could hold" in store.unlisted
    assert store.read("branchdrive.json", 9) == b"{}"
    with pytest.raises(DatasetError, match="no key was read"):
        store.open("top")


def test_an_object_beside_a_folder_of_its_name_is_neither(server: BucketServer) -> None:
    server.objects |= {"data/set/raw": b"1", "data/set/mark/": b"", "data/set/mark/a": b"1"}
    store = open_store(URL)
    assert [(entry.path, entry.kind) for entry in store.entries()[1]] == [
        ("mark", "folder"), ("raw", "file_and_folder"), ("top", "file"),
    ]  # fmt: skip
    with pytest.raises(DatasetError, match="not a regular file"):
        store.open("raw")


def test_a_prefix_of_too_many_objects_is_refused(server: BucketServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bucket_module, "most_files", lambda: 1)
    with pytest.raises(UsageError, match="more than 1 objects; name the prefix"):
        open_store(URL)


def test_a_store_of_its_owner_is_a_place() -> None:
    memory = MemoryStore()
    obstore.put(memory, "raw/plain", b"content")
    store = Bucket.of(memory, "memory")
    assert (store.read("raw/plain", 7), str(store)) == (b"content", "memory")
    obstore.put(memory, "raw/plain", b"CONTENT")
    with pytest.raises(DatasetError, match="was changed"):
        store.read("raw/plain", 7)


def test_a_web_server_gives_what_its_manifest_names(server: BucketServer) -> None:
    digest = "0" * 64
    lines = f"# branchdrive-manifest 0.1\n# dataset {digest}\n{digest}  raw/plain\n{digest}  raw/none\n"
    server.objects["data/set/MANIFEST.sha256"] = lines.encode()
    store = open_store(f"{server.url}/bucket/data/set")
    assert (store.names("raw"), store.lists_all, store.read("raw/plain", 7)) == (["plain"], False, b"content")
    assert store.status("top") is None


def test_a_forked_process_is_refused_and_does_not_wait_for_ever(server: BucketServer) -> None:
    store = open_store(URL)
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        signal.alarm(30)
        try:
            store.read("raw/plain", 7)
        except PlatformError as error:
            os.write(writer, str(error).encode())
        os._exit(0)
    os.close(writer)
    _, status = os.waitpid(child, 0)
    with os.fdopen(reader) as stream:
        assert (status, "was forked" in stream.read()) == (0, True)
