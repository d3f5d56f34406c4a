"""A collection that is killed in the middle of an upload goes on, and sends nothing twice."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from tests.bucket_server import serving, use
from tests.places import files_of
from tests.reference_impl.collect.running import start
from tests.waiting import wait_for

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import check_against_manifest

HUNG = "drives/raw/shard-00000/controls.parquet"
SMALL_SHARDS = "from branchdrive_reference.collect import campaign\ncampaign.GROUPS_PER_SHARD = 1\n"


def test_a_killed_collection_goes_on_in_its_bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(SMALL_SHARDS)
    root = tmp_path / "out"
    with serving() as server:
        use(server, monkeypatch)
        server.faults[HUNG] = ["hang"]
        options = ("--output", "s3://bucket/drives")
        with start(root, seed=5, jobs=1, groups=2, options=options, loaded_first=tmp_path) as process:
            wait_for(lambda: process.poll() is not None or server.num("PUT", HUNG) > 0)
            assert process.poll() is None, process.communicate()
            os.killpg(process.pid, signal.SIGKILL)
        sent = {key for key in server.objects if "/raw/" in key}
        assert sent and all(key.startswith("drives/raw/shard-00000/") for key in sent)
        assert not {HUNG, f"drives/{MANIFEST_FILE}"} & server.objects.keys()
        server.faults.clear()
        with start(root, seed=5, jobs=1, groups=2, options=options, loaded_first=tmp_path) as process:
            out, errors = process.communicate()
        assert process.returncode == 0, errors
        check_against_manifest(Folder(root))
        assert {key.removeprefix("drives/"): body for key, body in server.objects.items()} == files_of(root)
        assert {key: server.written[key] for key in sent} == dict.fromkeys(sent, 1)
        assert "next      branchdrive-validate s3://bucket/drives" in out
