"""What is printed of how selected drives end, on every surface, and that it changes nothing that was there."""

from __future__ import annotations

import copy
import json
from functools import cache
from typing import Any

import pytest
from tests.validator.benchmark.samples import data, data_with_endings, noise, prediction_set, small_protocol

from branchdrive.benchmark.headline import headline_sections
from branchdrive.benchmark.protocol.protocol import read_protocol
from branchdrive.benchmark.ranking.ending_table import LIMITS, MEANING, ending_sentence, ending_tables
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.card.selected import ending_section
from branchdrive.contract.document import schema_mismatches
from branchdrive.text.table import Table


@cache
def results() -> dict[str, Any]:
    return results_document(small_protocol(), data_with_endings(), prediction_set(), noise=noise())


def profile_of(**to_nominal: tuple[float, float]) -> dict[str, Any]:
    """A profile whose selectors differ from nominal so much, in clean drives and in completed routes."""
    profile: dict[str, Any] = json.loads(json.dumps(results()["ranking"]["profiles"][0]))
    for entry in profile["entries"]:
        values = to_nominal.get(entry["selector"].replace("-", "_"), (0.0, 0.0))
        entry["outcomes"]["endings"]["to_nominal"] = {
            end: {"value": value, "low": None, "high": None}
            for end, value in zip(("clean", "completed"), values, strict=True)
        }
    return profile


def test_endings_are_added_and_nothing_else_changes() -> None:
    assert schema_mismatches(results(), "results.schema.json") == []
    found = copy.deepcopy(results())
    for profile in found["ranking"]["profiles"]:
        assert profile.pop("num_with_clean") == profile["num_ranked"]
        assert profile["entries"].pop()["selector"] == "oracle_clean"
        for entry in profile["entries"]:
            del entry["outcomes"]["endings"]
    assert found == results_document(small_protocol(), data(), prediction_set(), noise=noise())


def test_a_protocol_without_outcomes_has_no_endings() -> None:
    before = small_protocol().document
    del before["outcomes"]
    found = results_document(read_protocol(before), data_with_endings(), prediction_set(), noise=noise())
    assert found == results_document(read_protocol(before), data(), prediction_set(), noise=noise())


def test_every_selector_has_a_row_under_every_profile() -> None:
    text = render_tables(results())
    for profile in results()["ranking"]["profiles"]:
        assert f"## Selected drives to their end, profile {profile['profile']}" in text
        (table,) = ending_tables(profile)
        assert [row[0] for row in table.rows] == [entry["selector"] for entry in profile["entries"]]
        assert table.has_intervals
        clean = {row[0]: row[4] for row in table.rows}
        assert clean["oracle_clean"].startswith("100.0% [")
        assert table.rows[1][5] == "+0.0"  # nominal, of itself
    assert "Selected drives to their end" not in render_tables(
        results_document(small_protocol(), data(), prediction_set(), noise=noise())
    )


def test_what_sees_more_than_sensors_stands_apart() -> None:
    profile = profile_of()
    profile["entries"][-1]["sees"] = "privileged inputs"
    titles = [table.title for table in ending_tables(profile)]
    assert titles == [f"Selected drives to their end, profile balanced{suffix}" for suffix in ("", ", privileged")]
    assert [len(table.rows) for table in ending_tables(profile)] == [len(profile["entries"]) - 1, 1]


def test_drives_that_end_worse_than_those_of_nominal_are_named() -> None:
    assert ending_sentence(profile_of(oracle=(0.1, 0.0))) is None
    said = ending_sentence(profile_of(oracle=(-0.361, -0.393), O_M3=(0.05, -0.0204), random=(-1e-12, 0.0)))
    assert said == (
        "Drives end worse than those of nominal in the same groups: `O-M3` (completed 2.0 points less), `oracle` "
        "(clean 36.1 points less, completed 39.3 points less)."
    )
    shown = {**results(), "ranking": {**results()["ranking"], "profiles": [profile_of(oracle=(-0.361, -0.393))]}}
    assert "same groups: `oracle` (clean 36.1 points less, completed 39.3 points less)." in render_tables(shown)


@pytest.mark.parametrize("sentence", [MEANING, LIMITS])
def test_every_surface_says_what_a_drive_is_and_what_it_is_not(sentence: str) -> None:
    profiles = results()["ranking"]["profiles"]
    assert render_tables(results()).count(sentence) == len(profiles)
    assert "\n".join(ending_section(results())).count(sentence) == 1
    notes = [note for section in headline_sections(results()) if isinstance(section, Table) for note in section.notes]
    assert notes.count(sentence) == 1
    assert "expert's policy" in MEANING
    assert "called safe" in LIMITS


def test_the_terminal_and_the_card_show_clean_drives_by_profile() -> None:
    title = "Selections whose drive is clean to its end"
    (table,) = (s for s in headline_sections(results()) if s.title == f"{title}, by profile")
    assert isinstance(table, Table)
    names = [profile["profile"] for profile in results()["ranking"]["profiles"]]
    assert [column.title for column in table.columns] == ["Selector", *names]
    entries = {entry["selector"]: entry for entry in results()["ranking"]["profiles"][0]["entries"]}
    clean = entries["nominal"]["outcomes"]["endings"]["clean"]
    assert next(row for row in table.rows if row[0] == "nominal")[1] == f"{100 * clean['value']:.1f}%"
    lines = ending_section(results())
    assert lines[0] == f"## {title}"
    row = next(line for line in lines if line.startswith("| nominal "))
    assert f"{100 * clean['value']:.1f}% [{100 * clean['low']:.1f}%, {100 * clean['high']:.1f}%]" in row
    assert any(line.startswith("Under `balanced`: Drives end worse than those of nominal") for line in lines)


def test_a_card_tells_nothing_of_ends_that_nothing_is_known_of() -> None:
    assert ending_section(None) == []
    assert ending_section(results_document(small_protocol(), data(), prediction_set(), noise=noise())) == []
