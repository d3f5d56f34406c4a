"""Folders and documents of strangers: links, pipes, odd names, unreadable and absurd files are findings."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests import synthetic
from tests.sampling import sampled
from tests.validator.engine.datasets import FOLDER, failing, write

from branchdrive.contract.limits import spec_limits
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.formats.parquet import encode_table

SECRET = b"nobody may read this"


def found(report: Report, rule_id: str) -> list[str]:
    """Places and words of a rule's findings."""
    return [f"{f.location.get('file', '')}: {f.found}" for f in report.findings if f.rule == rule_id]


# --- entries that are no files


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder beside the dataset that must never be touched."""
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "secret").write_bytes(SECRET)
    for name, table in synthetic.base_tables()[FOLDER].items():
        (folder / f"{name}.parquet").write_bytes(encode_table(table))
    return folder


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Paths of all files that were opened by name, resolved."""
    paths: list[str] = []
    real = os.open

    def recording(path: Any, flags: int, *rest: Any, dir_fd: int | None = None, **more: Any) -> int:
        descriptor = real(path, flags, *rest, dir_fd=dir_fd, **more)
        paths.append(str(Path(f"/proc/self/fd/{descriptor}").resolve()))
        return descriptor

    monkeypatch.setattr(os, "open", recording)
    yield paths


def table_to_secret(root: Path, outside: Path) -> None:
    (root / FOLDER / "actors.parquet").unlink()
    (root / FOLDER / "actors.parquet").symlink_to(outside / "actors.parquet")


def table_to_relative(root: Path, outside: Path) -> None:
    (root / FOLDER / "actors.parquet").unlink()
    (root / FOLDER / "actors.parquet").symlink_to("../../../outside/actors.parquet")


def shard_to_outside(root: Path, outside: Path) -> None:
    (root / FOLDER).rename(root.parent / "moved")
    (root / FOLDER).symlink_to(outside)


def layer_to_outside(root: Path, outside: Path) -> None:
    (root / "raw").rename(root.parent / "moved")
    (root / "raw").symlink_to(root.parent / "moved")


def descriptor_to_secret(root: Path, outside: Path) -> None:
    (root / "branchdrive.json").unlink()
    (root / "branchdrive.json").symlink_to(outside / "secret")


def manifest_to_secret(root: Path, outside: Path) -> None:
    (root / "MANIFEST.sha256").unlink()
    (root / "MANIFEST.sha256").symlink_to(outside / "secret")


def loop(root: Path, outside: Path) -> None:
    (root / FOLDER / "loop").symlink_to(root)


def dangling(root: Path, outside: Path) -> None:
    (root / "note").symlink_to("nowhere")


LINKS = [
    table_to_secret, table_to_relative, shard_to_outside, layer_to_outside, descriptor_to_secret, manifest_to_secret,
    loop, dangling,
]  # fmt: skip


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc to see what was opened")
@pytest.mark.parametrize("plant", LINKS, ids=lambda plant: plant.__name__)
def test_links_are_found_and_not_followed(
    plant: Callable[[Path, Path], None], tmp_path: Path, outside: Path, opened: list[str]
) -> None:
    root = write(tmp_path / "dataset")
    plant(root, outside)
    opened.clear()
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert "BD-LAY-006" in failing(report)
    assert opened
    assert all(Path(path).is_relative_to(root.resolve()) for path in opened)
    assert SECRET.decode() not in json.dumps(report.to_json())


def pipe(path: Path) -> None:
    os.mkfifo(path)


def local_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        previous = Path.cwd()
        os.chdir(path.parent)  # socket paths are short
        try:
            server.bind(path.name)
        finally:
            os.chdir(previous)


def folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [pipe, local_socket, folder], ids=lambda make: make.__name__)
@pytest.mark.parametrize(
    "place",
    sampled([
        "branchdrive.json", "MANIFEST.sha256", f"{FOLDER}/controls.parquet", FOLDER, f"{FOLDER}/extra", "extra",
    ], every=2),
)  # fmt: skip
def test_pipes_and_folders_in_the_place_of_files_do_not_hang(
    make: Callable[[Path], None], place: str, tmp_path: Path
) -> None:
    root = write(tmp_path / "dataset")
    if (root / place).exists():
        (root / place).rename(tmp_path / "moved")
    make(root / place)
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    if make is not folder:
        assert found(report, "BD-LAY-006") == [f"{place}: a special file"]


