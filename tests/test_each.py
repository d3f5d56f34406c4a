"""A loop tries every case, names those that fail, and is never about nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.each import each


def test_every_case_is_tried_and_those_that_fail_are_named() -> None:
    tried = []

    @each("number", range(5), ids=lambda number: f"number {number}")
    def odd(number: int) -> None:
        tried.append(number)
        assert number % 2

    with pytest.raises(BaseExceptionGroup, match="3 of 5 cases fail: number 0, number 2, number 4") as caught:
        odd()
    assert tried == [0, 1, 2, 3, 4]
    assert [failure.__notes__ for failure in caught.value.exceptions] == [
        ["case: number 0"], ["case: number 2"], ["case: number 4"]
    ]  # fmt: skip


def test_a_missing_exception_is_a_failure_like_others() -> None:
    @each(("left", "right"), [(1, 0), pytest.param(1, 1, id="no error")])
    def raises(left: int, right: int) -> None:
        with pytest.raises(ZeroDivisionError):
            left // right

    with pytest.raises(BaseExceptionGroup, match="1 of 2 cases fail: no error"):
        raises()


def test_no_case_is_an_error() -> None:
    with pytest.raises(ValueError, match="no case gives 'number'"):
        each("number", [])

    @each("number", list)
    def holds_of_nothing(number: int) -> None:
        """Never called."""

    with pytest.raises(ValueError, match="no case gives 'number'"):
        holds_of_nothing()


def test_cases_of_a_function_are_made_when_the_test_runs() -> None:
    made = []

    def cases() -> list[int]:
        made.append("cases")
        return [1, 2]

    @each("number", cases)
    def is_one(number: int) -> None:
        assert number == 1

    assert not made
    with pytest.raises(BaseExceptionGroup, match="1 of 2 cases fail: 2"):
        is_one()
    assert made == ["cases"]


@each("first", "ab")
@each("second", range(2), ids=["zero", "one"])
def test_loops_nest_and_share_fixtures(first: str, second: int, tmp_path: Path) -> None:
    place = tmp_path / f"{first}{second}"
    place.touch(exist_ok=False)
    assert len(list(tmp_path.iterdir())) == "ab".index(first) * 2 + second + 1
