"""A repository of the Hub: one commit of it, read by ranges; what is wrong there is one line without secrets."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from tests.hub_server import TOKEN, HubServer, serving, use
from tests.places import packed

from branchdrive.errors import DatasetError, PlatformError, UsageError
from branchdrive.formats import hub, object_client
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.place import open_store
from branchdrive.formats.store import Entry, Store

FILES = {"README.md": b"card", "set/raw/plain": b"content", "set/top": b"top", "set2/other": b"x", "set/a b#": b"odd"}
LARGE = bytes(range(256)) * 64


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[HubServer]:
    """A repository with a few files, and a patience that tests have."""
    backoff = {"init_backoff": timedelta(milliseconds=1), "max_backoff": timedelta(milliseconds=2), "base": 2}
    monkeypatch.setattr(
        object_client, "RETRIES", {"max_retries": 2, "retry_timeout": timedelta(seconds=5), "backoff": backoff}
    )
    with serving() as running:
        use(running, monkeypatch)
        running.commit(FILES)
        yield running


def tops(store: Store) -> list[str]:
    """What lies in the place itself."""
    return [entry.path for entry in store.entries()[1]]


@pytest.mark.parametrize("url", ["hf://org/name/set", "hf://datasets/org/name@main/set/", "hf://org/name@{}/set"])
def test_a_place_is_a_folder_of_one_commit_whatever_it_was_called(server: HubServer, url: str) -> None:
    commit = server.branches["main"]
    store = open_store(url.format(commit))
    assert str(store) == f"hf://org/name@{commit}/set"
    assert tops(store) == ["a b#", "raw", "top"]
    assert store.status("raw/plain") == Entry("raw/plain", "file", 7, "raw/plain")
    assert [store.read(path, 9) for path in ("raw/plain", "top", "a b#")] == [b"content", b"top", b"odd"]


def test_without_a_folder_it_is_the_whole_repository(server: HubServer) -> None:
    assert tops(open_store("hf://org/name")) == ["README.md", "set", "set2"]


@pytest.mark.parametrize(("branch", "written"), [("v1", "v1"), ("refs/pr/3", "refs/pr/3"), ("a/branch", "a%2Fbranch")])
def test_revisions_are_branches_tags_and_pull_requests(server: HubServer, branch: str, written: str) -> None:
    commit = server.commit({"set/top": b"other"}, branch)
    store = open_store(f"hf://org/name@{written}/set")
    assert (str(store), store.read("top", 9)) == (f"hf://org/name@{commit}/set", b"other")


def test_a_branch_that_moves_on_changes_nothing_of_what_was_opened(server: HubServer) -> None:
    store = open_store("hf://org/name@main/set")
    server.commit(FILES | {"set/top": b"new"})
    assert (store.read("top", 9), open_store("hf://org/name@main/set").read("top", 9)) == (b"top", b"new")


def test_pages_of_a_listing_are_followed(server: HubServer) -> None:
    server.page = 2
    server.commit({f"many/{number:02d}": b"" for number in range(9)})
    assert tops(open_store("hf://org/name/many")) == [f"{number:02d}" for number in range(9)]


def test_too_many_files_are_refused(server: HubServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub, "most_files", lambda: 1)
    with pytest.raises(UsageError, match="more than 1 files; name the folder"):
        open_store("hf://org/name")


def test_large_files_are_read_by_ranges_where_they_are_and_the_token_stays(
    server: HubServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    server.is_private = True
    server.commit({"large": LARGE})
    store = open_store("hf://org/name")
    server.requests.clear()
    with store.open("large") as stream:
        stream.seek(300)
        assert stream.read(40) == LARGE[300:340]
    [(path, headers)] = server.elsewhere
    assert (path, headers["range"]) == ("large", "bytes=300-339")
    assert not any(TOKEN in value for value in headers.values())
    assert len(server.requests) == 1


def test_it_travels_with_its_commit_and_without_the_token(server: HubServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    server.is_private = True
    store = open_store("hf://org/name/set")
    assert store.read("top", 9) == b"top"
    content = pickle.dumps(store)
    assert TOKEN.encode() not in content
    server.requests.clear()
    assert pickle.loads(content).read("top", 9) == b"top"
    assert [method for method, _ in server.requests] == ["GET"]
    assert TOKEN not in repr(store)


def test_an_archive_in_a_repository_is_a_place(server: HubServer, tmp_path: Path) -> None:
    (tmp_path / "set/raw").mkdir(parents=True)
    (tmp_path / "set/raw/plain").write_bytes(LARGE)
    archive = packed(tmp_path / "set", tmp_path / "dataset.zip")
    commit = server.commit({"packed/dataset.zip": archive.read_bytes()})
    store = open_store("hf://org/name/packed/dataset.zip")
    assert store.read("raw/plain", len(LARGE)) == LARGE
    assert str(store) == f"hf://org/name@{commit}/packed/dataset.zip"
    assert not any("/tree/" in path for _, path in server.requests)
    with pytest.raises(UsageError, match="there is no such object"):
        open_store("hf://org/name/packed/none.zip")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("hf://org/other", "no such repository of kind `dataset`, or it is private"),
        ("hf://org/name@none", "has no such revision or folder"),
        ("hf://org/name/none", "has no such revision or folder"),
        ("hf://name", "names no dataset on the Hub"),
        ("hf://spaces/org/name", "names no dataset on the Hub"),
        ("hf://user:word@org/name", "names no dataset on the Hub"),
        ("hf://org/name?token=word", "names no dataset on the Hub"),
    ],
)
def test_what_is_not_there_is_said(server: HubServer, url: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        open_store(url)
    assert "word" not in str(caught.value)


def test_a_private_repository_needs_a_token(server: HubServer) -> None:
    server.is_private = True
    with pytest.raises(UsageError, match="it is private; look at the token that `hf auth login`"):
        open_store("hf://org/name")


@pytest.mark.parametrize(
    ("status", "message"),
    [(403, "the Hub refuses access"), (400, "answered with status 400"), (500, "answered with status 500")],
)
def test_a_hub_that_fails_is_no_dataset_that_is_wrong(server: HubServer, status: int, message: str) -> None:
    server.status["revision"] = status
    with pytest.raises(PlatformError, match=message) as caught:
        open_store("hf://org/name")
    assert "\n" not in str(caught.value)
    assert "secret-of-the-hub" not in str(caught.value)


@pytest.mark.parametrize(("status", "message"), [(401, "store refuses access"), (500, "answered with status 500")])
def test_so_is_one_that_fails_while_files_are_read(server: HubServer, status: int, message: str) -> None:
    store = open_store("hf://org/name/set")
    server.status["file"] = status
    with pytest.raises(PlatformError, match=message) as caught:
        store.read("top", 9)
    assert "secret-of-the-hub" not in str(caught.value)


def test_a_repository_that_goes_away_is_no_file_any_more(server: HubServer) -> None:
    store = open_store("hf://org/name/set")
    server.commits.clear()
    with pytest.raises(DatasetError, match="'top' was removed after it was listed"):
        store.read("top", 9)


def test_an_answer_that_makes_no_sense_is_the_fault_of_the_hub(server: HubServer) -> None:
    server.branches["odd"] = "no commit"
    server.commits["no commit"] = {}
    with pytest.raises(PlatformError, match="cannot be reached or understood"):
        open_store("hf://org/name@odd")


def test_a_hub_that_is_not_there_is_said_in_one_line(server: HubServer, monkeypatch: pytest.MonkeyPatch) -> None:
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "ENDPOINT", "http://127.0.0.1:9")
    with pytest.raises(PlatformError, match="cannot be reached or understood") as caught:
        open_store("hf://org/name")
    assert "\n" not in str(caught.value)


def test_nothing_is_written_there() -> None:
    with pytest.raises(UsageError, match="the Hub takes files from `hf upload`"):
        Bucket.for_writing("hf://org/name")
