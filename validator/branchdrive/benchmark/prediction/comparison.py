"""Tables of comparisons: two rows for each, by route clusters and by groups."""

from __future__ import annotations

from branchdrive.benchmark.cell import BCA, BY_CLUSTERS, Document, ends_of, number
from branchdrive.contract.text import NONE
from branchdrive.statistics.sign_flip import p_text
from branchdrive.text.table import Column, Passage, Table

__all__ = ["JUDGED_BY_CLUSTERS", "UNADJUSTED", "comparison_table"]

JUDGED_BY_CLUSTERS = (
    "Claims are judged by route clusters: groups of one cluster are alike, so that tests and intervals by groups are "
    "too sure of themselves. Those by groups stand for parity with the paper."
)
"""Below every table of comparisons."""

UNADJUSTED = (
    "Tests in no family, of models that the protocol does not declare, explore: nothing adjusts their p-values."
)

_UNMADE = (
    "There is none: those that the protocol declares are with its own models, as M3, and the rows of these take "
    "`branchdrive benchmark` on this release first."
)


def comparison_table(title: str, section: Document) -> Table | Passage:
    """Comparisons of a section of results with its families, or why there is none."""
    families = section["families"]
    if not section["comparisons"]:
        return Passage(title, [_UNMADE if families else "The protocol declares none."])
    adjusted = {family["name"]: {m["name"]: m for m in family["members"]} for family in families}
    rows = []
    for found in section["comparisons"]:
        members = [adjusted[family["name"]].get(found["name"]) for family in families]
        about = [found["name"], number(found["difference"], 4)]
        rows += [
            [
                *about,
                _counted(found["num_clusters"], "cluster"),
                ends_of(found["interval"], *BY_CLUSTERS),
                NONE,
                p_text(found["p_clusters"], found["is_bound_clusters"]),
                *(NONE if m is None else p_text(m["p_holm_clusters"], m["is_bound_clusters"]) for m in members),
                NONE,
                number(found["intra_cluster_correlation"], 2),
            ],
            [
                *about,
                _counted(found["num_groups"], "group"),
                ends_of(found["interval"]),
                ends_of(found["interval"], *BCA),
                p_text(found["p"], found["is_bound"]),
                *(NONE if m is None else p_text(m["p_holm"], m["is_bound"]) for m in members),
                p_text(found["studentised_p"], found["is_bound_studentised"]),
                NONE,
            ],
        ]
    columns = [
        Column.name("Comparison", is_code=True),
        Column("Difference", is_text=True),
        Column.name("By"),
        Column("Percentile"),
        Column("BCa"),
        Column("p"),
        *(Column(f"p Holm, {family['name']}") for family in families),
        Column("p studentised"),
        Column("Correlation within clusters"),
    ]
    return Table(title, columns, rows, _notes(section), has_intervals=True)


def _notes(section: Document) -> list[str]:
    """What stands below a table of comparisons."""
    names = {found["name"] for found in section["comparisons"]}
    declared = {member["name"] for family in section["families"] for member in family["members"]}
    return [
        JUDGED_BY_CLUSTERS,
        *([UNADJUSTED] if names - declared else []),
        *(
            f"Family `{family['name']}`: {family['num_evaluated']} of {family['num_declared']} declared tests were "
            "evaluated; the others count with p = 1, so that adjusted p-values are upper bounds."
            for family in section["families"]
            if family["num_evaluated"] < family["num_declared"]
        ),
    ]


def _counted(number_of: int, unit: str) -> str:
    return f"{number_of} {unit}" if number_of == 1 else f"{number_of} {unit}s"
