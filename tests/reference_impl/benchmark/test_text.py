"""Results on a terminal: they fit a page, tell clusters from groups, and promise only what is claimed."""

from __future__ import annotations

import copy
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from tests.validator.benchmark.samples import data, noise, prediction_set, risk_fit, small_protocol

from branchdrive.benchmark.guard.calibration import GLOBAL_MARGIN, GUARANTEE, LEARN_THEN_TEST
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.table.redraw import guard_documents
from branchdrive.benchmark.warning import CALIBRATION_READ
from branchdrive.statistics.sign_flip import p_text
from branchdrive_reference.benchmark.text import render_results


@pytest.fixture
def results(done: Path) -> Any:
    return json.loads((done / "benchmark" / "results.json").read_bytes())


def text(results: Any) -> str:
    """The text with its lines joined."""
    return " ".join(render_results(results, io.StringIO()).split())


def test_a_refused_guard_promises_nothing(results: Any) -> None:
    """The calibration partition of the small release has four groups."""
    found = text(results)
    assert "was not judged under balanced, safety, progress, comfort, near_range: it promises nothing there." in found
    assert "Assume that" not in found
    assert GLOBAL_MARGIN in found


def test_a_judged_guard_promises_word_for_word_and_says_what_takes_from_it(results: Any) -> None:
    judged = copy.deepcopy(results)
    for profile in (profile for guard in guard_documents(judged) for profile in guard["profiles"]):
        for method in ("conformal", "learn_then_test"):
            profile[method]["refusal"] = None
    judged["guard"]["guarantee"] |= {"conformal": GUARANTEE, "learn_then_test": LEARN_THEN_TEST}
    judged["warnings"] = [CALIBRATION_READ]
    found = text(judged)
    assert f"{CALIBRATION_READ} {GUARANTEE}" in found
    assert LEARN_THEN_TEST in found
    assert "it promises nothing" not in found


def test_the_trivial_selections_are_there_without_empty_intervals(results: Any) -> None:
    lines = render_results(results, io.StringIO()).split("\n")
    guard = [line for line in lines[next(i for i, x in enumerate(lines) if "Guard, profile" in x) :] if line]
    names = [line.split()[0] for line in guard]
    assert names[3:6] == ["nominal", "action_prior", "unguarded"]
    nominal = next(line for line in guard if line.startswith("nominal"))
    assert set(nominal.split()) == {"nominal", "0.000"}


def test_repeated_nominals_are_told(results: Any) -> None:
    losses = {"num_groups": 8, "num_groups_losing": 1, "num_repeats": 16, "num_repeats_losing": 1}
    six = [0.5] * 6
    results["noise"] = {
        "tolerance": six, "rms": six, "num_groups": [8] * 6, "num_one_sided": [0] * 6, "losses": losses
    }  # fmt: skip
    assert "1 of 8 training groups (12.5 %), 1 of 16 repeats (6.2 %)" in text(results)


@pytest.fixture(scope="module")
def invented() -> dict[str, object]:
    return results_document(small_protocol(), data(), prediction_set(), risk_fit(), noise(), warnings=["Look out."])


@pytest.fixture(scope="module")
def page(invented: dict[str, object]) -> str:
    return render_results(invented, io.StringIO())


def test_lines_fit_a_page_and_no_cell_is_cut(page: str) -> None:
    assert max(map(len, page.split("\n"))) <= 120
    assert "…" not in page
    assert "O-M3-action_prior.regret.balanced" in page


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


def test_a_comparison_of_selectors_is_one_block_on_a_page(page: str) -> None:
    """Names of selectors are long, and three families adjust its p-value."""
    for title in ("Comparisons of models", "Comparisons of selectors"):
        section = page.split(title)[1].split("Claims are judged")[0]
        assert sum(line.startswith("Comparison ") for line in section.split("\n")) == 1


def test_a_comparison_is_shown_by_clusters_and_by_groups(invented: dict, page: str) -> None:  # type: ignore[type-arg]
    section = page.split("Comparisons of selectors")[1].split("Guard, profile")[0]
    assert "Claims are judged by route clusters" in section
    found = invented["ranking"]["comparisons"][0]
    lines = section.split("\n")
    place = next(i for i, line in enumerate(lines) if line.startswith(f"{found['name']} "))
    clusters, groups = lines[place : place + 2]
    for line, unit, low, p, is_bound in (
        (clusters, "clusters", "cluster_low", "p_clusters", "is_bound_clusters"),
        (groups, "groups", "low", "p", "is_bound"),
    ):
        numbers = f"[{found['interval'][low]:.3f}", p_text(found[p], found[is_bound])
        for cell in (unit, str(found[f"num_{unit}"]), *numbers):
            assert f" {cell}" in line


def test_every_table_carries_the_warnings(page: str) -> None:
    assert page.count("Warning: Look out.") == 19  # two of prediction, eleven of ranking, five of the guard, one more
