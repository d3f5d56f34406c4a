"""Both guards at every tolerance in one table: what they do on test, and over further divisions of the clusters.

Source: spec/14-benchmark.md#redraws.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from branchdrive.benchmark.cell import Document, number, with_ends
from branchdrive.benchmark.guard.calibration import DEVELOPMENT
from branchdrive.contract.text import NONE
from branchdrive.text.table import Column, Passage, Table

__all__ = ["GUARDS", "guard_documents", "redraw_sections"]

GUARDS = {"global_margin": "global margin", "conformal": "conformal", "learn_then_test": "learn then test"}
"""How the table calls guards."""

_COLUMNS = [
    Column.name("Model"),
    Column.name("Tolerance, m"),
    Column.name("Profile"),
    Column.name("Guard"),
    Column("Violation on test, clusters"),
    Column("Mean violation, redraws"),
    Column("95 % of redraws"),
    Column("Redraws above the rate"),
    Column("Retained gain on test"),
    Column("Retained gain, redraws"),
    Column("Nominal alone"),
]

READING = (
    "A redraw is a uniform permutation of the calibrating clusters and those of test: a guard is calibrated on as many "
    "clusters as before and judged on the others. The rate that the conformal guard promises is about the mean over "
    "all of them; what stands behind ± is the error of counting so many redraws, and 95 % of single redraws lie in the "
    "interval beside it. Nothing was chosen by these figures."
)
"""How the table is read."""


def guard_documents(results: Document) -> list[Any]:
    """Sections of guards, the first one first."""
    return [results["guard"], *results.get("further_guards", ())]


def redraw_sections(results: Document) -> list[Table | Passage]:
    """The table, and why guards are not in it; nothing where neither redraws nor further guards are declared."""
    documents = guard_documents(results)
    rows = [row for guard in documents for row in _rows(guard)]
    if len(documents) == 1 and not any("redraws" in profile for profile in results["guard"]["profiles"]):
        return []
    found: list[Table | Passage] = []
    if rows:
        found.append(Table("Guards at every tolerance", _COLUMNS, rows, _notes(documents), has_intervals=True))
    missing = [
        f"{guard['model']} at {guard['tolerance_m']:g} m was not judged: {guard['reason']}"
        for guard in documents[1:]
        if not guard["profiles"]
    ]
    return [*found, Passage("Guards without figures", missing)] if missing else found


def _rows(guard: Document) -> Iterator[list[str]]:
    for profile in guard["profiles"]:
        figures = {selection["selection"]: selection["figures"] for selection in profile["selections"]}
        for name, title in GUARDS.items():
            violation, retained = (figures[name][key] for key in ("violation_of_clusters", "retained_gain"))
            redrawn = profile.get("redraws", {}).get(name)
            yield [
                guard["model"],
                f"{guard['tolerance_m']:g}",
                profile["profile"],
                title,
                with_ends(number(violation["value"]), violation),
                *_redrawn(redrawn),
                with_ends(number(retained["value"]), retained),
                NONE if redrawn is None else with_ends(number(redrawn["retained_gain"]), _retained(redrawn)),
                NONE if redrawn is None else f"{redrawn['num_nominal']:,}",
            ]


def _redrawn(found: Document | None) -> list[str]:
    if found is None:
        return [NONE] * 3
    return [
        f"{number(found['mean'])} ± {number(found['error'], 4)}",
        f"[{number(found['low'])}, {number(found['high'])}]",
        number(found["share_above"]),
    ]


def _retained(found: Document) -> dict[str, Any]:
    return {"low": found["retained_low"], "high": found["retained_high"]}


def _notes(documents: list[Any]) -> list[str]:
    profiles = [profile for guard in documents for profile in guard["profiles"]]
    notes = []
    if any("redraws" in profile for profile in profiles):
        redraws = next(profile["redraws"] for profile in profiles if "redraws" in profile)
        sizes = ", ".join(
            f"{title} on {redraws[name]['num_clusters']} and {redraws[name]['num_others']} clusters"
            for name, title in GUARDS.items()
            if redraws[name] is not None
        )
        limit = profiles[0]["conformal"]["limit"]
        notes.append(
            f"{redraws['num_redraws']:,} redraws; the rate is {limit:g}. {READING} Calibrated and judged: {sizes}."
        )
    return [*notes, DEVELOPMENT]