# --- names


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        pytest.param(b"\xff\xfe.parquet", "\\udcff\\udcfe.parquet", id="no UTF-8"),
        pytest.param(b"a\nb", "a\\nb", id="line feed"),
        pytest.param(b"\x1b[31mred", "\\x1b[31mred", id="escape sequence"),
        pytest.param("\u202egnp.exe".encode(), "\\u202egnp.exe", id="bidirectional override"),
        pytest.param(b"back\\slash", "back\\slash", id="backslash"),
        pytest.param(b"C:file", "C:file", id="drive letter"),
        pytest.param(b"ends in a dot.", "ends in a dot.", id="final dot"),
        pytest.param(b"[red]markup[bold]", None, id="markup is plain text"),
    ],
)
def test_odd_names_are_findings(name: bytes, shown: str | None, tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    Path(os.fsdecode(os.fsencode(root / FOLDER) + b"/" + name)).write_bytes(b"x")
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    if shown is None:
        assert failing(report) == {"BD-LAY-004", "BD-LAY-009"}
    else:
        assert failing(report) == {"BD-LAY-005"}
        assert [f.location for f in report.findings] == [{"file": f"{FOLDER}/{shown}"}]


def test_long_and_deep_paths_are_over_the_limits(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    deep = root.joinpath(*["d"] * 9)
    deep.mkdir(parents=True)
    (deep / "file").write_bytes(b"x")
    (root / ("n" * 250)).write_bytes(b"x")
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert found(report, "BD-LAY-007") == [
        "d/d/d/d/d/d/d/d/d/file: lies deeper than 8 folders",
        f"{'n' * 250}: is longer than 240 bytes",
    ]


def test_a_tree_of_any_depth_ends(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    previous = Path.cwd()
    try:
        os.chdir(root)
        for _ in range(1500):
            os.mkdir("d")  # noqa: PTH102  (a path of this length cannot be given as one)
            os.chdir("d")
    finally:
        os.chdir(previous)
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert "BD-LAY-007" in failing(report)
    _remove_deep(root / "d")


def _remove_deep(folder: Path) -> None:
    """Remove a chain of folders that is deeper than a path can be long."""
    previous = Path.cwd()
    os.chdir(folder)
    depth = 0
    while os.listdir():  # noqa: PTH208
        os.chdir("d")
        depth += 1
    for _ in range(depth):
        os.chdir("..")
        os.rmdir("d")  # noqa: PTH106
    os.chdir(previous)


@pytest.mark.parametrize("number", [20, 40], ids=["listed to the end", "cut off"])
def test_too_many_names_end_in_a_finding(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits = replace(spec_limits(), max_files=20)
    monkeypatch.setattr("branchdrive.files.survey.spec_limits", lambda: limits)
    root = write(tmp_path / "dataset")
    for index in range(number):
        (root / FOLDER / f"{index:02d}").touch()
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert failing(report) == {"BD-LAY-007"}
    status = {tally.rule_id: tally.status for tally in report.tallies}
    assert {status[rule_id] for rule_id in ("BD-LAY-003", "BD-LAY-009", "BD-TAB-001", "BD-KEY-001")} == {"skipped"}
    assert report.funnel is None


@pytest.mark.parametrize("name", ["Branchdrive.JSON", "RAW", "MANIFEST.SHA256", "raw\N{COMBINING ACUTE ACCENT}"])
def test_an_ignore_file_hides_no_name_that_some_systems_take_for_the_datasets_own(name: str, tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    (root / name).mkdir()
    (root / ".branchdriveignore").write_text("*\n")
    is_another = name.startswith("raw")
    assert failing(validate(root)) == (frozenset() if is_another else {"BD-LAY-005", "BD-LAY-009"})


# --- what cannot be read (access rights mean nothing to a superuser, so errors are injected)


@pytest.fixture
def unreadable(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Names that cannot be opened or listed."""
    names: set[str] = set()
    real_open, real_scan = os.open, os.scandir

    def checked_open(path: Any, *rest: Any, **more: Any) -> int:
        if isinstance(path, str) and path in names:
            raise PermissionError(13, "Permission denied", path)
        return real_open(path, *rest, **more)

    def checked_scan(path: Any = ".") -> Any:
        if (Path(f"/proc/self/fd/{path}").readlink() if isinstance(path, int) else Path(path)).name in names:
            raise PermissionError(13, "Permission denied", str(path))
        return real_scan(path)

    monkeypatch.setattr(os, "open", checked_open)
    monkeypatch.setattr(os, "scandir", checked_scan)
    return names


@pytest.mark.parametrize(
    ("name", "rule_id"),
    [
        ("branchdrive.json", "BD-DOC-001"),
        ("MANIFEST.sha256", "BD-LAY-001"),
        ("controls.parquet", "BD-TAB-001"),
        ("shard-00000", "BD-LAY-006"),
        ("raw", "BD-LAY-006"),
    ],
)
def test_what_cannot_be_read_is_a_finding(name: str, rule_id: str, tmp_path: Path, unreadable: set[str]) -> None:
    root = write(tmp_path / "dataset")
    unreadable.add(name)
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert rule_id in failing(report)


def test_media_that_cannot_be_read_are_a_finding(tmp_path: Path, unreadable: set[str]) -> None:
    root, tables = tmp_path / "dataset", synthetic.with_few_attempts(synthetic.media_tables())
    synthetic.write_dataset(root, tables, synthetic.media_descriptor())
    unreadable.add(synthetic.MEDIA_FILE)
    report = validate(root)
    few = {"BD-BNK-001"}  # attempts make no whole bank
    assert (report.verdict, report.errors, failing(report) - few) == ("invalid", (), {"BD-LAY-002"})
    assert len(found(report, "BD-LAY-002")) == 2
    assert all("Permission denied" in text for text in found(report, "BD-LAY-002"))


def test_a_root_that_cannot_be_listed_is_wrong_usage(tmp_path: Path, unreadable: set[str]) -> None:
    root = write(tmp_path / "dataset")
    unreadable.add("dataset")
    with pytest.raises(OSError, match="Permission denied"):
        validate(root)


def test_a_root_that_vanishes_is_wrong_usage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = write(tmp_path / "dataset")
    (root / ".branchdriveignore").write_text("notes\n")

    def moved_away(*_: Any) -> tuple[tuple[str, ...], str]:
        root.rename(tmp_path / "elsewhere")
        return (), ""

    monkeypatch.setattr("branchdrive.files.survey._read_patterns", moved_away)
    with pytest.raises(UsageError, match=r"dataset' went away while it was read"):
        validate(root)


def test_a_file_that_vanishes_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from branchdrive.engine import reading
    from branchdrive.engine.shard import audit_shard

    root = write(tmp_path / "dataset")

    def late(task: Any) -> Any:
        (root / FOLDER / "controls.parquet").unlink(missing_ok=True)
        return audit_shard(task)

    monkeypatch.setattr(reading, "audit_shard", late)
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert "BD-TAB-001" in failing(report)


# --- no dataset


def test_what_is_no_dataset_is_wrong_usage(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"x")
    (tmp_path / "empty").mkdir()
    for path, message in (
        (tmp_path / "nowhere", "is not a folder"),
        (tmp_path / "file", "is not a folder"),
        (tmp_path / "empty", "holds no dataset"),
    ):
        with pytest.raises(UsageError, match=message):
            validate(path)


@pytest.mark.parametrize("name", ["branchdrive.json", "MANIFEST.sha256", "raw"])
def test_whatever_has_a_part_of_a_dataset_is_judged(name: str, tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    for other in {"branchdrive.json", "MANIFEST.sha256", "raw"} - {name}:
        (root / other).rename(tmp_path / other)
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
