"""The audit's process has one thread of linear algebra, serves parts through its parent, and dies with the call."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from tests.hostile_folder import infest, marks
from tests.reference_impl.collect.running import session_of
from tests.repo.checkout import ROOT
from tests.validator.release.audit_tasks import Failing, Killer, Known, Teller
from tests.validator.release.running import QUICK
from tests.validator.runtime.tasks import sleep_and_tell
from tests.waiting import wait_for

from branchdrive.engine.spool import Spool
from branchdrive.errors import ToolError
from branchdrive.formats.folder import Folder
from branchdrive.leakage.classifier import SequenceClassifier, Unavailable
from branchdrive.leakage.replays import replay_inputs
from branchdrive.release import audit_process
from branchdrive.release.audit_process import AuditTask, audit_here, audit_in_own_process
from branchdrive.release.built_layers import load_layers
from branchdrive.release.scan import scan_raw
from branchdrive.release.spread_draw import SpreadDraw
from branchdrive.runtime.executor import in_process, isolated


class Parts(dict[str, dict[str, Any]]):
    """Parts in memory, of the audit with the first key that is asked for."""

    key = ""

    def __call__(self, key: str) -> Parts:
        self.key = self.key or key
        assert key == self.key
        return self

    def put(self, name: str, part: dict[str, Any]) -> None:
        self[name] = part


@pytest.fixture(scope="module")
def task_of(built: Path) -> Callable[[SequenceClassifier | Unavailable], AuditTask]:
    """A task on the groups of the built release."""
    with Spool.temporary() as spool:
        scan = scan_raw(Folder(built), spool, in_process)
        quality = load_layers(Folder(built)).rows("group_quality")
        inputs = replay_inputs(scan.rows["replays"], quality, scan.descriptor)
    return lambda classifier: AuditTask(Known(inputs), 3, QUICK, classifier)


NOBODY = Unavailable("none in this test")

Step = tuple[int, int, str]


@pytest.fixture(scope="module")
def audited_alone(task_of: Any) -> tuple[Any, Parts, list[Step]]:
    """What an audit in a process of its own finds, its parts, and what it tells of its steps; not to be changed."""
    parts, told = Parts(), list[Step]()
    document = audit_in_own_process(task_of(NOBODY), parts, lambda *step: told.append(step))
    return document, parts, told


@pytest.fixture
def gated(audited_alone: tuple[Any, Parts, list[Step]]) -> Parts:
    """Parts of an audit whose gate is known: what other classifiers change nothing of."""
    return Parts(gate=audited_alone[1]["gate"])


def test_it_has_one_thread_whatever_the_environment_says(
    task_of: Any, gated: Parts, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        monkeypatch.setenv(name, "2")
    document = audit_in_own_process(task_of(Teller()), gated)
    trained = [test["training"] for way in document["battery"]["ways"] for test in way["tests"] if test["training"]]
    assert trained == [{"num_epochs": 1, "best_epoch": 1}] * 6
    assert os.environ["OMP_NUM_THREADS"] == "2"


def test_it_finds_what_an_audit_here_finds(task_of: Any, audited_alone: tuple[Any, Parts, list[Step]]) -> None:
    document, parts, told = audited_alone
    same = Parts()
    here = audit_here(task_of(NOBODY), same)
    assert [numbers(document), parts.keys()] == [pytest.approx(numbers(here), rel=1e-6, abs=1e-9), same.keys()]
    assert [step[2] for step in told] == [*parts, "done"]
    assert {step[1] for step in told} == {len(parts)}


def test_processes_that_draw_change_no_bit(task_of: Any, audited_alone: tuple[Any, Parts, list[Step]]) -> None:
    assert audit_in_own_process(replace(task_of(NOBODY), jobs=2), Parts()) == audited_alone[0]


def test_an_executor_with_a_fresh_process_for_every_draw_changes_no_bit(
    task_of: Any, audited_alone: tuple[Any, Parts, list[Step]]
) -> None:
    """The gate and one part of the battery, which draws in every way; processes that stay draw for the others above."""
    document, parts, _ = audited_alone
    computed = ("gate", "13-way/explicit_label")
    known = Parts({name: part for name, part in parts.items() if name not in computed})
    assert len(known) == len(parts) - len(computed)
    assert audit_in_own_process(replace(task_of(NOBODY), executor=isolated(1)), known) == document
    assert known == parts


def test_a_process_that_has_others_compute_takes_no_inputs(
    task_of: Any, audited_alone: tuple[Any, Parts, list[Step]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither replays nor statistics nor features come to the process of the audit."""
    taken: list[str] = []
    get = Spool.get

    def noted(spool: Spool, name: str) -> Any:
        taken.append(name)
        return get(spool, name)

    monkeypatch.setattr(Spool, "get", noted)
    monkeypatch.setattr(Known, "__call__", lambda _: pytest.fail("inputs were made here"))
    document = audit_here(replace(task_of(NOBODY), jobs=2), Parts())
    assert not taken
    assert numbers(document) == pytest.approx(numbers(audited_alone[0]), rel=1e-6, abs=1e-9)


