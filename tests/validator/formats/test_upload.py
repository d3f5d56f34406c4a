"""`branchdrive upload`: files first and the manifest last, once, and on from where it was cut off."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path

import pytest
from tests import synthetic
from tests.bucket_server import BucketServer, serving, use
from tests.validator.engine.datasets import write
from tests.waiting import wait_for

from branchdrive.cli.main import run as run_command
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError, PlatformError, UsageError
from branchdrive.formats import bucket as bucket_module
from branchdrive.formats import object_client, upload
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.place import open_store
from branchdrive.formats.upload import CLAIM_FILE, upload_dataset

URL = "s3://bucket/drives/one"
PREFIX = "drives/one/"
TABLE = "raw/shard-00001/controls.parquet"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("upload") / "drive")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[BucketServer]:
    monkeypatch.setattr(
        object_client,
        "RETRIES",
        {
            "max_retries": 3, "retry_timeout": timedelta(seconds=5),
            "backoff": {"init_backoff": timedelta(milliseconds=1), "max_backoff": timedelta(milliseconds=2), "base": 2},
        },
    )  # fmt: skip
    with serving() as running:
        use(running, monkeypatch)
        yield running


def files_of(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def there(server: BucketServer) -> dict[str, bytes]:
    return {key.removeprefix(PREFIX): content for key, content in server.objects.items() if key.startswith(PREFIX)}


def test_what_is_uploaded_is_the_dataset_and_the_manifest_comes_last(root: Path, server: BucketServer) -> None:
    out = io.StringIO()
    assert run_command(["upload", str(root), URL], out, io.StringIO()) == 0
    assert there(server) == files_of(root)
    assert out.getvalue().endswith(f"next      branchdrive-validate {URL}\n")
    written = [key.removeprefix(PREFIX) for method, key in server.requests if method == "PUT"]
    assert (written[0], written[-1]) == (CLAIM_FILE, MANIFEST_FILE)
    assert len(written) == len(files_of(root)) + 1
    assert run_command(["validate", URL], io.StringIO(), io.StringIO()) == 0


def test_every_request_that_writes_carries_a_checksum_that_is_right(root: Path, server: BucketServer) -> None:
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert set(server.checked) == {key for method, key in server.requests if method == "PUT"}


def test_a_finished_dataset_is_not_sent_again(root: Path, server: BucketServer) -> None:
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    server.requests.clear()
    assert upload_dataset(open_store(root), Bucket.for_writing(URL)).num_sent == 0
    assert server.num("PUT") == 0


@pytest.mark.parametrize("is_manifest", [False, True])
def test_an_upload_that_was_cut_off_goes_on(root: Path, server: BucketServer, is_manifest: bool) -> None:
    failing = MANIFEST_FILE if is_manifest else TABLE
    server.faults[PREFIX + failing] = ["503"]
    with pytest.raises(PlatformError, match="status 503"):
        upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert MANIFEST_FILE not in there(server)
    assert CLAIM_FILE in there(server)
    server.faults.clear()
    first = {*there(server)}
    server.written.clear()
    report = upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert there(server) == files_of(root)
    assert {key.removeprefix(PREFIX) for key in server.written} == {*files_of(root)} - first
    assert report.num_sent == len(server.written)


def test_an_upload_whose_process_was_killed_goes_on(root: Path, server: BucketServer) -> None:
    server.faults[PREFIX + TABLE] = ["hang"]
    program = "import sys; from branchdrive.cli.entry import main; sys.exit(main())"
    process = subprocess.Popen([sys.executable, "-P", "-c", program, "upload", str(root), URL])
    try:
        wait_for(lambda: ("PUT", PREFIX + TABLE) in server.requests)
    finally:
        process.kill()
        process.wait()
    server.faults.clear()
    assert CLAIM_FILE in there(server)
    assert {*there(server)} <= {CLAIM_FILE, *files_of(root)} - {MANIFEST_FILE, TABLE}
    assert validate(URL).verdict == "invalid"
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert there(server) == files_of(root)


def test_an_upload_that_was_cut_off_at_its_very_end_is_cleaned_up(root: Path, server: BucketServer) -> None:
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    server.objects[PREFIX + CLAIM_FILE] = b"{}"
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert there(server) == files_of(root)


def test_of_many_writers_of_one_object_one_wins(server: BucketServer) -> None:
    target = Bucket.for_writing(URL)
    with ThreadPoolExecutor(16) as pool:
        won = list(pool.map(lambda number: target.put_new("raw/x", b"%d" % number), range(16)))
    assert sum(won) == 1
    assert there(server) == {"raw/x": b"%d" % won.index(True)}


def test_of_two_writers_one_wins_and_the_other_is_told(root: Path, tmp_path: Path, server: BucketServer) -> None:
    other = write(tmp_path / "other")
    (other / "branchdrive.json").write_bytes((other / "branchdrive.json").read_bytes() + b"\n")
    synthetic.seal_dataset(other)
    late = Bucket.for_writing(URL)
    server.faults[PREFIX + TABLE] = ["503"]
    with pytest.raises(PlatformError):
        upload_dataset(open_store(root), Bucket.for_writing(URL))
    for target in (late, Bucket.for_writing(URL)):
        with pytest.raises(UsageError, match="another dataset is being uploaded there"):
            upload_dataset(open_store(other), target)
    server.faults.clear()
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    with pytest.raises(UsageError, match="holds another dataset"):
        upload_dataset(open_store(other), Bucket.for_writing(URL))
    assert there(server) == files_of(root)


def test_a_prefix_with_other_objects_is_left_alone(root: Path, server: BucketServer) -> None:
    server.objects[PREFIX + "notes.txt"] = b"x"
    with pytest.raises(UsageError, match=r"holds other objects, such as 'notes\.txt'"):
        upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert there(server) == {"notes.txt": b"x"}
    with pytest.raises(UsageError, match="is a web server"):
        Bucket.for_writing("https://host/folder")


def test_large_files_are_sent_in_parts(
    root: Path, tmp_path: Path, server: BucketServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(upload, "WHOLE_BYTES", 1000)
    monkeypatch.setattr(bucket_module, "PART_BYTES", 2000)
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert there(server) == files_of(root)
    assert not server.uploads
    assert server.num("POST", TABLE) == 2


@pytest.mark.parametrize("whole_bytes", [64 << 20, 1000])
@pytest.mark.parametrize(
    "change", [lambda content: content[:-1] + b"\0", lambda content: content + b"\0"], ids=["changed", "grown"]
)
def test_a_file_that_is_not_as_its_manifest_says_is_not_left_there(
    tmp_path: Path,
    server: BucketServer,
    monkeypatch: pytest.MonkeyPatch,
    whole_bytes: int,
    change: Callable[[bytes], bytes],
) -> None:
    monkeypatch.setattr(upload, "WHOLE_BYTES", whole_bytes)
    monkeypatch.setattr(bucket_module, "PART_BYTES", 2000)
    root = write(tmp_path / "drive")
    (root / TABLE).write_bytes(change((root / TABLE).read_bytes()))
    with pytest.raises(DatasetError, match=r"controls\.parquet' is not the file that"):
        upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert not {TABLE, MANIFEST_FILE} & {*there(server)}


def test_a_dataset_goes_from_place_to_place(root: Path, tmp_path: Path, server: BucketServer) -> None:
    upload_dataset(open_store(root), Bucket.for_writing(URL))
    assert run_command(["pack", URL, str(tmp_path / "drive.zip")], io.StringIO(), io.StringIO()) == 0
    assert run_command(["upload", str(tmp_path / "drive.zip"), "s3://bucket/again"], io.StringIO(), io.StringIO()) == 0
    again = {key.removeprefix("again/"): body for key, body in server.objects.items() if key.startswith("again/")}
    assert again == files_of(root)
