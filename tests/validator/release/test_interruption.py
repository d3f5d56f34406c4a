"""A build that was killed or interrupted goes on: the same bytes in the end, nothing left over, no part made twice."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from tests.reference_impl.collect.running import heed_interrupts, session_of
from tests.sampling import THOROUGH
from tests.synthetic_release import SEED
from tests.validator.release.running import build, call, contents, raw_state
from tests.waiting import PATIENCE_S, wait_for

from branchdrive.contract.layout import STAGING_DIR
from branchdrive.errors import UsageError
from branchdrive.formats.folder import Folder
from branchdrive.leakage import audit
from branchdrive.release import built_layers
from branchdrive.release import leakage as stored
from branchdrive.release import publish as publication
from branchdrive.release.publish import staging


class PowerCut(BaseException):
    """The end, without a chance to clean up."""


def cut_after(steps: int, monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """Let the power fail after so many steps that write, move or delete a file; returns how many were taken."""
    taken = count()
    last = [0]

    def counted(step: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(*arguments: Any) -> Any:
            last[0] = next(taken)
            if last[0] == steps:
                raise PowerCut
            return step(*arguments)

        return wrapper

    for name in ("move", "write_file", "delete"):
        monkeypatch.setattr(publication, name, counted(getattr(publication, name)))
    monkeypatch.setattr(built_layers, "write_file", counted(built_layers.write_file))  # of tables, part by part
    monkeypatch.setattr(Folder, "replace", counted(Folder.replace))  # of descriptor and manifest
    return lambda: last[0]


@pytest.mark.parametrize("step", [23, pytest.param(1, marks=pytest.mark.thorough)])
def test_a_build_goes_on_after_a_cut_at_any_step(
    raw: Path, built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    expected, at = contents(built), 0
    while True:
        root = shutil.copytree(raw, tmp_path / f"{at}")
        before = raw_state(root)
        with monkeypatch.context() as patch:
            num_taken = cut_after(at, patch)
            try:
                build(root)
            except PowerCut:
                is_done = expected.items() <= contents(root).items()  # the lock is the last to go
                assert at == 0 or (root / STAGING_DIR / "build").is_dir() or is_done, at
            else:
                assert contents(root) == expected
                break
        assert raw_state(root) == before, at
        build(root)
        assert contents(root) == expected, at
        assert raw_state(root) == before, at
        shutil.rmtree(root)
        at += step
    assert num_taken() > 40


@pytest.mark.parametrize("step", [17, pytest.param(1, marks=pytest.mark.thorough)])
@THOROUGH
def test_a_rebuild_goes_on_after_a_cut_at_any_step(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    """The ledger of the first build is never lost, and no stage builds on a mixture of both."""
    undisturbed = shutil.copytree(built, tmp_path / "undisturbed")
    build(undisturbed, seed=SEED + 1)
    expected, at, is_cut = contents(undisturbed), 0, True
    while is_cut:
        root = shutil.copytree(built, tmp_path / f"{at}")
        with monkeypatch.context() as patch:
            cut_after(at, patch)
            try:
                build(root, seed=SEED + 1)
                is_cut = False
            except PowerCut:
                is_cut = True
        build(root, seed=SEED + 1)
        assert contents(root) == expected, at
        shutil.rmtree(root)
        at += step


def test_finished_parts_of_an_audit_are_not_computed_again(
    built: Path, audited: Path, tmp_path: Path, audit_in_this_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = shutil.copytree(built, tmp_path / "release")
    gates: list[int] = []
    gate, write = audit.gate_of, stored.replace_file
    parts: list[str] = []

    def counted_gate(*arguments: Any, **options: Any) -> Any:
        gates.append(1)
        return gate(*arguments, **options)

    def counted_write(path: Path, content: bytes) -> None:
        parts.append(path.name)
        write(path, content)

    monkeypatch.setattr(audit, "gate_of", counted_gate)
    monkeypatch.setattr(stored, "replace_file", counted_write)

    def interrupt(stage: str, done: int, _: int, _note: str) -> None:
        if (stage, done) == ("leakage", 3):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build(root, stages=["leakage"], progress=interrupt)
    assert (len(gates), len(parts)) == (1, 3)
    (kept,) = (root / STAGING_DIR / "build").glob("leakage-*")
    (kept / parts[1]).write_bytes(b"{")  # of a disk that was full
    build(root, stages=["leakage", "model"])
    assert len(gates) == 1
    assert sorted(parts.count(name) for name in set(parts)) == [1] * (len(set(parts)) - 1) + [2]
    assert contents(root) == contents(audited)


def test_parts_of_an_audit_with_another_seed_are_not_taken(
    built: Path, tmp_path: Path, audit_in_this_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = shutil.copytree(built, tmp_path / "release")
    gates: list[int] = []

    def gate(*_: Any, seed: int, **__: Any) -> Any:
        gates.append(seed)
        raise PowerCut

    monkeypatch.setattr(audit, "gate_of", gate)
    for seed in (1, 2):
        with pytest.raises(PowerCut):
            build(root, stages=["leakage"], seed=seed)
    assert gates == [1, 2]


def test_two_builds_at_once_are_refused(built: Path, dataset: Path) -> None:
    with staging(dataset):
        with pytest.raises(UsageError, match="a build or a benchmark is running there; wait until it has finished"):
            build(dataset)
        assert (dataset / STAGING_DIR).is_dir()
    build(dataset)
    assert contents(dataset) == contents(built)


def test_an_interrupt_is_one_line_and_exit_code_130(
    built: Path, dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("branchdrive.release.builder.build_quality", interrupted)
        assert call("build", dataset, "--no-leakage") == (130, "", "branchdrive: interrupted\n")
    build(dataset)
    assert contents(dataset) == contents(built)


def interrupted(*_: Any) -> None:
    raise KeyboardInterrupt


def start(root: Path) -> subprocess.Popen[str]:
    """`branchdrive build` in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "branchdrive.cli", "build", str(root), "--no-leakage", "--seed", str(SEED)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    )


@pytest.mark.parametrize(
    "sign",
    [
        STAGING_DIR,
        pytest.param("canonical/source.json", marks=pytest.mark.thorough),
        pytest.param("quality/split.json", marks=pytest.mark.thorough),
        pytest.param("model/contexts-00000.parquet", marks=pytest.mark.thorough),
    ],
)
def test_a_killed_build_goes_on(dataset: Path, built: Path, sign: str) -> None:
    before = raw_state(dataset)
    process = start(dataset)
    wait_for(lambda: (dataset / sign).exists() or process.poll() is not None)
    process.kill()
    process.communicate()
    build(dataset)
    assert contents(dataset) == contents(built)
    assert raw_state(dataset) == before


def test_a_build_that_is_interrupted_from_the_keyboard_stops_in_one_line(dataset: Path) -> None:
    before = contents(dataset)
    process = start(dataset)
    wait_for(lambda: len(session_of(process.pid)) >= 2)  # with a worker, which reads the raw layer
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out, err) == (130, "", "branchdrive: interrupted\n")
    assert contents(dataset) == before
    wait_for(lambda: not session_of(process.pid))
