"""Families of tests against statsmodels."""

from __future__ import annotations

import gc

import pytest
from hypothesis import given
from hypothesis import strategies as st
from statsmodels.stats.multitest import multipletests

from branchdrive.benchmark.protocol.family import Family, adjust


@given(st.lists(st.floats(0, 1), min_size=1, max_size=24))
def test_adjusted_p_values_are_those_of_statsmodels(p_values: list[float]) -> None:
    names = tuple(f"t{i}" for i in range(len(p_values)))
    found = adjust([Family("all", names)], dict(zip(names, p_values, strict=True)))["all"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gc, "collect", int)  # which it calls every time, and which costs more than all the rest
        expected = multipletests(p_values, method="holm")[1]
    assert list(found) == list(names)
    assert [p for p, _ in found.values()] == pytest.approx(expected.tolist())


def test_a_test_of_two_families_is_adjusted_in_each() -> None:
    families = [Family("both", ("a", "b")), Family("one", ("a",))]
    found = adjust(families, {"a": 0.01, "b": 0.5, "unused": 0.0})
    assert found == {"both": {"a": (0.02, False), "b": (0.5, False)}, "one": {"a": (0.01, False)}}


def test_the_smallest_adjusted_p_is_the_size_of_the_family_in_flips() -> None:
    names = tuple("abcdefghi")
    found = adjust([Family("nine", names)], dict.fromkeys(names, 1 / 10_001))
    assert [p for p, _ in found["nine"].values()] == pytest.approx([9 / 10_001] * 9)


def test_what_the_running_maximum_takes_from_a_bound_is_a_bound() -> None:
    p_values = {"a": 0.001, "b": 0.0015, "c": 0.2}
    family = Family("three", ("c", "b", "a"))
    found = adjust([family], p_values, smallest={"a"})["three"]
    assert found == {"a": (0.003, True), "b": (0.003, True), "c": (0.2, False)}
    assert not any(is_bound for _, is_bound in adjust([family], p_values)["three"].values())


@pytest.mark.parametrize(
    ("families", "match"),
    [
        ([Family("f", ())], "is empty or names a test twice"),
        ([Family("f", ("a", "a"))], "is empty or names a test twice"),
        ([Family("f", ("a", "z"))], "names the test 'z', which has no p-value"),
        ([Family("f", ("a",)), Family("f", ("b",))], "share a name"),
    ],
)
def test_families_that_are_none_are_refused(families: list[Family], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        adjust(families, {"a": 0.1, "b": 0.2})
