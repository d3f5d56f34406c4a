"""The report as a whole: every section is there in every form, conforms to its schema, and nothing passes silently."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from tests.synthetic import base_tables
from tests.validator.engine import datasets
from tests.validator.engine.rules.case import BRAKE

from branchdrive.cli.main import run
from branchdrive.contract.document import schema_mismatches
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.report import PilotReport, examine_pilot
from branchdrive.pilot.route_plan import expected_clusters
from branchdrive.pilot.section import Concern, Section
from branchdrive.runtime.executor import in_process
from branchdrive.statistics.binomial import binomial_interval
from branchdrive.text.table import Column, Table

SECTIONS = [
    "conformance", "physics", "response", "columns", "determinism", "crash", "replay", "leakage", "funnel", "routes",
    "cost",
]  # fmt: skip


@pytest.fixture(scope="module")
def report(pilot: Pilot) -> PilotReport:
    return examine_pilot(pilot, None, num_kills=1)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Validate in this process."""
    monkeypatch.setattr("branchdrive.runtime.executor.isolated", lambda jobs: in_process)


def command(*arguments: object) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    code = run(["pilot", *map(str, arguments)], out, err)
    return code, out.getvalue(), err.getvalue()


def test_the_report_conforms_to_its_schema_and_has_every_section(report: PilotReport) -> None:
    document = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert schema_mismatches(document, "pilot.schema.json") == []
    assert [section["name"] for section in document["sections"]] == SECTIONS


def test_a_right_pilot_has_no_problem_and_runs_that_nobody_asked_for_are_not_examined(report: PilotReport) -> None:
    assert [concern.what for _, concern in report.concerns if concern.is_problem] == []
    assert report.exit_code == 0
    results = {section.name: section.result for section in report.sections}
    assert results["determinism"] == results["crash"] == "not examined"


def test_figures_are_of_the_pilot(report: PilotReport) -> None:
    figures = {section.name: section.figures for section in report.sections}
    assert figures["funnel"]["wanted"] == round(24_000 * 3 / report.pilot.report.dataset.num_rollouts)
    assert figures["funnel"]["stages"]["eligibility"]["groups"] == 3
    assert figures["routes"]["clusters"] == 3
    assert figures["physics"]["signs"]["applied_steer"]["contrary"] == 0
    assert figures["physics"]["figures"]["speed"]["median"] == pytest.approx(1, abs=0.01)
    assert abs(figures["response"]["onset_s"]) < 0.05
    assert figures["conformance"]["verdict"] == "valid"


def test_a_unit_that_some_attempts_have_wrong_is_reported(tmp_path: Path, quick: None) -> None:
    first = datasets.row_of("observations", BRAKE, 0), datasets.row_of("observations", BRAKE, 41)
    speeds = base_tables()[datasets.FOLDER]["observations"]["speed_mps"].to_pylist()
    faster = datasets.cells("observations", "speed_mps", {row: 3.6 * speeds[row] for row in range(*first)})
    code, out, _ = command(datasets.write(tmp_path / "dataset", faster), "--format", "json")
    assert code == 1
    (physics,) = (section for section in json.loads(out)["sections"] if section["name"] == "physics")
    (concern,) = physics["concerns"]
    assert concern["what"].startswith("Not all attempts hold what figures of the whole pilot do: ")
    assert re.search(r"BD-MOT-006 \(1 of \d+\)", concern["what"])


def test_what_a_pilot_holds_is_counted_once(pilot: Pilot) -> None:
    assert pilot.collected is pilot.collected


def test_a_broken_dataset_is_a_problem_and_what_cannot_be_read_is_not_examined(tmp_path: Path, quick: None) -> None:
    root = datasets.write_with(tmp_path / "dataset", {f"{datasets.FOLDER}/controls.parquet": b"no table"})
    code, out, err = command(root, "--format", "json")
    assert (code, err) == (1, "")
    document: dict[str, Any] = json.loads(out)
    assert schema_mismatches(document, "pilot.schema.json") == []
    results = {section["name"]: section["result"] for section in document["sections"]}
    assert results.pop("conformance") == "problem"
    assert set(results.values()) == {"not examined"}


def test_text_and_markdown_say_what_to_do(tmp_path: Path, quick: None) -> None:
    departure = datasets.DEPARTURES["another command applied"]
    root = datasets.write(tmp_path / "dataset", departure.tables())
    code, text, _ = command(root, "--groups", 100)
    assert code == 1
    assert "forecasts are for 100 groups" in text
    assert "Conformance, problem: BD-CTL-009" in text
    assert "Not examined: no command was given" in text
    assert text.rstrip().endswith("not examined.")
    assert max(map(len, text.splitlines())) <= 120
    code, page, _ = command(root, "--format", "markdown", "--output", tmp_path / "pilot.md")
    assert (code, page) == (1, "")
    page = (tmp_path / "pilot.md").read_text()
    assert page.startswith("# Pilot of ")
    assert "**Conformance, problem.** BD-CTL-009" in page
    assert page.index("## To do") < page.index("## Conformance: problem")


def test_a_pilot_has_at_most_so_many_groups(tmp_path: Path, quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive.pilot.pilot.MAX_GROUPS", 2)
    code, _, err = command(datasets.write(tmp_path / "dataset"))
    assert code == 2
    assert "a pilot has at most 2" in err


def test_the_folder_of_runs_must_be_empty(tmp_path: Path, quick: None) -> None:
    root = datasets.write(tmp_path / "dataset")
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "mine").touch()
    code, _, err = command(root, "--work", tmp_path / "work", "--rerun", "true {out}")
    assert code == 2
    assert "is not empty" in err


def test_a_section_without_anything_is_never_fine() -> None:
    assert Section("n", "N").result == "not examined"
    assert Section("n", "N", ["fact"]).result == "fine"
    assert Section("n", "N", ["fact"], not_examined=["why"]).result == "in part"
    assert Section("n", "N", tables=[Table("T", [Column("c")], [])]).result == "fine"
    assert Section("n", "N", ["fact"], [Concern("w", "r", is_problem=False)]).result == "advice"
    assert Section("n", "N", concerns=[Concern("w", "r")], not_examined=["why"]).result == "problem"


def test_expected_clusters_are_those_of_chao() -> None:
    assert expected_clusters([4, 3, 3], 1000) == 3  # nothing was seen once
    few = expected_clusters([1, 1, 2, 2, 2], 10_000)
    assert few == pytest.approx(5 + 7 / 8 * 4 / 6, abs=0.01)
    assert expected_clusters([1, 1, 2, 2, 2], 8) == 5
    assert expected_clusters([1] * 12, 10**9) == pytest.approx(12 + 11 / 12 * 66, abs=0.01)


def test_the_interval_of_clopper_and_pearson() -> None:
    assert binomial_interval(12, 12) == (pytest.approx(0.7353515, abs=1e-6), 1.0)
    assert binomial_interval(0, 10) == (0.0, pytest.approx(0.3084971, abs=1e-6))
    low, high = binomial_interval(3, 10)
    assert (low, high) == (pytest.approx(0.0667395, abs=1e-6), pytest.approx(0.6524529, abs=1e-6))
