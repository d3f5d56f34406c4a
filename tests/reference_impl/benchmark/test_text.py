"""Results on a terminal: they fit a page, and tell clusters from groups."""

from __future__ import annotations

import io

import pytest
from tests.validator.derive.benchmark.samples import data, noise, prediction_set, risk_fit, small_protocol

from branchdrive.derive.benchmark.results import results_document
from branchdrive.derive.metric.sign_flip import p_text
from branchdrive_reference.benchmark.text import render_results


@pytest.fixture(scope="module")
def results() -> dict[str, object]:
    return results_document(small_protocol(), data(), prediction_set(), risk_fit(), noise(), warnings=["Look out."])


@pytest.fixture(scope="module")
def text(results: dict[str, object]) -> str:
    return render_results(results, io.StringIO())


def test_lines_fit_a_page_and_no_cell_is_cut(text: str) -> None:
    assert max(map(len, text.split("\n"))) <= 120
    assert "…" not in text
    assert "O-M3-action_prior.regret.balanced" in text


def test_a_comparison_is_shown_by_clusters_and_by_groups(results: dict, text: str) -> None:  # type: ignore[type-arg]
    section = text.split("Comparisons of selectors")[1].split("\n\n")[0]
    assert "Claims are judged by route clusters" in section
    found = results["ranking"]["comparisons"][0]
    lines = section.split("\n")
    place = next(i for i, line in enumerate(lines) if line.startswith(f"{found['name']} "))
    clusters, groups = lines[place], lines[place + 1]
    for line, unit, low, p, is_bound in (
        (clusters, "clusters", "cluster_low", "p_clusters", "is_bound_clusters"),
        (groups, "groups", "low", "p", "is_bound"),
    ):
        numbers = f"[{found['interval'][low]:.3f}", p_text(found[p], found[is_bound])
        for cell in (unit, str(found[f"num_{unit}"]), *numbers):
            assert f" {cell}" in line


def test_every_table_carries_the_warnings(text: str) -> None:
    assert text.count("Warning: Look out.") == 11  # two of prediction, five of ranking, four of the guard