def refused(_: Any, numbers: range) -> None:
    raise ValueError(f"not {numbers.start}")


def ended(_: Any, numbers: range) -> None:
    raise MemoryError


@pytest.mark.parametrize(("function", "text"), [(refused, "ValueError: not 3"), (ended, "more memory than there is")])
def test_a_range_that_is_not_drawn_is_told(function: Any, text: str, tmp_path: Path) -> None:
    draw = SpreadDraw(Spool(tmp_path), in_process)
    with pytest.raises(ToolError, match=text):
        draw(function, "subject", [range(3, 5)])


def numbers(document: Any) -> list[float]:
    """Every number of a document, in order."""
    if isinstance(document, dict):
        return [number for key in sorted(document) for number in numbers(document[key])]
    if isinstance(document, list):
        return [number for item in document for number in numbers(item)]
    return [document] if isinstance(document, int | float) else []


def test_a_known_part_is_not_computed(task_of: Any, audited_alone: tuple[Any, Parts, list[Step]]) -> None:
    document, parts = audited_alone[0], Parts(audited_alone[1])
    parts["gate"] = {**parts["gate"], "reason": "known"}
    again = audit_in_own_process(task_of(NOBODY), parts)
    assert again == {**document, "gate": parts["gate"]}


def test_its_death_is_told(task_of: Any, gated: Parts) -> None:
    with pytest.raises(ToolError, match="the process of the leakage audit died; give it more memory"):
        audit_in_own_process(task_of(Killer()), gated)


def test_its_errors_are_the_callers(task_of: Any, gated: Parts) -> None:
    with pytest.raises(ValueError, match="scores have shape"):
        audit_in_own_process(task_of(Failing()), gated)


def test_it_does_not_outlive_an_interrupt(task_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[int] = []
    start = audit_process.subprocess.Popen

    def noted(*arguments: Any, **options: Any) -> Any:
        process = start(*arguments, **options)
        started.append(process.pid)
        return process

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(audit_process.subprocess, "Popen", noted)
    with pytest.raises(KeyboardInterrupt):
        audit_in_own_process(task_of(NOBODY), Parts(), interrupt)
    (pid,) = started
    wait_for(lambda: not session_of(pid))


def test_an_interrupt_leaves_no_rows_behind(task_of: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    there: list[str] = []

    def interrupt(*_: Any) -> None:
        there.extend(path.name for path in tmp_path.glob("branchdrive-*/*"))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        audit_in_own_process(replace(task_of(NOBODY), jobs=2), Parts(), interrupt)
    assert there and not [*tmp_path.glob("branchdrive-*")]


@dataclass(frozen=True)
class Endless:
    """Inputs that are never read to their end: the process that reads them tells its number, and sleeps."""

    told: Path

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return sleep_and_tell, (str(self.told),)


def test_it_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    told = tmp_path / "pid"
    script = (
        "from pathlib import Path\n"
        "from tests.validator.release.test_audit_process import NOBODY, AuditTask, Endless, Parts\n"
        "from branchdrive.release.audit_process import audit_in_own_process\n"
        f"audit_in_own_process(AuditTask(Endless(Path({str(told)!r})), 3, None, NOBODY), Parts())\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
    wait_for(lambda: told.exists() and told.read_text() != "")
    pid = int(told.read_text())
    assert session_of(pid) == [pid]
    parent.kill()
    parent.wait()
    wait_for(lambda: not session_of(pid))


def test_it_runs_nothing_of_the_current_folder(task_of: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    infest(tmp_path, tmp_path / "marks")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", ["", ".", "packages", *sys.path])
    monkeypatch.setenv("PYTHONPATH", ":.:packages")
    assert audit_in_own_process(task_of(NOBODY), Parts())["gate"]
    assert marks(tmp_path / "marks") == []
