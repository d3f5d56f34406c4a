"""Tables of guards and of the noise of outcomes, with what the guards promise and what takes from it beside it.

Source: spec/14-benchmark.md#guard.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.cell import Document, number, with_ends
from branchdrive.benchmark.guard.calibration import CONDITIONAL, DEVELOPMENT
from branchdrive.benchmark.guard.redraw_table import guard_documents, redraw_sections
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.benchmark.warning import CALIBRATION_READ
from branchdrive.driving.target import TARGETS
from branchdrive.text.table import Column, Passage, Table

__all__ = ["UNGUARDED", "guard_sections", "noise_floor", "noise_tables", "promises"]

_METHODS = {"conformal": "The selection-path guard", "learn_then_test": "Learn then test"}

UNGUARDED = (
    "`unguarded` takes the best utility of the predictions' mean over seeds; the selectors of the ranking choose by "
    "each seed, and their value is a mean over seeds, so that the two differ. `action_prior` takes the same candidate "
    "in every group, without a guard."
)
"""What two rows of a guard's table are."""

_FIGURES = {
    "coverage": Column("Coverage"),
    "violation": Column("Violation"),
    "violation_of_clusters": Column("Violation, clusters"),
    "violation_of_interventions": Column("Violation, interventions"),
    "intervention": Column("Intervention"),
    "gain": Column("Gain"),
    "retained_gain": Column("Retained gain"),
    "separation_difference_m": Column("Separation, m"),
}
"""Columns of a selection's figures."""


def guard_sections(results: Document) -> list[Table | Passage]:
    """A table for each profile and what the guards promise, or why the guard was not judged."""
    guard = results["guard"]
    if not guard["profiles"]:
        return [Passage("Guard", [f"Not judged: {guard['reason']}"])]
    tables = [_profile_table(profile, results) for profile in guard["profiles"]]
    return [*tables, *redraw_sections(results), Passage("What the guards promise", promises(results))]


def _profile_table(profile: Document, results: Document) -> Table:
    rows = []
    for selection in profile["selections"]:
        figures = [selection["figures"][name] for name in _FIGURES]
        cells = [with_ends(number(found["value"]), found) for found in figures]
        rows.append([selection["selection"], *cells, str(selection["num_actions"])])
    margin = profile["global_margin"]
    val, test = margin["val"], margin["test"]
    notes = [
        f"N = {profile['num_groups']} groups. Global margin {margin['margin_m']:.3f} m, order statistic "
        f"{margin['rank']} of {margin['num_groups']}; on test it covers {test['covered_candidates']:.3f} of candidates "
        f"and {test['covered_groups']:.3f} of groups, and accepts {test['acceptance']:.3f} of interventions.",
        f"On the {margin['num_groups']} validation groups that it was fitted on, a development-set diagnostic, "
        f"it covers {val['covered_candidates']:.3f} of candidates and {val['covered_groups']:.3f} of groups, "
        f"chooses {val['num_actions']} actions and is worth {val['value']:.4f}; nominal {val['nominal_value']:.4f}, "
        f"ActionPrior {val['action_prior_value']:.4f}.",
    ]
    if test["vacuous"]:
        notes.append("The global margin is vacuous: it accepts no intervention in any group.")
    for name, title in (("conformal", "Selection-path conformal"), ("learn_then_test", "Learn then test")):
        found = profile[name]
        multiplier = "nominal alone" if found["multiplier"] is None else f"multiplier {found['multiplier']:.4g}"
        refused = "" if found["refusal"] is None else f" Not judged: {found['refusal']}."
        size = f"{found['num_groups']} groups in {found['num_clusters']} clusters"
        notes.append(f"{title}: {multiplier}, calibrated on {size}.{refused}")
    notes.append(UNGUARDED)
    if "redraws" in profile:
        notes.append(DEVELOPMENT)
    if (floor := noise_floor(results)) is not None:
        notes.append(floor)
    columns = [Column.name("Selection"), *_FIGURES.values(), Column("Actions")]
    return Table(f"Guard, profile {profile['profile']}", columns, rows, notes, has_intervals=True)


