"""A screen of results: errors of models, what selections lose, what the guard did, and whether there is too little.

Everything here stands in the tables too, with intervals, tests and what guards promise.

Source: spec/14-benchmark.md#tables.
"""

from __future__ import annotations

from branchdrive.benchmark.cell import Document, number, spread_over_seeds
from branchdrive.benchmark.prediction.table import headline_tables
from branchdrive.benchmark.protocol.selection import ENSEMBLE, LEARNED
from branchdrive.benchmark.ranking.ending_table import LIMITS, MEANING, ending_sentence, has_endings
from branchdrive.benchmark.ranking.selected_table import is_privileged
from branchdrive.contract.text import NONE, percent
from branchdrive.text.table import Column, Passage, Table

__all__ = ["headline_sections"]

_REFERENCES = ("nominal", "action_prior", "type_prior")
"""Selectors that every learned one is read beside."""


def headline_sections(results: Document) -> list[Table | Passage]:
    """Prediction, regret and contacts by profile, guard and noise.

    Args:
        results: Document ``results.json``, which conforms to its schema.
    """
    return [*headline_tables(results), *_selection_sections(results), *_guard_and_noise(results)]


def _selection_sections(results: Document) -> list[Table | Passage]:
    """Mean regret and contacts of learned selectors and of the references, a column for each ranked profile."""
    ranking = results["ranking"]
    reasons = [f"Profile {out['profile']} is not judged: {out['reason']}." for out in ranking["left_out"]]
    profiles = ranking["profiles"]
    if not profiles:
        return [Passage("Selections", reasons)] if reasons else []
    by_profile = [{entry["selector"]: entry for entry in profile["entries"]} for profile in profiles]
    sizes = ", ".join(dict.fromkeys(str(profile["num_ranked"]) for profile in profiles))
    note = (
        f"What a selection is worth less than the best candidate, mean over N = {sizes} groups; less is better. "
        "O-MODEL chooses by each seed of a model, E-MODEL by the mean prediction of its seeds."
    )
    names = list(dict.fromkeys(n for entries in by_profile for n, entry in entries.items() if _is_headline(n, entry)))
    columns = [Column.name("Selector"), *(Column(profile["profile"]) for profile in profiles)]
    rows = [[name, *(_regret(entries.get(name)) for entries in by_profile)] for name in names]
    tables = [Table("Mean regret by profile", columns, rows, [note, *reasons])]
    if all("outcomes" in entry for entries in by_profile for entry in entries.values()):
        rows = [[name, *(_contact(entries.get(name)) for entries in by_profile)] for name in names]
        tables.append(Table("Selections that make a contact, by profile", columns, rows))
    if all(map(has_endings, profiles)):
        rows = [[name, *(_clean(entries.get(name)) for entries in by_profile)] for name in names]
        worse = [(profile["profile"], ending_sentence(profile)) for profile in profiles]
        notes = [MEANING, LIMITS, *(f"{profile}: {sentence}" for profile, sentence in worse if sentence)]
        tables.append(Table("Selections whose drive is clean to its end, by profile", columns, rows, notes))
    return [*tables]


def _is_headline(name: str, entry: Document) -> bool:
    """Whether a selector is a reference, or is learned, sees what a vehicle does, and chooses by more than a tie."""
    if name in _REFERENCES:
        return True
    return name.startswith((LEARNED, ENSEMBLE)) and not entry.get("is_tie") and not is_privileged(entry)


def _regret(entry: Document | None) -> str:
    return NONE if entry is None else spread_over_seeds(entry["regret"], entry["seed_sd"]["regret"])


def _contact(entry: Document | None) -> str:
    """The share of selections with a contact, which utility hides."""
    rate = None if entry is None else entry["outcomes"]["contact"]
    return NONE if rate is None or rate["value"] is None else percent(rate["value"], 1)


def _clean(entry: Document | None) -> str:
    """The share of selections whose drive has no collision, departure from the road or infraction."""
    rate = None if entry is None else entry["outcomes"]["endings"]["clean"]
    return NONE if rate is None or rate["value"] is None else percent(rate["value"], 1)


def _guard_and_noise(results: Document) -> list[Passage]:
    guard = results["guard"]
    title = f"Guard, {guard['model']} at {guard['tolerance_m']:g} m"
    # A guard of a model that predicted nothing here belongs to none: predictions of others have none.
    found = [Passage(title, [_guard_line(guard)])] if guard["model"] in _models(results) or guard["profiles"] else []
    if results["noise"] is None:
        found.append(
            Passage(
                "Noise of outcomes",
                ["Unknown; no ranking lock holds one: that takes a locked benchmark and nominal replays."],
            )
        )
    return found


def _models(results: Document) -> set[str]:
    """Models whose predictions were evaluated."""
    return {model["id"] for model in results["models"]}


def _guard_line(guard: Document) -> str:
    """What the conformal guard did under each profile, or why it was not judged."""
    if not guard["profiles"]:
        return f"Not judged: {guard['reason']}"
    judged, refused = [], []
    for profile in guard["profiles"]:
        refusal = profile["conformal"]["refusal"]
        if refusal is not None:
            refused.append((profile["profile"], refusal))
            continue
        (figures,) = (one["figures"] for one in profile["selections"] if one["selection"] == "conformal")
        rate, gain = (number(figures[name]["value"]) for name in ("violation_of_clusters", "retained_gain"))
        judged.append(f"{profile['profile']} {rate} and {gain}")
    said = []
    if judged:
        said.append(
            f"Violations by clusters and retained gain of the conformal guard on test: {', '.join(judged)}. What it "
            "promises, and what not, stands with the tables."
        )
    for reason in dict.fromkeys(reason for _, reason in refused):
        names = ", ".join(name for name, why in refused if why == reason)
        said.append(f"Not judged under {names}, where it promises nothing: {reason}.")
    return " ".join(said)
