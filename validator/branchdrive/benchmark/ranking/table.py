"""Tables of rankings: every selector under every profile, against references, and comparisons of selectors."""

from __future__ import annotations

from branchdrive.benchmark.cell import (
    BY_CLUSTERS,
    Document,
    ends_of,
    number,
    signed,
    spread_over_seeds,
    with_ends,
)
from branchdrive.benchmark.prediction.comparison import JUDGED_BY_CLUSTERS, comparison_table
from branchdrive.benchmark.protocol.selection import ENSEMBLE, LEARNED, MEAN
from branchdrive.benchmark.ranking.selected_table import is_privileged, selected_tables
from branchdrive.contract.text import NONE
from branchdrive.statistics.sign_flip import p_text
from branchdrive.text.table import Column, Passage, Table

__all__ = ["ranking_sections"]

_COLUMNS = (
    Column.name("Selector"),
    Column("Value"),
    Column("95 %, clusters"),
    Column("To nominal"),
    Column("Regret"),
    Column("Concordance"),
    Column("NDCG"),
    Column("Top-1"),
    Column("Seed agreement"),
    Column("Captured"),
    Column("Actions"),
    Column("Non-worsening"),
)
_SEES = Column("Sees", is_text=True)
_OF_MEANS, _NOTHING = (f"{LEARNED}{MEAN}", f"{ENSEMBLE}{MEAN}"), "nothing"
"""Selectors by the means of training: whatever their model may see by its contract, it looks at nothing of a group."""

_SELECTORS = (
    "`action_prior` is the best constant action of training. O-MODEL chooses by each seed of a model and has the mean "
    "of what these choices are worth, E-MODEL by the mean prediction of the seeds. A selector marked (tie) has equal "
    "scores in every group, so that the order of the bank decides: it is a tie rule and selects by nothing."
)
_PRIVILEGED = (
    "These selectors see what no sensor of the vehicle tells. They show how much a context can be worth, not what a "
    "selector of a vehicle reaches."
)
_HELD = (
    "Differences are those of the selector less the reference; intervals resample route clusters, and p-values flip "
    "their signs. These tests explore, but for those of a declared family: nothing adjusts the p-values here."
)


def ranking_sections(results: Document) -> list[Table | Passage]:
    """A table for each ranked profile, why the others are not ranked, and the comparisons."""
    ranking = results["ranking"]
    return [
        *(
            table
            for profile in ranking["profiles"]
            for table in (*_profile_tables(profile, ranking), *selected_tables(profile, results))
        ),
        *(
            Passage(f"Ranking, profile {out['profile']}", [f"Not judged: {out['reason']}."])
            for out in ranking["left_out"]
        ),
        comparison_table("Comparisons of selectors", ranking),
    ]


def _profile_tables(profile: Document, ranking: Document) -> list[Table]:
    """The ranking; under a protocol with a `selection` also what sees more than sensors, and what is held against."""
    name, held = profile["profile"], ranking.get("held")
    fixed = "there is no fixed brake" if profile["fixed_brake"] is None else f"fixed brake `{profile['fixed_brake']}`"
    note = (
        f"N = {profile['num_ranked']} groups; {profile['num_without_separation']} were left out because a separation "
        f"is missing, {profile['num_without_other']} because another target is missing; all utilities are equal in "
        f"{profile['num_without_range']}. "
        f"ActionPrior takes `{profile['action_prior']}`, {fixed}. The interval of the non-worsening gate resamples "
        "route clusters."
    )
    title = f"Ranking, profile {name}"
    if held is None:
        return [Table(title, _COLUMNS, [_row(entry) for entry in profile["entries"]], [note], has_intervals=True)]
    columns = (_COLUMNS[0], _SEES, *_COLUMNS[1:])
    apart = [entry for entry in profile["entries"] if is_privileged(entry)]
    tables = [
        Table(
            title,
            columns,
            [_row(entry) for entry in profile["entries"] if not is_privileged(entry)],
            [note, _SELECTORS, *_unseen(ranking["unseen"])],
            has_intervals=True,
        )
    ]
    if apart:
        rows = [_row(entry) for entry in apart]
        tables.append(Table(f"{title}, privileged", columns, rows, [_PRIVILEGED], has_intervals=True))
    if rows := _held_rows([found for found in held if found["profile"] == name]):
        held_title = f"Learned selectors against references, profile {name}"
        tables.append(Table(held_title, _HELD_COLUMNS, rows, _HELD_NOTES, has_intervals=True))
    return tables


def _unseen(names: list[str]) -> list[str]:
    return [f"Not judged, because the dataset has no evidence of surroundings: {', '.join(names)}."] if names else []


def _row(entry: Document) -> list[str]:
    sees = [_NOTHING if entry["selector"] in _OF_MEANS else entry["sees"] or NONE] if "sees" in entry else []
    return [
        f"{entry['selector']} (tie)" if entry.get("is_tie") else entry["selector"],
        *sees,
        spread_over_seeds(entry["value"], entry["seed_sd"]["value"]),
        ends_of(entry["intervals"]["value"], *BY_CLUSTERS),
        signed(entry["difference"]),
        spread_over_seeds(entry["regret"], entry["seed_sd"]["regret"]),
        number(entry["concordance"]),
        number(entry["ndcg"]),
        number(entry["top_1"]),
        number(entry["agreement"]),
        number(entry["captured"]),
        " to ".join(str(n) for n in sorted({min(entry["num_actions"]), max(entry["num_actions"])})),
        _gates(entry),
    ]


def _held_rows(found: list[Document]) -> list[list[str]]:
    """A row for each selector and reference, of the differences in value and in regret."""
    pairs: dict[tuple[str, str], dict[str, Document]] = {}
    for comparison in found:
        pairs.setdefault((comparison["left"], comparison["right"]), {})[comparison["metric"]] = comparison
    return [
        [
            left,
            right,
            *(
                cell
                for measure in ("value", "regret")
                for cell in (
                    number(by[measure]["difference"]),
                    ends_of(by[measure]["interval"], *BY_CLUSTERS),
                    p_text(by[measure]["p_clusters"], by[measure]["is_bound_clusters"]),
                )
            ),
            str(by["value"]["num_clusters"]),
        ]
        for (left, right), by in pairs.items()
    ]


_HELD_COLUMNS = (
    Column.name("Selector"),
    Column.name("Reference"),
    Column("Difference in value"),
    Column("95 %, value"),
    Column("p, value"),
    Column("Difference in regret"),
    Column("95 %, regret"),
    Column("p, regret"),
    Column("Clusters"),
)
_HELD_NOTES = (_HELD, JUDGED_BY_CLUSTERS)


def _gates(entry: Document) -> str:
    """The gate against ActionPrior; where there is one against nominal too, both name what they compare with."""
    if "gate_to_nominal" not in entry:
        return _gate(entry["gate"])
    return f"action_prior: {_gate(entry['gate'])}, nominal: {_gate(entry['gate_to_nominal'])}"


def _gate(gate: Document) -> str:
    mean = with_ends(f"{signed(gate['mean_m'])} m", gate)
    return f"{'pass' if gate['passed'] else 'fail'} ({mean})"
