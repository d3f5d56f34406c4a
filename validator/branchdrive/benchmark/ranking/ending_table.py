"""Tables of how the drives of selected candidates end, and which end worse than nominal's.

Source: spec/14-benchmark.md#endings.
"""

from __future__ import annotations

from typing import Any

from branchdrive.benchmark.cell import BY_CLUSTERS, Document, ends_of, number
from branchdrive.benchmark.protocol.selection import CLEAN_ORACLE
from branchdrive.benchmark.ranking.ending import COMPARED
from branchdrive.benchmark.ranking.selected_table import is_privileged, percents
from branchdrive.contract.text import NONE, percent
from branchdrive.driving.utility import TIE
from branchdrive.text.table import Column, Table

__all__ = ["LIMITS", "MEANING", "ending_sentence", "ending_tables", "has_endings"]

MEANING = (
    "What was recorded of the whole drive of the selected candidate: the window, and after it the drive as it went on "
    "under the expert's policy to its end, which no selector decided. Drives end at their goal, when their time is up "
    "or where they are stopped, so that they differ in length."
)
LIMITS = "This is no closed loop, and nothing here is called safe."

_COLUMNS = (
    Column.name("Selector"),
    Column("Collision"),
    Column("Off road"),
    Column("Red light or stop sign"),
    Column("Clean"),
    Column("Clean, to nominal"),
    Column("Completed"),
    Column("Completed, to nominal"),
    Column("Share of route"),
    Column("Known"),
)


_FIGURE = ("value", "low", "high")


def has_endings(profile: Document) -> bool:
    """Whether a ranked profile of ``results.json`` tells how drives end."""
    return "num_with_clean" in profile


def ending_tables(profile: Document) -> list[Table]:
    """Tables of one ranked profile, what sees more than sensors apart; none where it tells nothing of ends."""
    if not has_endings(profile):
        return []
    entries = profile["entries"]
    parts = [("", [entry for entry in entries if not is_privileged(entry)])]
    parts += [(", privileged", [entry for entry in entries if is_privileged(entry)])]
    return [_table(profile, found, suffix) for suffix, found in parts if found]


def _table(profile: Document, entries: list[Any], suffix: str) -> Table:
    notes = [
        MEANING,
        LIMITS,
        f"Shares of the selections in N = {profile['num_ranked']} groups, with intervals of 95 % by route clusters. "
        "Clean: without a collision, a departure from the road and a red light or stop sign that was run. To nominal: "
        "less the share of nominal in the same groups, in points. Known: of whose drives all of this was monitored. A "
        f"candidate with a clean drive is there in {profile['num_with_clean']} groups; `{CLEAN_ORACLE}` takes the best "
        "utility among these candidates, and among all where there is none.",
    ]
    if not suffix and (sentence := ending_sentence(profile)) is not None:
        notes.append(sentence)
    title = f"Selected drives to their end, profile {profile['profile']}{suffix}"
    return Table(title, _COLUMNS, [_row(entry) for entry in entries], notes, has_intervals=True)


def _row(entry: Document) -> list[str]:
    found = entry["outcomes"]["endings"]
    route = found["route_fraction"]
    return [
        entry["selector"],
        *(percents(found[event]) for event in ("collision", "off_road", "infraction")),
        *(cell for end in COMPARED for cell in (percents(found[end]), _points(found["to_nominal"][end]))),
        f"{number(route['mean'])} {ends_of(route['interval'], *BY_CLUSTERS)}".removesuffix(f" {NONE}"),
        percent(found["known"], 1),
    ]


def ending_sentence(profile: Document) -> str | None:
    """Which selectors' drives end worse than nominal's; ``None`` where none do.

    Args:
        profile: A ranked profile of ``results.json`` that tells how drives end.
    """
    said = []
    for entry in profile["entries"]:
        to_nominal = entry["outcomes"]["endings"]["to_nominal"]
        worse = [
            f"{end} {-100 * value:.1f} points less"
            for end in COMPARED
            if (value := to_nominal[end]["value"]) is not None and value < -TIE
        ]
        if worse:
            said.append(f"`{entry['selector']}` ({', '.join(worse)})")
    return f"Drives end worse than those of nominal in the same groups: {', '.join(said)}." if said else None


def _points(rate: Document) -> str:
    """A difference of shares with its interval, in points of per cent."""
    value, *ends = (None if rate[name] is None else f"{100 * rate[name] + 0.0:+.1f}" for name in _FIGURE)
    return NONE if value is None else value if None in ends else f"{value} [{ends[0]}, {ends[1]}]"
