"""Sections of a card on what selections do: contacts of every selector under every profile, and how drives end.

They are there once a benchmark is published whose results tell it, with the warnings of the results.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from branchdrive.benchmark.ranking.ending_table import LIMITS, MEANING, ending_sentence, has_endings
from branchdrive.benchmark.ranking.selected_table import contact_sentence, is_privileged, percents
from branchdrive.contract.layout import TABLES_FILE
from branchdrive.contract.text import NONE, counted
from branchdrive.text.markdown import plain, section_lines
from branchdrive.text.table import Column, Table

__all__ = ["ending_section", "selected_section"]

Document = Mapping[str, Any]


def selected_section(results: Document | None) -> list[str]:
    """Lines of the section; none where there are no results, or none with outcomes of ranked profiles.

    Args:
        results: Document ``benchmark/results.json``, which conforms to its schema.
    """
    ranking = {} if results is None else results["ranking"]
    profiles = ranking.get("profiles", [])
    if results is None or "contact_m" not in ranking or not profiles:
        return []
    notes = [
        f"Share of selections whose recorded separation is at most {ranking['contact_m']:g} m, in "
        f"{counted(profiles[0]['num_ranked'], 'group')} of the test partition, with 95 % intervals by route clusters. "
        f"Outcomes of every target, and how many are worse than nominal beyond noise, are in `{TABLES_FILE}`.",
        *_sentences(profiles, contact_sentence),
    ]
    table = _by_profile("Contacts of selections", profiles, lambda outcomes: percents(outcomes["contact"]), notes)
    return section_lines(table, results["warnings"])


def ending_section(results: Document | None) -> list[str]:
    """Lines of the section on how drives end; none where there are no results, or none that tell it.

    Args:
        results: Document ``benchmark/results.json``, which conforms to its schema.
    """
    profiles = [] if results is None else [p for p in results["ranking"]["profiles"] if has_endings(p)]
    if results is None or not profiles:
        return []
    notes = [
        MEANING,
        LIMITS,
        "Share of selections whose drive has no collision, no departure from the road and no red light or stop sign "
        f"that was run, in {counted(profiles[0]['num_ranked'], 'group')} of the test partition, with 95 % intervals by "
        f"route clusters. Each of these, and completed routes, are in `{TABLES_FILE}`.",
        *_sentences(profiles, ending_sentence),
    ]
    title = "Selections whose drive is clean to its end"
    table = _by_profile(title, profiles, lambda outcomes: percents(outcomes["endings"]["clean"]), notes)
    return section_lines(table, results["warnings"])


def _by_profile(title: str, profiles: Sequence[Any], cell: Callable[[Any], str], notes: Sequence[str]) -> Table:
    """A row for each selector that sees what a vehicle does, a column for each profile, of outcomes."""
    found = {
        (profile["profile"], entry["selector"]): entry["outcomes"]
        for profile in profiles
        for entry in profile["entries"]
        if "outcomes" in entry and not is_privileged(entry)
    }
    names, selectors = ([*dict.fromkeys(key[part] for key in found)] for part in (0, 1))
    rows = [
        [selector, *(cell(found[name, selector]) if (name, selector) in found else NONE for name in names)]
        for selector in selectors
    ]
    return Table(title, [Column.name("Selector"), *map(Column, names)], rows, notes)


def _sentences(profiles: Sequence[Any], sentence_of: Callable[[Any], str | None]) -> list[str]:
    said = [(profile["profile"], sentence_of(profile)) for profile in profiles]
    return [f"Under `{name}`: {plain(sentence)}" for name, sentence in said if sentence is not None]
