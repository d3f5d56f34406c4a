"""Work of `run_each` by an executor: results, reports and errors as by processes of its own, and no limit on memory."""

from __future__ import annotations

import pytest
from tests.validator.runtime.tasks import Adding, Counting, die_between, raise_between, refuse

from branchdrive.errors import PlatformError, ToolError, UsageError
from branchdrive.runtime.elsewhere import unseen_error
from branchdrive.runtime.executor import Executor, in_process, isolated
from branchdrive.runtime.workers import run_each


@pytest.mark.parametrize("executor", [in_process, isolated(2)], ids=["here", "processes"])
def test_every_task_gives_its_result_and_its_reports(executor: Executor) -> None:
    reports: list[tuple[int, int]] = []

    def watch(task: int, part: int) -> None:
        reports.append((task, part))

    found = list(run_each(Adding(3), range(5), jobs=1, executor=executor, watch=watch))
    assert sorted(found) == [3, 4, 5, 6, 7]
    assert sorted(reports) == [(task, part) for task in range(5) for part in range(2)]
    assert list(run_each(Adding(3), [], jobs=1, executor=executor)) == []


def test_errors_of_ours_come_back_as_they_are_after_what_was_reported() -> None:
    reports: list[int] = []
    with pytest.raises(UsageError, match=r"^no 7$"):
        list(run_each(refuse, [7], jobs=1, executor=isolated(1), watch=reports.append))
    assert reports == [7]


def test_other_errors_and_deaths_are_those_of_the_tool() -> None:
    with pytest.raises(ToolError, match=r"a worker process failed \(LookupError: 'no seed 1'|no seed 1\)"):
        list(run_each(raise_between, [1], jobs=1, executor=in_process))
    with pytest.raises(ToolError, match="a worker process died; make room in memory"):
        list(run_each(die_between, [2], jobs=1, executor=isolated(1)))


def test_a_process_keeps_what_a_function_keeps_and_has_no_limit_on_memory() -> None:
    for name in ("one", "another"):
        found = list(run_each(Counting(name), [1, 2, 3], jobs=1, executor=isolated(1)))
        assert len({process for process, _, _ in found}) == 1
        assert [count for _, count, _ in found] == [1, 2, 3]
        assert all(is_free for _, _, is_free in found)


def test_what_is_finished_elsewhere_alone_is_a_fault_of_the_platform() -> None:
    error = unseen_error("group 'g1'")
    assert isinstance(error, PlatformError) and "one folder that they share" in str(error)
