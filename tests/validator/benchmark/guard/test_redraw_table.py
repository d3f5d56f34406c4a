"""Both guards at every tolerance: one table, with what its figures are and are not."""

from __future__ import annotations

from functools import cache
from typing import Any

from tests.validator.benchmark.samples import (
    data,
    further_risks,
    guarded_protocol,
    noise,
    prediction_set,
    risk_fit,
    small_protocol,
)

from branchdrive.benchmark.guard.calibration import DEVELOPMENT, GUARANTEE, guarantee
from branchdrive.benchmark.guard.redraw_table import GUARDS, redraw_sections
from branchdrive.benchmark.guard.table import noise_floor, promises
from branchdrive.benchmark.ranking.noise import RepeatLosses
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.text.table import Table


@cache
def results() -> dict[str, Any]:
    risks = {guarded: risk for guarded, risk in further_risks().items() if guarded != ("M1", 0.5)}
    known = noise()._replace(further_losses={0.5: RepeatLosses(24, 1, 48, 2)})
    return results_document(guarded_protocol(), data(), prediction_set(), risk_fit(), known, further_risks=risks)


@cache
def table() -> Table:
    found = redraw_sections(results())[0]
    assert isinstance(found, Table)
    return found


def test_results_of_further_guards_conform_and_come_back() -> None:
    assert schema_mismatches(results(), "results.schema.json") == []
    assert parse_json(dump_json(results())) == results()
    guarded = [(guard["model"], guard["tolerance_m"]) for guard in results()["further_guards"]]
    assert guarded == list(guarded_protocol().guard.further)


def test_the_first_guard_is_the_same_beside_others() -> None:
    alone = results_document(small_protocol(), data(), prediction_set(), risk_fit(), noise())
    assert "further_guards" not in alone
    profiles = [
        {key: found for key, found in profile.items() if key != "redraws"} for profile in results()["guard"]["profiles"]
    ]
    assert {**results()["guard"], "profiles": profiles} == alone["guard"]


def test_one_table_has_every_guard_at_every_tolerance() -> None:
    named = [tuple(row[:4]) for row in table().rows]
    profiles = list(guarded_protocol().preferences)
    judged = [("M3", "0.25"), ("M3", "0.5"), ("M1", "0.25")]
    assert named == [
        (*guarded, profile, title) for guarded in judged for profile in profiles for title in GUARDS.values()
    ]
    first = results()["guard"]["profiles"][0]["redraws"]["conformal"]
    assert table().rows[1][5] == f"{first['mean']:.3f} ± {first['error']:.4f}"


def test_the_table_says_what_a_redraw_is_and_what_the_margin_is_not() -> None:
    text = render_tables(results())
    assert "1,000 redraws; the rate is 0.05." in table().notes[0]
    assert "global margin on 10 and 10 clusters, conformal on 48 and 10 clusters" in table().notes[0]
    assert table().notes[1] == DEVELOPMENT
    assert text.count(DEVELOPMENT) == 1 + len(guarded_protocol().preferences)
    assert "M1 at 0.5 m was not judged: No risk was fitted." in text


def test_each_guarantee_stands_once_word_for_word() -> None:
    said = promises(results())
    assert [said.count(text) for text in (GUARANTEE, guarantee(0.5))] == [1, 1]
    assert "more than 0.5 m below the recorded nominal one" in guarantee(0.5)


def test_repeats_are_counted_at_both_tolerances() -> None:
    found = str(noise_floor(results()))
    assert "lose more than 0.25 m of separation in 3 of 24" in found
    assert "lose more than 0.5 m of separation in 1 of 24" in found


def test_without_redraws_and_further_guards_there_is_no_such_table() -> None:
    alone = results_document(small_protocol(), data(), prediction_set(), risk_fit(), noise())
    assert redraw_sections(alone) == []
    assert DEVELOPMENT not in render_tables(alone)
