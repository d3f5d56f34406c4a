"""Tables of rankings: every selector under every profile, and comparisons of selectors."""

from __future__ import annotations

from branchdrive.benchmark.table.cell import (
    BY_CLUSTERS,
    Document,
    ends_of,
    number,
    signed,
    spread_over_seeds,
    with_ends,
)
from branchdrive.benchmark.table.comparison import comparison_table
from branchdrive.benchmark.table.selected import selected_tables
from branchdrive.text.table import Column, Passage, Table

__all__ = ["ranking_sections"]

_COLUMNS = (
    Column.name("Selector"),
    Column("Value"),
    Column("95 %, clusters", is_detail=True),
    Column("To nominal"),
    Column("Regret"),
    Column("Concordance"),
    Column("NDCG"),
    Column("Top-1"),
    Column("Seed agreement", is_detail=True),
    Column("Captured"),
    Column("Actions", is_detail=True),
    Column("Non-worsening"),
)


def ranking_sections(results: Document) -> list[Table | Passage]:
    """A table for each ranked profile, why the others are not ranked, and the comparisons."""
    ranking = results["ranking"]
    return [
        *(
            table
            for profile in ranking["profiles"]
            for table in (_profile_table(profile), *selected_tables(profile, results))
        ),
        *(
            Passage(f"Ranking, profile {out['profile']}", [f"Not judged: {out['reason']}."])
            for out in ranking["left_out"]
        ),
        comparison_table("Comparisons of selectors", ranking),
    ]


def _profile_table(profile: Document) -> Table:
    rows = [
        [
            entry["selector"],
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
            _gate(entry["gate"]),
        ]
        for entry in profile["entries"]
    ]
    fixed = "there is no fixed brake" if profile["fixed_brake"] is None else f"fixed brake `{profile['fixed_brake']}`"
    note = (
        f"N = {profile['num_ranked']} groups; {profile['num_without_separation']} were left out because a separation "
        f"is missing, {profile['num_without_other']} because another target is missing; all utilities are equal in "
        f"{profile['num_without_range']}. "
        f"ActionPrior takes `{profile['action_prior']}`, {fixed}. The interval of the non-worsening gate resamples "
        "route clusters."
    )
    return Table(f"Ranking, profile {profile['profile']}", _COLUMNS, rows, [note])


def _gate(gate: Document) -> str:
    mean = with_ends(f"{signed(gate['mean_m'])} m", gate)
    return f"{'pass' if gate['passed'] else 'fail'} ({mean})"
