"""Tables of what becomes of the selected candidates: their outcomes, contacts, and losses against nominal.

Source: spec/14-benchmark.md#ranking.
"""

from __future__ import annotations

from typing import Any

from branchdrive.benchmark.cell import BY_CLUSTERS, Document, ends_of, number
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.contract.text import NONE, percent
from branchdrive.driving.target import TARGETS
from branchdrive.text.table import Column, Table

__all__ = ["contact_sentence", "is_privileged", "percents", "selected_tables"]

_ORDER = [SEPARATION, *(t for t in range(len(TARGETS)) if t != SEPARATION)]
"""Separation first: it is among the headlines."""

_KNOWING = ("oracle", "_prior")
"""How the names of selectors end that choose by executed utility: of the group itself, or of training."""


def selected_tables(profile: Document, results: Document) -> list[Table]:
    """Tables of one ranked profile; none where the protocol does not declare outcomes."""
    entries = [entry for entry in profile["entries"] if "outcomes" in entry]
    parts = [("", [entry for entry in entries if not is_privileged(entry)])]
    parts += [(", privileged", [entry for entry in entries if is_privileged(entry)])]
    return [
        table
        for suffix, found in parts
        if found
        for table in (_means(profile, found, results, suffix), *_losses(profile, found, results, suffix))
    ]


def is_privileged(entry: Document) -> bool:
    """Whether a selector sees what no sensor tells; tables have it apart."""
    return str(entry.get("sees")).startswith("privileged")


def _means(profile: Document, entries: list[Any], results: Document, suffix: str) -> Table:
    rows = []
    for entry in entries:
        found = entry["outcomes"]
        targets = [found["targets"][t] for t in _ORDER]
        means = [_mean(target) for target in targets]
        rows.append(
            [
                entry["selector"],
                percents(found["contact"]),
                percents(found["avoidable_contact"]),
                means[0],
                percents(targets[0]["worse"]),
                *means[1:],
                percent(found["targets"][0]["available"], 1),
            ]
        )
    first, *others = (TARGETS[t] for t in _ORDER)
    columns = [
        Column.name("Selector"),
        Column("Contact"),
        Column("Avoidable"),
        Column(f"{first.symbol}, {first.unit}"),
        Column(f"{first.symbol} worse"),
        *(Column(f"{t.symbol}, {t.unit}") for t in others),
        Column(f"{TARGETS[0].symbol} available"),
    ]
    contact_m = results["ranking"]["contact_m"]
    notes = [
        f"Means over the selections in N = {profile['num_ranked']} groups; intervals are of 95 % by route clusters. "
        f"Contact: a separation of {'0' if contact_m == 0 else f'at most {contact_m:g}'} m in a saved frame of the "
        f"window. Avoidable: another candidate of the group makes none. Worse: than nominal, by more than "
        f"{_tolerance(results)}."
    ]
    if not suffix and (sentence := contact_sentence(profile)) is not None:
        notes.append(sentence)
    title = f"Selected outcomes, profile {profile['profile']}{suffix}"
    return Table(title, columns, rows, notes, has_intervals=True)


def _tolerance(results: Document) -> str:
    noise = results["noise"]
    tolerance = None if noise is None else noise["tolerance"][SEPARATION]
    return f"the noise of repetition, {'which is unknown' if tolerance is None else f'{tolerance:.4g} m'}"


def _losses(profile: Document, entries: list[Any], results: Document, suffix: str) -> list[Table]:
    """Shares of selections that are worse than nominal in each target; none where the noise is unknown."""
    if results["noise"] is None:
        return []
    rows = [[e["selector"], *(percents(t["worse"]) for t in e["outcomes"]["targets"])] for e in entries]
    columns = [Column.name("Selector"), *(Column(target.symbol) for target in TARGETS)]
    title = f"Selections worse than nominal beyond noise, profile {profile['profile']}{suffix}"
    return [Table(title, columns, rows, has_intervals=True)]


def contact_sentence(profile: Document) -> str | None:
    """Which of oracle and priors take a contact that they could avoid; ``None`` where none does.

    Args:
        profile: A ranked profile of ``results.json`` whose entries have outcomes.
    """
    taken = [
        (entry["selector"], entry["outcomes"]["avoidable_contact"]["value"])
        for entry in profile["entries"]
        if entry["selector"].endswith(_KNOWING) and entry["outcomes"]["avoidable_contact"]["value"]
    ]
    if not taken:
        return None
    which = "; ".join(
        f"the oracle in {percent(share, 1)} of groups, where this utility prefers it"
        if selector == "oracle"
        else f"`{selector}` in {percent(share, 1)} of groups"
        for selector, share in sorted(taken, key=lambda found: found[0] != "oracle")
    )
    return f"A contact is selected although a candidate without one exists: {which}."


def percents(rate: Document | None) -> str:
    """A rate with its interval."""
    if rate is None or rate["value"] is None:
        return NONE
    value, *ends = (None if rate[name] is None else percent(rate[name], 1) for name in ("value", "low", "high"))
    return f"{value}" if None in ends else f"{value} [{ends[0]}, {ends[1]}]"


def _mean(target: Document) -> str:
    """A mean with its interval by clusters."""
    return f"{number(target['mean'])} {ends_of(target['interval'], *BY_CLUSTERS)}".removesuffix(f" {NONE}")
