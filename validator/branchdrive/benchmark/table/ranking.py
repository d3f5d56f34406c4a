"""Tables of rankings: every selector under every profile, and comparisons of selectors."""

from __future__ import annotations

from branchdrive.benchmark.table.comparison import comparisons
from branchdrive.benchmark.table.markdown import (
    BY_CLUSTERS,
    Document,
    Rows,
    ends_of,
    number,
    plain,
    spread_over_seeds,
    table,
)

__all__ = ["ranking_tables"]


def ranking_tables(results: Document) -> list[list[str]]:
    """Sections of lines."""
    ranking = results["ranking"]
    sections = [
        table(f"Ranking, profile {profile['profile']}", results, *_profile(profile)) for profile in ranking["profiles"]
    ]
    sections += [
        [f"## Ranking, profile {out['profile']}", "", f"Not judged: {plain(out['reason'])}."]
        for out in ranking["left_out"]
    ]
    return [*sections, table("Comparisons of selectors", results, *comparisons(ranking))]


def _profile(profile: Document) -> tuple[list[str], Rows, list[str]]:
    rows = [
        [
            entry["selector"],
            spread_over_seeds(entry["value"], entry["seed_sd"]["value"]),
            ends_of(entry["intervals"]["value"], *BY_CLUSTERS),
            _signed(entry["difference"]),
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
    header = [
        "Selector", "Value", "95 %, clusters", "To nominal", "Regret", "Concordance", "NDCG", "Top-1", "Seed agreement",
        "Captured", "Actions", "Non-worsening",
    ]  # fmt: skip
    fixed = "there is no fixed brake" if profile["fixed_brake"] is None else f"fixed brake `{profile['fixed_brake']}`"
    note = (
        f"N = {profile['num_ranked']} groups; {profile['num_without_separation']} left for want of a separation, "
        f"{profile['num_without_other']} for want of another target; {profile['num_without_range']} without any range. "
        f"ActionPrior takes `{profile['action_prior']}`, {fixed}. The interval of the non-worsening gate resamples "
        "route clusters."
    )
    return header, rows, [note]


def _gate(gate: Document) -> str:
    ends = "" if gate["low"] is None else f" {ends_of(gate)}"
    return f"{'pass' if gate['passed'] else 'fail'} ({_signed(gate['mean_m'])} m{ends})"


def _signed(value: float) -> str:
    return f"{round(value, 3) + 0.0:+.3f}"
