"""All figures of a benchmark as files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from matplotlib.figure import Figure

from branchdrive.benchmark.ranking.ending_table import has_endings
from branchdrive_reference.benchmark.figure.attrition import draw_attrition
from branchdrive_reference.benchmark.figure.canvas import render
from branchdrive_reference.benchmark.figure.construction import draw_construction
from branchdrive_reference.benchmark.figure.ending import draw_endings
from branchdrive_reference.benchmark.figure.leakage import draw_leakage
from branchdrive_reference.benchmark.figure.policy import draw_policy
from branchdrive_reference.benchmark.figure.prediction import draw_prediction
from branchdrive_reference.benchmark.figure.selected import draw_selected
from branchdrive_reference.benchmark.guard.figure import draw_trade_off
from branchdrive_reference.plotting import quiet

__all__ = ["figures"]


def figures(
    results: Mapping[str, Any],
    *,
    alpha: float,
    population: Mapping[str, Any] | None = None,
    leakage: Mapping[str, Any] | None = None,
) -> dict[str, bytes]:
    """Files by name, such as ``prediction.png``; a figure without anything to show is left out.

    Args:
        results: Document ``benchmark/results.json``.
        alpha: Largest rate of violations of the guard.
        population: Document ``quality/population.json``.
        leakage: Document ``quality/leakage.json``, where the release has one.
    """
    draws: dict[str, Callable[[], Figure | None]] = {}
    if population is not None:
        draws["construction"] = draw_construction
        draws["attrition"] = partial(draw_attrition, population)
    if leakage is not None and leakage.get("battery") and leakage.get("gate"):
        draws["leakage"] = partial(draw_leakage, leakage)
    if results["prediction"]["estimates"]:
        draws["prediction"] = partial(draw_prediction, results)
    if results["ranking"]["profiles"]:
        draws["policy_value"] = partial(draw_policy, results)
    if "contact_m" in results["ranking"] and results["ranking"]["profiles"]:
        draws["selected_outcomes"] = partial(draw_selected, results)
        if all(map(has_endings, results["ranking"]["profiles"])):
            draws["selected_endings"] = partial(draw_endings, results)
    if results["guard"]["profiles"]:
        draws["guard"] = partial(draw_trade_off, results, alpha)
    with quiet():
        return {
            f"{name}.{kind}": content
            for name, draw in draws.items()
            for kind, content in render(draw).items()  # type: ignore[arg-type]
        }
