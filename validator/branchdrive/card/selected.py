"""The section of a card on what selections do: contacts of every selector under every profile.

It is there once a benchmark is published whose results have outcomes of selections, with the warnings of the results.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.ranking.selected_table import contact_sentence, is_privileged, percents
from branchdrive.contract.layout import TABLES_FILE
from branchdrive.contract.text import NONE, counted
from branchdrive.text.markdown import plain, section_lines
from branchdrive.text.table import Column, Table

__all__ = ["selected_section"]

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
    found = {
        (profile["profile"], entry["selector"]): entry["outcomes"]
        for profile in profiles
        for entry in profile["entries"]
        if "outcomes" in entry and not is_privileged(entry)
    }
    names, selectors = ([*dict.fromkeys(key[part] for key in found)] for part in (0, 1))
    rows = [
        [
            selector,
            *(percents(found[name, selector]["contact"]) if (name, selector) in found else NONE for name in names),
        ]
        for selector in selectors
    ]
    sentences = [
        f"Under `{profile['profile']}`: {plain(sentence)}"
        for profile in profiles
        if (sentence := contact_sentence(profile)) is not None
    ]
    notes = [
        f"Share of selections whose recorded separation is at most {ranking['contact_m']:g} m, in "
        f"{counted(profiles[0]['num_ranked'], 'group')} of the test partition, with 95 % intervals by route clusters. "
        f"Outcomes of every target, and how many are worse than nominal beyond noise, are in `{TABLES_FILE}`.",
        *sentences,
    ]
    columns = [Column.name("Selector"), *map(Column, names)]
    return section_lines(Table("Contacts of selections", columns, rows, notes), results["warnings"])