def noise_tables(results: Document) -> list[Table]:
    """How far repetition moves outcomes, and selections beyond it; none where no nominal was repeated."""
    noise = results["noise"]
    if noise is None:
        return []
    rows = [
        [f"{t.symbol}, {t.unit}", number(noise["tolerance"][i], 4), number(noise["rms"][i], 4),
         str(noise["num_groups"][i])]
        for i, t in enumerate(TARGETS)
    ]  # fmt: skip
    floor = noise_floor(results)
    columns = [Column.name("Target"), *map(Column, ("Tolerance", "Root mean square", "N groups, training"))]
    tables = [Table("Noise of outcomes", columns, rows, [] if floor is None else [floor])]
    counted = [
        [profile["profile"], selection["selection"], *_beyond(selection["beyond_noise"]), _separation(selection)]
        for profile in results["guard"]["profiles"]
        for selection in profile["selections"]
        if selection["beyond_noise"] is not None
    ]
    if counted:
        note = (
            "Groups whose selected difference to nominal exceeds the tolerance, for the worse and for the better, of "
            "those that have one. The tolerance is that of one group; the mean difference of separation stands beside "
            "the standard error that repetition alone gives it."
        )
        columns = [
            Column.name("Profile"),
            Column.name("Selection"),
            *(Column(target.symbol) for target in TARGETS),
            Column("Mean D_min, m"),
        ]
        tables.append(Table("Selected differences beyond noise", columns, counted, [note]))
    return tables


def _beyond(found: Document) -> list[str]:
    counts = zip(found["num_worse"], found["num_better"], found["num_compared"], strict=True)
    return [f"{worse} + {better} / {compared}" for worse, better, compared in counts]


def _separation(found: Document) -> str:
    """Mean difference of separation with the standard error from repetition."""
    error = found["beyond_noise"]["standard_error"][SEPARATION]
    mean = number(found["figures"]["separation_difference_m"]["value"])
    return mean if error is None else f"{mean} (noise {error:.3f})"


def promises(results: Mapping[str, Any]) -> list[str]:
    """Paragraphs on what the guards promise; none where no guard was judged.

    Args:
        results: Document ``results.json``, which conforms to its schema.
    """
    documents, found = guard_documents(results), []
    for i, guard in enumerate(documents):
        of = f" of {guard['model']} at {guard['tolerance_m']:g} m" if i else ""
        for method, title in _METHODS.items():
            refused = [profile["profile"] for profile in guard["profiles"] if profile[method]["refusal"] is not None]
            if refused:
                found.append(f"{title}{of} was not judged under {', '.join(refused)}: it promises nothing there.")
    texts = [guard["guarantee"] for guard in documents]
    if CALIBRATION_READ in results["warnings"] and any(each[method] for each in texts for method in _METHODS):
        found.append(CALIBRATION_READ)
    claimed = [
        (each["conformal"], None if each["conformal"] is None else CONDITIONAL, each["learn_then_test"])
        for each in texts
    ]
    margins = [each["global_margin"] for each in texts]
    said = [text for each in claimed for text in each] + margins
    return [*found, *dict.fromkeys(text for text in said if text is not None)]


def noise_floor(results: Mapping[str, Any]) -> str | None:
    """Sentences on how often a repeated nominal would be a violation; ``None`` where the noise is unknown.

    Args:
        results: As above.
    """
    noise = results["noise"]
    if noise is None or not (noise["losses"]["num_groups"] and noise["losses"]["num_repeats"]):
        return None
    known = [(results["guard"]["tolerance_m"], noise["losses"])]
    known += [(losses["tolerance_m"], losses) for losses in noise.get("further_losses", ())]
    return " ".join(_floor(tolerance_m, losses, noise["tolerance"][SEPARATION]) for tolerance_m, losses in known)


def _floor(tolerance_m: float, losses: Document, noisy: float | None) -> str:
    groups, repeats = losses["num_groups"], losses["num_repeats"]
    losing, repeats_losing = losses["num_groups_losing"], losses["num_repeats_losing"]
    found = (
        f"Repeated nominals lose more than {tolerance_m:g} m of separation in {losing} of {groups} training groups "
        f"({100 * losing / groups:.1f} %), {repeats_losing} of {repeats} repeats "
        f"({100 * repeats_losing / repeats:.1f} %)."
    )
    if noisy is not None and tolerance_m < noisy:
        found += (
            f" The tolerance of {tolerance_m:g} m is below the noise tolerance of separation, {noisy:.4f} m: single "
            "violations may be noise, and a rate is to be read against that of the repeats."
        )
    return found
