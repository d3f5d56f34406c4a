"""Datasets whose files are links, as in a download cache: followed when asked, and into named folders alone."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests import synthetic
from tests.validator.engine.datasets import FOLDER, failing, write
from tests.validator.engine.rules.release import release_draft

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import Location
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.folder import Folder
from branchdrive.model.reader import open_model
from branchdrive.raw.reader import open_dataset


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    """A valid dataset with media and few attempts in a hub's cache."""
    plain = tmp_path / "plain"
    synthetic.write_dataset(plain, synthetic.with_few_attempts(synthetic.media_tables()), synthetic.media_descriptor())
    folder = cached(plain, tmp_path / "datasets--someone--drive")
    (snapshot_of(folder) / "README.md").symlink_to("../../blobs/readme")
    return folder


def cached(plain: Path, folder: Path) -> Path:
    """Move the dataset at `plain` into a hub's cache: every file is a link to a blob."""
    snapshot, blobs = folder / "snapshots" / "0123abcd", folder / "blobs"
    blobs.mkdir(parents=True)
    for path in (path for path in plain.rglob("*") if path.is_file()):
        link = snapshot / path.relative_to(plain)
        link.parent.mkdir(parents=True, exist_ok=True)
        blob = blobs / hashlib.sha256(path.read_bytes()).hexdigest()
        path.rename(blob)
        link.symlink_to(os.path.relpath(blob, link.parent))
    return folder


def snapshot_of(cache: Path) -> Path:
    return cache / "snapshots" / "0123abcd"


def places(report: Report, rule_id: str) -> list[Location]:
    return [finding.location for finding in report.findings if finding.rule == rule_id]


def messages(report: Report) -> str:
    return " ".join(finding.message for finding in report.findings)


def test_a_hub_cache_is_valid_when_its_links_are_followed(cache: Path) -> None:
    report = validate(snapshot_of(cache), follow_links=True, allow=[cache / "blobs"])
    assert (report.verdict, failing(report)) == ("valid", {"BD-BNK-001"})  # few attempts make no whole bank
    assert report.options.links == (str(cache / "blobs"),)
    assert report.dataset.num_beside == 1

    opened = open_dataset(snapshot_of(cache), follow_links=True, allow=[cache])
    assert len(opened.groups) == 3
    assert len(opened.group(opened.groups[0]).rollouts) > 0


def test_a_release_in_a_hub_cache_is_valid_with_its_card(tmp_path: Path) -> None:
    folder = cached(release_draft().write(tmp_path / "plain"), tmp_path / "datasets--someone--drive")
    (snapshot_of(folder) / ".cache" / "huggingface").mkdir(parents=True)
    report = validate(snapshot_of(folder), follow_links=True, allow=[folder / "blobs"])
    assert (report.verdict, report.dataset.num_beside) == ("valid", 1)
    layer = open_model(snapshot_of(folder), follow_links=True, allow=[folder / "blobs"])
    assert layer.targets("test").scalars.shape[0] == len(layer.groups("test"))


def test_a_release_in_a_git_checkout_is_valid(tmp_path: Path) -> None:
    root = release_draft().write(tmp_path / "checkout")
    (root / ".git" / "objects").mkdir(parents=True)
    (root / ".git" / "HEAD").write_text("ref: refs/heads/main\n")
    (root / ".gitattributes").write_text("*.parquet filter=lfs diff=lfs merge=lfs -text\n")
    report = validate(root)
    assert (report.verdict, report.dataset.num_beside) == ("valid", 2)


def test_links_are_not_followed_silently(cache: Path) -> None:
    report = validate(snapshot_of(cache))
    assert report.verdict == "invalid"
    assert "BD-LAY-006" in failing(report)
    assert "--follow-links --allow FOLDER" in messages(report)
    with pytest.raises(DatasetError, match="follow_links=True, allow"):
        open_dataset(snapshot_of(cache))


def test_links_do_not_lead_out_of_the_named_folders(cache: Path, tmp_path: Path) -> None:
    for allow in ([], [tmp_path / "plain"], [cache / "snapshots"]):
        report = validate(snapshot_of(cache), follow_links=True, allow=allow)
        assert report.verdict == "invalid"
        assert "out of the folders that are named" in messages(report)


