"""Processes change no bit, and an interruption loses no state."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.reference_impl.learning.small_models import SMALL, small
from tests.sampling import THOROUGH

from branchdrive import UsageError, open_model
from branchdrive.model.reader import ModelLayer
from branchdrive.runtime.executor import isolated
from branchdrive_reference.learning.pool import Task, train_models
from branchdrive_reference.learning.training import EpochReport


@THOROUGH  # `train --jobs 2` in test_hostile_folder.py of the benchmark comes to the same weights
def test_processes_change_no_bit(release: Path, tmp_path: Path) -> None:
    tasks = [Task(SMALL["M1"], 11), Task(SMALL["M3"], 11), Task(SMALL["M3"], 23)]
    seen: list[EpochReport] = []
    train_models(release, tmp_path / "there", tasks[2:])  # which is not trained again
    there = train_models(release, tmp_path / "there", tasks, jobs=2, on_epoch=seen.append)
    here = train_models(release, tmp_path / "here", tasks)
    elsewhere = train_models(release, tmp_path / "elsewhere", tasks, executor=isolated(1))
    for trained in (there, elsewhere):
        assert [found.sha256 for found in trained] == [found.sha256 for found in here]
    assert [(found.provenance.model, found.provenance.seed) for found in there] == [("M1", 11), ("M3", 11), ("M3", 23)]
    assert sorted((one.model, one.seed, one.epoch) for one in seen) == [
        (task.configuration.model.name, task.seed, epoch) for task in tasks[:2] for epoch in range(1, 9)
    ]


def test_models_that_are_there_start_no_process(release: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("branchdrive.runtime.workers._in_workers")
    tasks = [Task(SMALL["M1"], 11), Task(SMALL["M1"], 23)]
    first = train_models(release, tmp_path, tasks)
    again = train_models(release, tmp_path, tasks, jobs=2)
    assert [found.sha256 for found in again] == [found.sha256 for found in first]


def test_a_release_is_opened_once_in_a_process(release: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []

    def open_and_noted(root: Path) -> ModelLayer:
        opened.append(root)
        return open_model(root)

    monkeypatch.setattr("branchdrive_reference.learning.pool.open_model", open_and_noted)
    train_models(release, tmp_path, [Task(SMALL["M1"], 11)])
    assert opened == [release]


def test_an_error_in_one_process_stops_the_others(release: Path, tmp_path: Path) -> None:
    endless = small("M3", max_epochs=10**7, patience=10**7)
    tasks = [Task(endless, 11), Task(small("M1", learning_rate=1e38, warmup_epochs=1), 11)]
    with pytest.raises(UsageError, match=r"M1, seed 11: the loss of epoch \d is not a number"):
        train_models(release, tmp_path, tasks, jobs=2)
    assert {path.name for path in tmp_path.iterdir()} <= {"M3-seed11.training"}


def test_who_watches_in_this_process_may_stop_it(release: Path, tmp_path: Path) -> None:
    def stop(report: EpochReport) -> None:
        if report.epoch == 3:
            raise KeyboardInterrupt

    tasks = [Task(SMALL["M1"], 11)]
    with pytest.raises(KeyboardInterrupt):
        train_models(release, tmp_path, tasks, on_epoch=stop)
    seen: list[EpochReport] = []
    train_models(release, tmp_path, tasks, on_epoch=seen.append)
    assert seen[0].epoch == 4


def test_two_models_of_one_name_are_refused(release: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="have one model, seed and fold"):
        train_models(release, tmp_path, [Task(SMALL["M1"], 11), Task(small("M1", patience=2), 11)])
