"""Results on a terminal: they fit a screen, say what is too few, and promise nothing themselves."""

from __future__ import annotations

import copy
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from tests.validator.benchmark.samples import data, noise, prediction_set, risk_fit, small_protocol

from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive.statistics.sign_flip import p_text
from branchdrive_reference.benchmark.command.evaluate import render_results


@pytest.fixture
def results(done: Path) -> Any:
    return json.loads((done / "benchmark" / "results.json").read_bytes())


def text(results: Any, tables: str | None = None) -> str:
    """The text with its lines joined."""
    return " ".join(render_results(results, io.StringIO(), tables=tables).split())


def test_a_refused_guard_promises_nothing(results: Any) -> None:
    """The calibration partition of the small release has four groups."""
    found = text(results)
    assert "Not judged under balanced, safety, progress, comfort, near_range, where it promises nothing: " in found
    assert "retained gain" not in found


def test_a_judged_guard_says_what_it_did_and_where_its_promise_stands(invented: Any) -> None:
    judged = copy.deepcopy(invented)
    first, second, *others = judged["guard"]["profiles"]
    for profile in (first, *others):
        profile["conformal"]["refusal"] = "too few"
    second["conformal"]["refusal"] = None
    (figures,) = (one["figures"] for one in second["selections"] if one["selection"] == "conformal")
    figures["violation_of_clusters"]["value"], figures["retained_gain"]["value"] = 0.037, 0.64
    found = text(judged)
    assert "Guard, M3 at 0.25 m Violations by clusters and retained gain" in found
    assert ": safety 0.037 and 0.640. What it promises, and what not, stands with the tables." in found
    assert "Not judged under balanced, progress, comfort, near_range, where it promises nothing: too few." in found


def test_too_few_clusters_are_said_first(results: Any) -> None:
    for num_clusters, units in ((1, "1 route cluster"), (LEAST_UNITS - 1, "5 route clusters")):
        results["population"]["clusters"]["test"] = num_clusters
        sentence = f"Nothing can be concluded: `test` has 4 groups in {units}"
        assert text(results).startswith(sentence)
        assert render_tables(results).split("\n")[2].startswith(sentence)
        assert_said_under_every_table_of_intervals(render_tables(results), is_said=True)
    results["population"]["clusters"]["test"] = LEAST_UNITS
    assert_said_under_every_table_of_intervals(render_tables(results), is_said=False)
    assert text(results).startswith("Prediction ")


def assert_said_under_every_table_of_intervals(tables: str, *, is_said: bool) -> None:
    said = "> **Warning.** Nothing can be concluded: too few route clusters."
    sections = {section.split("\n")[0]: section for section in tables.split("\n## ")[1:]}
    for title, section in sections.items():
        tells = any(head in section for head in ("95 %", "| p |", "Coverage", "| Contact |"))
        assert (said in section) == (is_said and tells), title
    assert "Comparisons of models" in sections


def test_tables_without_a_comparison_say_what_they_take(results: Any) -> None:
    for section in ("prediction", "ranking"):
        results[section]["comparisons"] = []
    found = render_tables(results)
    for title in ("Comparisons of models", "Comparisons of selectors"):
        section = found.split(f"## {title}")[1].split("\n## ")[0]
        assert "`branchdrive benchmark` on this release first" in section
        assert "|" not in section


def test_the_tables_are_named_where_they_are_in_a_file(results: Any) -> None:
    assert text(results, "out/TABLES.md").endswith("--format markdown prints all tables, which are in out/TABLES.md.")
    assert text(results).endswith("--format markdown prints all tables.")


def test_selectors_that_a_vehicle_could_use_are_shown_with_regret_and_contacts(results: Any) -> None:
    first = results["ranking"]["profiles"][0]
    entries = {entry["selector"]: entry for entry in first["entries"]}
    entries["O-M1"]["sees"], entries["O-M2"]["is_tie"] = "privileged history", True
    entries["O-M3"]["outcomes"]["contact"]["value"] = 0.25
    results["ranking"]["profiles"] = [first]
    regrets, contacts = re.findall(r"^Selector .*\n-+\n((?:.+\n)+)", render_results(results, io.StringIO()), re.M)
    lines = {line.split()[0]: line.split()[1:] for line in regrets.split("\n") if line}
    assert {"nominal", "action_prior", "O-M3"} <= lines.keys()
    assert not {"O-M1", "O-M2", "oracle", "random"} & lines.keys()
    assert lines["O-M3"][0] == f"{entries['O-M3']['regret']:.3f}"
    assert ["O-M3", "25.0%"] in [line.split() for line in contacts.split("\n")]


@pytest.fixture(scope="module")
def invented() -> dict[str, object]:
    return results_document(small_protocol(), data(), prediction_set(), risk_fit(), noise(), warnings=["Look out."])


@pytest.fixture(scope="module")
def page(invented: dict[str, object]) -> str:
    return render_results(invented, io.StringIO())


def test_it_fits_a_screen_and_no_cell_is_cut(page: str) -> None:
    lines = page.split("\n")
    assert max(map(len, lines)) <= 120
    assert len(lines) < 50
    assert "…" not in page


@pytest.mark.parametrize("columns", [40, 60, 80, 100])
def test_narrow_terminals_cut_no_number(
    invented: dict[str, object], page: str, columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", "1")
    found = re.sub(r"\x1b\[[0-9;]*m", "", render_results(invented, Terminal()))
    assert max(map(len, found.split("\n"))) <= columns
    numbers = re.compile(r"[-+]?[0-9]+\.[0-9]+")
    assert sorted(numbers.findall(found)) == sorted(numbers.findall(page))


def test_a_comparison_is_shown_by_clusters_and_by_groups(invented: dict) -> None:  # type: ignore[type-arg]
    section = render_tables(invented).split("## Comparisons of selectors")[1].split("\n## ")[0]
    assert "Claims are judged by route clusters" in section
    found = invented["ranking"]["comparisons"][0]
    clusters, groups = (line for line in section.split("\n") if line.startswith(f"| `{found['name']}` |"))
    for line, unit, low, p, is_bound in (
        (clusters, "clusters", "cluster_low", "p_clusters", "is_bound_clusters"),
        (groups, "groups", "low", "p", "is_bound"),
    ):
        numbers = f"[{found['interval'][low]:.3f}", p_text(found[p], found[is_bound])
        for cell in (f"{found[f'num_{unit}']} {unit}", *numbers):
            assert f"| {cell}" in line


def test_a_warning_is_said_once_and_first(page: str) -> None:
    assert page.startswith("Warning: Look out.")
    assert page.count("Look out.") == 1
