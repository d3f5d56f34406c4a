"""Figures: the same bytes again, no date in them, and nothing drawn from nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from tests.reference_impl.benchmark.small_release import contents, invoke
from tests.sampling import THOROUGH
from tests.validator.benchmark.samples import data_with_endings, noise, prediction_set, small_protocol

from branchdrive.benchmark.results import results_document
from branchdrive_reference.benchmark.figure.canvas import render
from branchdrive_reference.benchmark.figure.construction import draw_construction
from branchdrive_reference.benchmark.figure.ending import draw_endings
from branchdrive_reference.benchmark.figure.gallery import figures
from branchdrive_reference.benchmark.guard.figure import draw_trade_off

NAMES = ("guard", "policy_value", "prediction", "selected_outcomes")

POPULATION = {
    "num_policies": 13,
    "partitions": ["train", "val"],
    "stages": [
        {"stage": "discovered", "title": "Discovered branch groups", "total": 10, "groups": None},
        {"stage": "frozen", "title": "Frozen population", "total": 8, "groups": {"train": 6, "val": 2}},
    ],
}


def _test(name: str, status: str) -> dict[str, Any]:
    return {"name": name, "status": status, "score": {"accuracy": 0.1, "accuracy_interval": [0.05, 0.2]}}


LEAKAGE = {
    "protocol": {"gate": {"alpha": 0.001}},
    "gate": {"verdict": "pass", "reason": "", "tests": [{"name": "max_t", "p_adjusted": 0.4}]},
    "battery": {
        "ways": [{"name": "13-way", "chance": 1 / 13, "tests": [_test("ego", "pass"), _test("controls", "fail")]}]
    },
}


EMPTY: dict[str, Any] = {"prediction": {"estimates": []}, "ranking": {"profiles": []}, "guard": {"profiles": []}}
"""Results of nothing."""


@pytest.fixture(scope="module")
def results(done: Path) -> Any:
    return json.loads((done / "benchmark" / "results.json").read_bytes())


@THOROUGH
def test_published_figures_are_those_of_the_results(benchmarked: Path, results: Any) -> None:
    before = contents(benchmarked)
    invoke("evaluate", benchmarked)
    found = figures(results, alpha=0.05)
    assert sorted(found) == [f"{name}.{kind}" for name in NAMES for kind in ("png", "svg")]
    after = contents(benchmarked)
    assert {path.split("/")[-1] for path in after.keys() - before.keys()} == found.keys()
    assert after["benchmark/results.json"] == before["benchmark/results.json"]
    for name, content in found.items():
        assert after[f"benchmark/figures/{name}"] == content
        assert content.startswith(b"\x89PNG" if name.endswith("png") else b"<?xml")
        assert b"dc:date" not in content


def test_violations_are_drawn_as_the_guarantee_counts_them(results: Any) -> None:
    """With equal weight for every cluster, so that the limit can be compared with them."""
    profile = results["guard"]["profiles"][0]
    noise = {"losses": {"num_groups": 8, "num_groups_losing": 1, "num_repeats": 16, "num_repeats_losing": 1}}
    figure = draw_trade_off({**results, "noise": noise}, 0.05)
    assert figure is not None
    axes = figure.axes[0]
    assert "clusters" in axes.get_xlabel()
    drawn = [np.asarray(line.get_xdata(), float).tolist() for line in axes.lines]
    assert [100 * share for share in profile["trade_off"]["violation_of_clusters"]] in drawn
    for selection in profile["selections"]:
        assert [100 * selection["figures"]["violation_of_clusters"]["value"]] in drawn
    assert [5, 5] in drawn
    assert [100 / 16] * 2 in drawn


def test_documents_of_the_release_have_figures() -> None:
    found = figures(EMPTY, alpha=0.05, population=POPULATION, leakage=LEAKAGE)
    names = ("attrition", "construction", "leakage")
    assert sorted(found) == [f"{name}.{kind}" for name in names for kind in ("png", "svg")]


def test_a_bit_identical_release_has_a_gate_without_tests() -> None:
    gate = {"verdict": "pass", "reason": "Replays are bit-identical.", "tests": []}
    found = figures(EMPTY, alpha=0.05, leakage={**LEAKAGE, "gate": gate})
    assert found["leakage.svg"] != figures(EMPTY, alpha=0.05, leakage=LEAKAGE)["leakage.svg"]


def test_nothing_is_drawn_from_nothing() -> None:
    assert figures(EMPTY, alpha=0.05) == {}


def test_a_figure_is_laid_out_once_and_drawn_once_for_every_format(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    whole = Figure.draw

    def draw(self: Figure, renderer: RendererBase) -> None:
        drawn.append(type(renderer).__name__)
        whole(self, renderer)

    monkeypatch.setattr(Figure, "draw", draw)
    files = render(draw_construction)
    assert files.keys() == {"png", "svg"}
    assert drawn == ["RendererAgg", "MixedModeRenderer"]


def test_ends_of_drives_are_drawn_where_results_tell_them() -> None:
    results = results_document(small_protocol(), data_with_endings(), prediction_set(), noise=noise())
    profiles = results["ranking"]["profiles"] = results["ranking"]["profiles"][:2]
    figure = draw_endings(results)
    assert len(figure.axes) == 3 * len(profiles)
    clean = figure.axes[len(profiles)]
    assert clean.get_xlabel() == "clean drives, %"
    drawn = [np.asarray(line.get_xdata(), float).tolist() for line in clean.lines]
    for entry in profiles[0]["entries"]:
        assert [100 * entry["outcomes"]["endings"]["clean"]["value"]] in drawn
    assert [label.get_text() for label in clean.get_yticklabels()][-1] == "Oracle of clean drives"
    told = {"prediction": {"estimates": []}, "guard": {"profiles": []}, "warnings": [], "ranking": results["ranking"]}
    assert "selected_endings.svg" in figures(told, alpha=0.05)
    for profile in told["ranking"]["profiles"]:
        profile.pop("num_with_clean")
    assert "selected_endings.svg" not in figures(told, alpha=0.05)
