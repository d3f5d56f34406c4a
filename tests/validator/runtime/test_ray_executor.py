"""Ray as an executor: the same reports, the same bounds, nothing of folders that runs, and nothing left behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from io import StringIO
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from benchmarks.memory import process_tree
from tests.engines import needs_ray
from tests.hostile_folder import infest, marks, run_command
from tests.repo.checkout import ROOT
from tests.validator.engine.datasets import write
from tests.waiting import wait_for

from branchdrive.cli.main import run
from branchdrive.contract.limits import spec_limits
from branchdrive.engine.cached_task import CachedTask
from branchdrive.engine.shard import ShardTask, audit_shard
from branchdrive.engine.spool import Spool
from branchdrive.errors import PlatformError
from branchdrive.formats.folder import Folder
from branchdrive.formats.pack import pack_dataset
from branchdrive.formats.place import open_store
from branchdrive.formats.private_folder import PrivateFolder
from branchdrive.runtime.ray_executor import _connect, _places


@pytest.fixture(scope="module")
def valid_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("valid") / "dataset")


def start(what: str, place: Path, out: Path) -> subprocess.Popen[bytes]:
    """A program on Ray, in a session of its own."""
    command = [sys.executable, "-m", "tests.validator.runtime.ray_program", what, str(place), str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with (place.parent / f"{what}.log").open("wb") as log:
        return subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
        )


def said(what: str, tmp_path_factory: pytest.TempPathFactory, patience_s: float = 300) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp(what)
    out = folder / "found.json"
    (folder / "place").mkdir()
    assert start(what, folder / "place", out).wait(patience_s) == 0, (folder / f"{what}.log").read_text()[-3000:]
    found: dict[str, Any] = json.loads(out.read_text())
    return found


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return said("one-machine", tmp_path_factory)


@needs_ray
def test_tasks_end_on_ray_as_they_do_in_a_pool(found: dict[str, Any]) -> None:
    assert found["double"] == ["0", "2", "4"]
    assert found["none"] == []
    assert found["raise"][0] == "2"
    assert "ValueError: three" in found["raise"][1]
    assert found["die"] == ["2", "4", "Died()", "8"]
    assert found["allocate"] == ["1", "Died()"]
    assert found["lack"].endswith("no disk for 1") or found["lack"].endswith("no disk for 2")


@needs_ray
def test_a_task_whose_worker_is_killed_runs_once_more(found: dict[str, Any]) -> None:
    assert found["worker killed"] == ["0", "2", "4"]


@needs_ray
def test_reports_do_not_depend_on_the_engine_nor_on_a_cache(found: dict[str, Any]) -> None:
    assert found["reports"]["ray"] == found["reports"]["pool"] == found["reports"]["in process"]
    assert len({*map(json.dumps, json.loads(found["reports"]["ray"]))}) == 2
    assert found["relative"] == "valid"


@needs_ray
def test_files_are_decoded_in_a_bounded_process(found: dict[str, Any]) -> None:
    process = found["where"]
    assert (process["bytes"], process["threads"], process["safe"]) == (spec_limits().max_worker_bytes, "1", True)
    assert process["folder"] == str(ROOT)
    assert not process["has_ray"]
    assert all(Path(place).is_absolute() for place in process["path"])


@needs_ray
def test_workers_with_other_code_are_refused(found: dict[str, Any]) -> None:
    assert "has another branchdrive, other libraries or another Python" in found["other code"]


@needs_ray
def test_tasks_of_a_node_that_is_killed_run_on_another(tmp_path_factory: pytest.TempPathFactory) -> None:
    assert said("two-nodes", tmp_path_factory) == {"node killed": [str(2 * n) for n in range(12)]}


@needs_ray
def test_a_release_of_several_parts_has_the_bytes_of_one_machine(tmp_path_factory: pytest.TempPathFactory) -> None:
    built = said("built-in-parts", tmp_path_factory)
    assert built["ray"] == built["one process"]
    assert {f"model/contexts-train-0000{part}.parquet" for part in (0, 1)} <= built["ray"].keys()
    assert "quality/leakage.json" in built["ray"]


@needs_ray
def test_a_tenth_of_the_conformance_cases_say_the_same(tmp_path_factory: pytest.TempPathFactory) -> None:
    found = said("cases", tmp_path_factory, patience_s=3600)
    assert found["differing"] == []
    assert found["equal"] > 100


def named(pid: int) -> str:
    """Command line of a process; empty where it has ended."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().rstrip(b"\0").decode()
    return ""


