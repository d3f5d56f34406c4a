"""What is printed of the guards' promises: each where it is claimed alone, with what takes from it beside it."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest
from tests.validator.benchmark.samples import data, noise, prediction_set, risk_fit, small_protocol

from branchdrive.benchmark.guard.calibration import CONDITIONAL, GLOBAL_MARGIN, GUARANTEE, LEARN_THEN_TEST
from branchdrive.benchmark.guard.table import UNGUARDED, noise_floor, promises
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.benchmark.warning import CALIBRATION_READ


@cache
def results(min_groups: int = 88, *warnings: str, with_noise: bool = True) -> dict[str, Any]:
    guard = small_protocol().guard.model_dump() | {"min_groups": min_groups}
    found = noise() if with_noise else None
    protocol = small_protocol(guard=guard)
    return results_document(protocol, data(), prediction_set(), risk_fit(), found, warnings=warnings)


def test_guards_that_were_judged_promise_word_for_word() -> None:
    assert promises(results()) == [GUARANTEE, CONDITIONAL, LEARN_THEN_TEST, GLOBAL_MARGIN]
    text = render_tables(results())
    assert all(f"\n\n{said}\n" in text for said in promises(results()))
    assert CALIBRATION_READ not in text


def test_a_guard_that_was_not_judged_promises_nothing() -> None:
    """The global margin is no guarantee, and says so."""
    refused = results(97)
    assert refused["guard"]["guarantee"] == {
        "conformal": None, "learn_then_test": None, "global_margin": GLOBAL_MARGIN,
    }  # fmt: skip
    names = "balanced, safety, progress, comfort, near_range"
    assert promises(refused) == [
        f"The selection-path guard was not judged under {names}: it promises nothing there.",
        f"Learn then test was not judged under {names}: it promises nothing there.",
        GLOBAL_MARGIN,
    ]
    assert "Assume that" not in render_tables(refused)


def test_a_guard_judged_under_some_profiles_promises_there() -> None:
    found = {**results(), "guard": {**results()["guard"], "profiles": [*results()["guard"]["profiles"]]}}
    first = found["guard"]["profiles"][0]
    found["guard"]["profiles"][0] = {**first, "conformal": {**first["conformal"], "refusal": "too few"}}
    assert promises(found)[:2] == [
        "The selection-path guard was not judged under balanced: it promises nothing there.", GUARANTEE
    ]  # fmt: skip


@pytest.mark.parametrize(("min_groups", "said"), [(88, True), (97, False)])
def test_a_premise_that_no_longer_holds_stands_beside_the_guarantee(min_groups: int, said: bool) -> None:
    found = results(min_groups, CALIBRATION_READ)
    assert (CALIBRATION_READ in promises(found)) is said
    if said:
        assert promises(found)[:2] == [CALIBRATION_READ, GUARANTEE]


def test_repeated_nominals_are_the_floor_of_violations() -> None:
    assert noise_floor(results()) == (
        "Repeated nominals lose more than 0.25 m of separation in 3 of 24 training groups (12.5 %), 4 of 48 repeats "
        "(8.3 %)."
    )
    noisy = {**results()["noise"], "tolerance": [None, 0.5, None, None, None, None]}
    sentence = noise_floor({**results(), "noise": noisy})
    assert sentence is not None
    assert "The tolerance of 0.25 m is below the noise tolerance of separation, 0.5000 m" in sentence
    assert noise_floor(results(88, with_noise=False)) is None


def test_every_table_of_a_guard_has_the_floor_and_what_its_rows_are() -> None:
    sections = [part for part in render_tables(results()).split("\n## ") if part.startswith("Guard, profile")]
    assert len(sections) == 5
    for section in sections:
        assert str(noise_floor(results())) in section
        assert UNGUARDED in section
        assert "\n| action_prior | " in section
