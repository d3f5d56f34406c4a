"""A collection that is killed while it uploads shards, or media of shards, goes on and sends nothing twice."""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import Path

import pytest
from tests.bucket_server import BucketServer, serving, use
from tests.places import files_of
from tests.reference_impl.collect.running import start
from tests.waiting import wait_for

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import check_against_manifest
from branchdrive.formats.upload import CLAIM_FILE
from branchdrive_reference.rendering.dataset import finished_media

FIRST = "drives/raw/shard-00000/"
SMALL = """
from branchdrive_reference.collect import campaign, media
campaign.GROUPS_PER_SHARD = 1
(camera,) = media.cameras_of(("semantic_bev",))
media.cameras_of = lambda _: (camera.model_copy(update={"width_px": 32, "height_px": 32}),)
"""
OPTIONS = ("--output", "s3://bucket/drives", "--media")


def kill_while_sending(server: BucketServer, key: str, root: Path, loaded_first: Path) -> set[str]:
    """Keys of files that were sent by a collection that is killed while it sends one of them."""
    server.faults[key] = ["hang"]
    with start(root, seed=5, jobs=1, groups=2, options=OPTIONS, loaded_first=loaded_first) as process:
        wait_for(lambda: process.poll() is not None or server.num("PUT", key) > 0)
        assert process.poll() is None, process.communicate()
        os.killpg(process.pid, signal.SIGKILL)
    server.faults.clear()
    sent = {one for one in server.objects if "/raw/" in one}
    assert sent and key not in sent
    assert f"drives/{MANIFEST_FILE}" not in server.objects
    return sent


def test_a_killed_collection_goes_on_in_its_bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(SMALL)
    root = tmp_path / "out"
    with serving() as server:
        use(server, monkeypatch)
        sent = kill_while_sending(server, f"{FIRST}controls.parquet", root, tmp_path)
        assert all(key.startswith(FIRST) for key in sent)
        sent = kill_while_sending(server, f"{FIRST}frames.parquet", root, tmp_path)
        assert {key for key in sent if key.endswith("media.tar")} == {f"{FIRST}media.tar"}
        waiting = finished_media(Folder(root))
        assert {*waiting} == {"raw/shard-00000/media.tar", "raw/shard-00000/frames.parquet"}, "others are to come"
        with start(root, seed=5, jobs=1, groups=2, options=OPTIONS, loaded_first=tmp_path) as process:
            out, errors = process.communicate()
        assert process.returncode == 0, errors
        check_against_manifest(Folder(root))
        assert {key.removeprefix("drives/"): body for key, body in server.objects.items()} == files_of(root)
        assert server.written - Counter(server.objects.keys()) == Counter({f"drives/{CLAIM_FILE}": 2})
        assert "next      branchdrive-validate s3://bucket/drives" in out