@needs_ray
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_no_task_goes_on_after_a_driver_that_was_stopped(tmp_path: Path, number: signal.Signals) -> None:
    place = tmp_path / "pid"
    with start("waiting", place, tmp_path / "found.json") as driver:
        wait_for(lambda: place.exists() and place.read_text() != "")
        processes = process_tree(driver.pid)
        assert int(place.read_text()) in processes
        driver.send_signal(number)
        driver.wait(60)
    # Agents of Ray look for their node every now and then, and end by themselves.
    left = {pid for pid in processes if not named(pid).endswith("Agent")}
    wait_for(lambda: not any(named(pid) for pid in left))


@needs_ray
def test_nothing_of_a_folder_or_a_dataset_runs(valid_root: Path, tmp_path: Path) -> None:
    dataset, marks_dir = shutil.copytree(valid_root, tmp_path / "dataset"), tmp_path / "marks"
    packages = infest(dataset, marks_dir)
    reports = []
    for options, cwd, path in (
        ((), dataset, None),
        (("--executor", "ray"), dataset, ""),
        (("--executor", "ray"), packages, ""),
    ):
        name = "." if cwd == dataset else ".."
        done = run_command("branchdrive-validate", name, "--jobs", 1, "--format", "json", *options, cwd=cwd, path=path)
        document = json.loads(done.stdout)
        del document["dataset"]["path"]
        reports.append(document)
    assert reports[0] == reports[1] == reports[2]
    assert reports[0]["verdict"] == "invalid"
    assert marks(marks_dir) == []


def test_without_ray_the_command_says_how_to_install_it(valid_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    stderr = StringIO()
    assert run(["validate", str(valid_root), "--executor", "ray"], StringIO(), stderr) == 4
    assert "pip install" in stderr.getvalue() and "ray" in stderr.getvalue()


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (Exception("The current node timed out.\nMore."), "The current node timed out."),
        (TimeoutError(), "TimeoutError"),
    ],
)
def test_a_ray_that_does_not_start_is_a_fault_of_the_machine(error: Exception, reason: str) -> None:
    ray = Mock()
    ray.is_initialized.return_value = False
    ray.init.side_effect = error
    with pytest.raises(PlatformError, match=f"^there is no Ray on this machine: {reason}$"):
        _connect(ray, None, 1)


def test_folders_of_datasets_and_spools_are_found_in_tasks(valid_root: Path, tmp_path: Path) -> None:
    archive = tmp_path / "archives/dataset.zip"
    archive.parent.mkdir()
    pack_dataset(Folder(valid_root), archive)
    spool = Spool(tmp_path / "spool")
    for store, folder in ((Folder(valid_root), valid_root), (open_store(archive), archive.parent)):
        task = ShardTask(store, "raw/shard-00000", (), None, frozenset(), is_hashed=True, spool=spool)
        once = CachedTask(audit_shard, task, PrivateFolder(tmp_path / "cache"), "run", False, 0.0, 1, None)
        assert {*_places(once)} == {folder, spool.folder, tmp_path / "cache"}


@pytest.mark.parametrize("name", ["spark", "local:1", "", "ray2"])
def test_other_engines_are_refused(name: str, valid_root: Path) -> None:
    stderr = StringIO()
    assert run(["validate", str(valid_root), "--executor", name], StringIO(), stderr) == 2
    assert "is not `local`, `ray` or `ray:ADDRESS`" in stderr.getvalue()
