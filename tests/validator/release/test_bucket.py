"""`branchdrive build`: from a folder into a bucket, and from a bucket or an archive into a folder."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from tests import synthetic, synthetic_release
from tests.bucket_server import serving, use
from tests.places import packed
from tests.validator.release.running import contents

from branchdrive.cli.main import run
from branchdrive.contract.companion import CROISSANT_FILE

SEED = str(synthetic_release.SEED)


def test_a_release_is_built_into_a_bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raw, plain = tmp_path / "raw", tmp_path / "plain"
    synthetic.write_dataset(raw, synthetic_release.raw_tables(), synthetic_release.raw_descriptor())
    arguments = ["build", str(raw), "--no-leakage", "--seed", SEED, "--output"]
    assert run([*arguments, str(plain)], io.StringIO(), io.StringIO()) == 0
    expected = contents(plain)
    del expected[CROISSANT_FILE]  # a companion, no part of the release
    with serving() as server:
        use(server, monkeypatch)
        out = io.StringIO()
        assert run([*arguments, "s3://bucket/release"], out, io.StringIO()) == 0
        assert {key.removeprefix("release/"): content for key, content in server.objects.items()} == expected
        assert "s3://bucket/release" in out.getvalue()
        server.objects["other/notes.txt"] = b"x"
        errors = io.StringIO()
        assert run([*arguments, "s3://bucket/other"], io.StringIO(), errors) == 2
        assert "holds other objects" in errors.getvalue()


def test_a_release_is_built_from_where_the_raw_layer_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = tmp_path / "raw"
    synthetic.write_dataset(raw, synthetic_release.raw_tables(), synthetic_release.raw_descriptor())
    archive = packed(raw, tmp_path / "raw.zip")
    built = {}
    with serving() as server:
        use(server, monkeypatch)
        server.fill(raw, "raw")
        for name, place in (("folder", raw), ("archive", archive), ("bucket", "s3://bucket/raw")):
            words = ["build", str(place), "--no-leakage", "--seed", SEED, "--format", "json"]
            out, errors = io.StringIO(), io.StringIO()
            assert (run([*words, "--output", str(tmp_path / name)], out, errors), errors.getvalue()) == (0, "")
            built[name] = contents(tmp_path / name)
            assert json.loads(out.getvalue())["path"] == str(tmp_path / name)
        assert built["archive"] == built["folder"]
        assert built["bucket"] == built["folder"]
        assert server.num("PUT") == 0
        server.objects["raw/raw/shard-00000/controls.parquet"] += b"PAR1"
        errors = io.StringIO()
        words = ["build", "s3://bucket/raw", "--no-leakage", "--output", str(tmp_path / "changed")]
        assert run(words, io.StringIO(), errors) == 2
        assert "s3://bucket/raw: 'raw/shard-00000/controls.parquet' is not the file that" in errors.getvalue()
    errors = io.StringIO()
    assert run(["build", str(archive)], io.StringIO(), errors) == 2
    assert "needs a folder of this machine" in errors.getvalue()


@pytest.mark.parametrize(
    "words",
    [
        ["build", "s3://bucket/raw"], ["collect", "s3://bucket/raw", "--seed", "1"], ["render", "s3://bucket/raw"],
        ["merge", "a", "--output", "s3://bucket/raw"], ["staging", "s3://bucket/raw"], ["train", "s3://bucket/raw"],
        ["validate", "s3://bucket/raw", "--staging"],
    ],
)  # fmt: skip
def test_what_needs_a_folder_says_so(words: list[str]) -> None:
    errors = io.StringIO()
    assert run(words, io.StringIO(), errors) == 2
    assert "needs a folder of this machine" in errors.getvalue()