def test_links_inside_the_dataset_need_no_folder(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    annex = root / ".git" / "annex"
    annex.mkdir(parents=True)
    (root / FOLDER / "actors.parquet").rename(annex / "actors")
    (root / FOLDER / "actors.parquet").symlink_to("../../.git/annex/actors")
    assert validate(root).verdict == "invalid"
    assert validate(root, follow_links=True).verdict == "valid"


def test_a_folder_may_be_a_link(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    (root / "raw").rename(tmp_path / "large")
    (root / "raw").symlink_to(tmp_path / "large")
    assert validate(root, follow_links=True, allow=[tmp_path / "large"]).verdict == "valid"
    assert len(open_dataset(root, follow_links=True, allow=[tmp_path / "large"]).groups) == 3


def test_links_in_a_circle_end(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    (root / "raw" / "again").symlink_to(root)
    (root / "loop").symlink_to("loop")
    report = validate(root, follow_links=True)
    assert (report.verdict, report.errors) == ("invalid", ())


def test_links_do_not_multiply_a_folder(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    for number in range(10):
        (root / f"loop{number}").symlink_to(".")
    report = validate(root, follow_links=True)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert failing(report) == {"BD-LAY-006"}
    assert {place["file"] for place in places(report, "BD-LAY-006")} == {f"loop{number}" for number in range(10)}


def test_a_folder_that_several_links_lead_to_is_entered_once(tmp_path: Path) -> None:
    """Without a circle: each of eight folders holds ten links to the next one."""
    root, chain = write(tmp_path / "dataset"), tmp_path / "chain"
    for number in range(9):
        (chain / str(number)).mkdir(parents=True)
        for link in range(10 if number < 8 else 0):
            (chain / str(number) / f"link{link}").symlink_to(f"../{number + 1}")
    (root / "chain").symlink_to(chain / "0")
    report = validate(root, follow_links=True, allow=[chain])
    assert (report.verdict, report.errors) == ("invalid", ())
    assert len(places(report, "BD-LAY-006")) == 8 * 9


def test_it_is_the_link_that_is_refused(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    (root / "raw" / "a-link").symlink_to("shard-00000")
    (root / ".git" / "objects").mkdir(parents=True)
    (root / "raw" / "shard-00009").symlink_to("../.git/objects")
    (root / "raw" / "shard-00010").symlink_to("../.git/objects")
    report = validate(root, follow_links=True)
    assert {place["file"] for place in places(report, "BD-LAY-006")} == {"raw/a-link", "raw/shard-00010"}


@pytest.mark.parametrize("add", [os.link, os.symlink], ids=["names", "links"])
def test_bytes_of_files_with_several_paths_are_bounded(
    add: Callable[[Path, Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = write(tmp_path / "dataset")
    large = root / FOLDER / "actors.parquet"
    size = large.stat().st_size
    limits = replace(spec_limits(), max_repeated_bytes=2 * size)
    monkeypatch.setattr("branchdrive.files.survey.spec_limits", lambda: limits)
    opened: list[str] = []
    monkeypatch.setattr(Folder, "digest", lambda folder, path: opened.append(path) or "0" * 64)

    for name in ("second", "third"):
        add(large, root / name)
    within = validate(root, follow_links=True)
    assert failing(within) == {"BD-LAY-004", "BD-LAY-009"}
    assert opened == ["second"]  # and not the other name of the same file

    add(large, root / "fourth")
    opened.clear()
    beyond = validate(root, follow_links=True)
    assert failing(beyond) == {"BD-LAY-007"}
    assert f"{3 * size} bytes" in messages(beyond)
    assert beyond.dataset.identity is None
    assert opened == []


def test_a_link_that_appears_after_it_was_resolved_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    secret = tmp_path / "secret"
    secret.mkdir()
    (secret / "file").write_bytes(b"secret")
    root, blobs = tmp_path / "dataset", tmp_path / "blobs"
    (blobs / "inner").mkdir(parents=True)
    (blobs / "inner" / "file").write_bytes(b"mine")
    root.mkdir()
    (root / "file").symlink_to("../blobs/inner/file")
    real = os.path.realpath

    def swapping(path: str | Path) -> str:
        resolved = real(path)
        if Path(path).name == "file":
            (blobs / "inner").rename(tmp_path / "gone")
            (blobs / "inner").symlink_to(secret)
        return resolved

    monkeypatch.setattr(os.path, "realpath", swapping)
    with pytest.raises(DatasetError, match="cannot be opened"):
        Folder(root, (blobs,)).open("file")


def test_folders_without_following_links_are_refused(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    with pytest.raises(UsageError, match="links are not followed"):
        validate(root, allow=[tmp_path])
    with pytest.raises(UsageError, match="is not a folder"):
        open_dataset(root, follow_links=True, allow=[tmp_path / "none"])
