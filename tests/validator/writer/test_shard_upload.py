"""Finished shards go into a bucket while a collection goes on, and the manifest last, once, by one writer."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.bucket_server import BucketServer, serving, use
from tests.places import files_of
from tests.validator.writer.invented import make_descriptor, write_dataset, write_group

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.errors import UsageError
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.descriptor_file import read_descriptor, render_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.formats.upload import CLAIM_FILE, claim_for
from branchdrive.testing.media import media_document
from branchdrive.writer.shard_upload import ShardUpload
from branchdrive.writer.writer import DatasetWriter

URL = "s3://bucket/drives"
FIRST = "drives/raw/shard-00000/"
MEDIA = ("media.tar", "frames.parquet")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[BucketServer]:
    with serving() as running:
        use(running, monkeypatch)
        yield running


def collect(root: Path, places: range, upload: ShardUpload) -> DatasetWriter:
    """Collect groups of two a shard, and upload after each; the writer, open."""
    writer = DatasetWriter(root, make_descriptor(), groups_per_shard=2)
    upload.send_shards()
    for place in places:
        with writer.begin_group(f"g{place}", index=place) as group:
            write_group(group)
        writer.commit()
        upload.send_shards()
    return writer


def test_a_run_that_was_cut_off_goes_on(server: BucketServer, tmp_path: Path) -> None:
    root, whole = tmp_path / "d", tmp_path / "whole"
    write_dataset(whole, 5)
    collect(root, range(3), ShardUpload.at(Folder(root), URL)).close()
    assert {key for key in server.objects if "raw" in key} == {
        f"{FIRST}{path.name}" for path in (whole / "raw/shard-00000").iterdir()
    }
    assert f"drives/{MANIFEST_FILE}" not in server.objects
    upload = ShardUpload.at(Folder(root), URL)
    with collect(root, range(3, 5), upload) as writer:
        identity = writer.finalize()
    report = upload.finish()
    assert report.identity == identity
    assert {key.removeprefix("drives/"): content for key, content in server.objects.items()} == files_of(whole)
    claims = {f"drives/{CLAIM_FILE}"}
    assert {key for key, count in server.written.items() if count > 1} == claims, "nothing is sent twice"
    assert [key for method, key in server.requests if method == "PUT"][-1] == f"drives/{MANIFEST_FILE}"
    again = ShardUpload.at(Folder(root), URL)
    again.send_shards()
    assert again.finish().num_sent == 0


def add_media(root: Path, *, is_waiting: bool) -> dict[str, str]:
    """Let a shard have media, in their places beside a descriptor of them or where they wait; their places by path."""
    folder = ".staging/render" if is_waiting else FIRST.removeprefix("drives/").rstrip("/")
    (root / folder).mkdir(parents=True, exist_ok=True)
    for name in MEDIA:
        (root / folder / name).write_bytes(name.encode())
    return {f"{FIRST.removeprefix('drives/')}{name}": f"{folder}/{name}" for name in MEDIA}


def test_media_go_up_from_where_they_wait_under_the_same_claim(server: BucketServer, tmp_path: Path) -> None:
    root = tmp_path / "d"
    write_dataset(root, 2)
    bare = read_descriptor(Folder(root))
    waiting = add_media(root, is_waiting=True)
    upload = ShardUpload.at(Folder(root), URL, waiting)
    upload.send_shards(waiting)
    assert f"{FIRST}controls.parquet" in server.objects, "its manifest is not the last one"
    assert {name: server.objects[f"{FIRST}{name}"] for name in MEDIA} == {name: name.encode() for name in MEDIA}
    with pytest.raises(UsageError, match=rf"holds '{FIRST.removeprefix('drives/')}frames.parquet', which .* has not"):
        ShardUpload.at(Folder(root), URL)
    shutil.rmtree(root / ".staging")
    add_media(root, is_waiting=False)
    document = media_document(bare.model_dump(mode="json"))
    Folder(root).replace("branchdrive.json", render_descriptor(Descriptor.model_validate(document)))
    write_manifest(Folder(root), build_manifest(Folder(root)))
    again = ShardUpload.at(Folder(root), URL, {})
    again.send_shards()
    again.finish()
    assert {key.removeprefix("drives/"): content for key, content in server.objects.items()} == files_of(root)
    assert {key for key, count in server.written.items() if count > 1} == {f"drives/{CLAIM_FILE}"}


def test_another_writer_is_told(server: BucketServer, tmp_path: Path) -> None:
    for name in ("one", "two"):
        with DatasetWriter(tmp_path / name, make_descriptor(), groups_per_shard=2) as writer:
            writer.commit()
    uploads = [ShardUpload.at(Folder(tmp_path / name), URL) for name in ("one", "two")]

    def begin(upload: ShardUpload) -> str:
        try:
            upload.send_shards()
        except UsageError as error:
            return str(error)
        return ""

    with ThreadPoolExecutor(2) as pool:
        said = sorted(pool.map(begin, uploads))
    assert said[0] == ""
    assert "another dataset is being uploaded there" in said[1]


def test_a_claim_that_was_changed_is_not_replaced(server: BucketServer, tmp_path: Path) -> None:
    root = tmp_path / "d"
    upload = ShardUpload.at(Folder(root), URL)
    with collect(root, range(2), upload) as writer:
        writer.finalize()
    listed = Bucket.for_writing(URL)
    server.objects[f"drives/{CLAIM_FILE}"] = b"of another"
    assert not listed.put_over(CLAIM_FILE, claim_for(b""), listed.versions[CLAIM_FILE])
    with pytest.raises(UsageError, match="another dataset is being uploaded there"):
        upload.finish()
    assert f"drives/{MANIFEST_FILE}" not in server.objects


def test_shards_whose_folder_is_gone_are_not_mixed_with_new_ones(server: BucketServer, tmp_path: Path) -> None:
    root = tmp_path / "d"
    collect(root, range(2), ShardUpload.at(Folder(root), URL)).close()
    shutil.rmtree(root)
    with pytest.raises(UsageError, match=r"holds 'raw/shard-00000/.*, which .* has not"):
        ShardUpload.at(Folder(root), URL)


def test_where_a_dataset_is_nothing_is_collected(server: BucketServer, tmp_path: Path) -> None:
    server.objects[f"drives/{MANIFEST_FILE}"] = b""
    with pytest.raises(UsageError, match="holds a finished dataset; name a prefix without objects"):
        ShardUpload.at(Folder(tmp_path / "d"), URL)
    with pytest.raises(UsageError, match="takes no files"):
        ShardUpload.at(Folder(tmp_path / "d"), "https://localhost/d")
