"""Derived layers when processes die of them: what was not judged is inconclusive, and no finding."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from tests.audits import remembering
from tests.validator.engine.rules.release import release_draft

from branchdrive.contract.layer import table_path
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.rule import CATALOGUE, rules_of
from branchdrive.engine.derived_files import STRUCTURE_RULES, LayerFilesTask
from branchdrive.engine.derived_rules import LayersTask
from branchdrive.engine.validate import validate
from branchdrive.runtime.executor import Died, Executor

GIB = 1 << 30


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of a valid release; read-only by agreement."""
    return release_draft().write(tmp_path_factory.mktemp("release") / "dataset")


@pytest.fixture(autouse=True)
def _in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The release has a few groups, which would be judged in one task."""
    monkeypatch.setattr("branchdrive.engine.derived.MAX_GROUPS_AT_ONCE", -1)


def deadly(is_deadly: Callable[[Any], bool]) -> Executor:
    """Executor whose processes die of some tasks."""

    def run(function: Any, tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        for index, task in enumerate(tasks):
            if is_deadly(task):
                yield index, Died()
            else:
                ((_, outcome),) = remembering(function, [task])
                yield index, outcome

    return run


def is_on_the_whole(task: Any) -> bool:
    return isinstance(task, LayersTask) and task.max_bytes != spec_limits().max_worker_bytes


def test_a_death_over_the_whole_dataset_is_no_verdict_on_data(release: Path) -> None:
    report = validate(release, executor=deadly(is_on_the_whole), dataset_memory_bytes=3 * GIB)
    assert (report.verdict, report.exit_code, report.errors) == ("partial", 3, ())
    tallies = {tally.rule_id: tally for tally in report.tallies if tally.is_claimed}
    assert not [tally for tally in tallies.values() if tally.num_findings and tally.info.decides]
    judged = {*STRUCTURE_RULES, *rules_of("layer_rows")}
    for rule_id in tallies.keys() & {*rules_of("layers", "layer_rows")}:
        if rule_id in judged:
            assert tallies[rule_id].unjudged is None
        else:
            assert tallies[rule_id].status == "inconclusive"
            words = str(tallies[rule_id].reason)
            assert "21 groups" in words
            assert "more than 3.0 GiB" in words
            assert "--dataset-memory" in words
    assert report.population is None


def test_the_limit_over_the_whole_dataset_is_its_own(release: Path) -> None:
    limits: set[int] = set()

    def noting(task: Any) -> bool:
        limits.update([task.max_bytes] if isinstance(task, LayersTask) else [])
        return False

    assert validate(release, executor=deadly(noting)).verdict == "valid"
    assert limits == {spec_limits().max_worker_bytes, spec_limits().max_dataset_worker_bytes}


def test_a_death_over_a_part_is_no_verdict_on_data_either(release: Path) -> None:
    deadly_part = deadly(lambda task: isinstance(task, LayersTask) and not is_on_the_whole(task))
    report = validate(release, executor=deadly_part)
    assert report.verdict == "partial"
    for tally in report.tallies:
        if tally.info.scope == "layer_rows" and tally.is_claimed:
            assert tally.status == "inconclusive"
            assert "more than 4.0 GiB" in str(tally.reason)


def is_of_many_files(task: Any) -> bool:
    return isinstance(task, LayerFilesTask) and task.part == 0 and len(task.files) > 1


def test_files_that_take_too_much_together_are_no_verdict_on_data(release: Path) -> None:
    report = validate(release, executor=deadly(is_of_many_files))
    assert (report.verdict, report.exit_code) == ("partial", 3)
    assert not [t for t in report.tallies if t.num_findings and t.info.decides]
    reasons = {t.reason for t in report.tallies if t.info.layer and t.is_claimed}
    assert any("files of part 0 together took more than 4.0 GiB" in str(reason) for reason in reasons)


@pytest.mark.parametrize(
    ("path", "rule_id"), [(table_path("pairs"), "BD-LYR-002"), ("quality/split.json", "BD-LYR-005")]
)
def test_a_file_that_kills_by_itself_is_a_finding(path: str, rule_id: str, release: Path) -> None:
    report = validate(release, executor=deadly(lambda task: isinstance(task, LayerFilesTask) and path in task.files))
    assert (report.verdict, report.exit_code) == ("invalid", 1)
    decisive = [found for found in report.findings if CATALOGUE[found.rule].decides]
    assert [(found.rule, found.location) for found in decisive] == [(rule_id, {"file": path})]
