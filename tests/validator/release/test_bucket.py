"""`branchdrive build --output s3://...`: the release of a folder, in a bucket."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from tests import synthetic, synthetic_release
from tests.bucket_server import serving, use

from branchdrive.cli.main import run

SEED = str(synthetic_release.SEED)


def test_a_release_is_built_into_a_bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raw, plain = tmp_path / "raw", tmp_path / "plain"
    synthetic.write_dataset(raw, synthetic_release.raw_tables(), synthetic_release.raw_descriptor())
    arguments = ["build", str(raw), "--no-leakage", "--seed", SEED, "--output"]
    assert run([*arguments, str(plain)], io.StringIO(), io.StringIO()) == 0
    expected = {path.relative_to(plain).as_posix(): path.read_bytes() for path in plain.rglob("*") if path.is_file()}
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
