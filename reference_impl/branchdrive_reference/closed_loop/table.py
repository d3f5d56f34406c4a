"""Tables of a run, with what may and may not be concluded at their head."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from branchdrive.benchmark.cell import number, with_ends
from branchdrive.benchmark.ranking.selected_table import percents
from branchdrive.contract.text import NONE, counted
from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive.statistics.sign_flip import p_text
from branchdrive.text.markdown import section_lines
from branchdrive.text.table import Column, Passage, Table
from branchdrive_reference.closed_loop.correlation import COEFFICIENTS, LEAST_SELECTORS
from branchdrive_reference.closed_loop.result import EVENTS, OFFLINE

__all__ = ["CONCLUSIONS", "drive_sections", "render_drives"]

Document = Mapping[str, Any]

CONCLUSIONS = (
    "These drives say how selectors compare in this world, on these routes, when each decides from the states that its "
    "own decisions led to. All arms share seeds, so differences to nominal are those of the same situations. They do "
    "not say how any selector would drive elsewhere: expert, traffic and physics are those of one simulator. Between "
    "and after interventions the world's privileged expert drives, a supervised expert and no autonomous driving. "
    "Nominal therefore has its foresight, and a selector shows what its interventions add or cost. Where "
    "nominal drives to its goal without an event, a selector can lose score against it and gain none. Learned "
    "selectors have seen branches of training alone: a first decision is what they were fitted for. Later decisions "
    "are made in states that no training branch has, which is why both are told apart. An event that was not seen in "
    "this many drives may happen in the next one, as the upper ends of intervals tell. The gate says that collisions "
    "were not more here; it proves no bound. Nothing here is called safe."
)
"""What a reader may and may not conclude."""

_EVENT_TITLES = {"collision": "Collision", "off_road": "Off road", "infraction": "Red light or stop sign"}
_FIGURE_TITLES = {"value": "value", "regret": "regret", "contact": "contact in the window"}
_GATE = {True: "passed", False: "failed", None: "not judged"}
_WHO = (Column.name("Selector"), Column("Decisions", is_text=True))


def render_drives(results: Document) -> str:
    """The tables as Markdown.

    Args:
        results: See `drive_results`.
    """
    short = [_inconclusive(results)] if results["num_clusters"] < LEAST_UNITS else []
    head = "# Closed loop"
    parts = [
        section_lines(section, [*results["warnings"], *(short if isinstance(section, Table) else ())])
        for section in drive_sections(results)
    ]
    return "\n\n".join([head, *("\n".join(lines) for lines in parts)]) + "\n"


def _inconclusive(results: Document) -> str:
    clusters = counted(results["num_clusters"], "route cluster")
    return f"Nothing can be concluded: {clusters}, and intervals and tests of 95 % take {LEAST_UNITS} or more."


def drive_sections(results: Document) -> list[Table | Passage]:
    """Passage and tables in order."""
    left_out = [f"{count} because {reason}" for reason, count in results["left_out"].items()]
    population = (
        f"{counted(results['num_driven'], 'group')} of {results['num_planned']} planned ones were driven, in "
        f"{counted(results['num_clusters'], 'route cluster')} that no group of `train` belongs to."
        + (f" Left out: {', '.join(left_out)}." if left_out else "")
    )
    sections: list[Table | Passage] = [Passage("What may and may not be concluded", [CONCLUSIONS, population])]
    for condition in dict.fromkeys(arm["condition"] for arm in results["arms"]):
        arms = [arm for arm in results["arms"] if arm["condition"] == condition]
        sections += [
            _drives(arms, condition),
            _ways(arms, condition),
            _decisions(arms, condition),
            _against_nominal(arms, condition),
            *([_ahead(arms, condition)] if all("look_ahead" in arm for arm in arms) else []),
        ]
    if results["offline"] is not None:
        sections += [_offline(results), _orders(results)]
    return sections


def _who(arm: Document) -> list[str]:
    return [arm["selector"], _decisions_text(arm)]


def _decisions_text(schedule: Document) -> str:
    number_of = schedule["num_decisions"]
    return "1" if number_of == 1 else f"up to {number_of}, every {schedule['every_ticks']} ticks"


def _cell(figure: Document, digits: int = 3) -> str:
    return NONE if figure["value"] is None else with_ends(number(figure["value"], digits), figure)


def _drives(arms: Sequence[Document], condition: str) -> Table:
    columns = [
        *_WHO, *(Column(_EVENT_TITLES[event]) for event in EVENTS), Column("Clean"), Column("Completed"),
        Column("Share of route"), Column("Driving score"),
    ]  # fmt: skip
    rows = [
        [
            *_who(arm),
            *(percents(arm["shares"][name]) for name in (*EVENTS, "clean", "completed")),
            *(_cell(arm["means"][name]) for name in ("route_fraction", "score")),
        ]
        for arm in arms
    ]
    notes = [
        "Shares of drives, with intervals of Clopper and Pearson by route clusters. Clean: without any of these.",
        "The driving score has the form of the CARLA leaderboard's and is none of its scores. It is the share of the "
        "route, less the share of the way off road. Each collision is a factor, of .50 with a pedestrian, .60 with a "
        "vehicle and .65 with something static; each red light is one of .70, each stop sign one of .80.",
    ]
    return Table(f"Drives, {condition}", columns, rows, notes, has_intervals=True)


def _ways(arms: Sequence[Document], condition: str) -> Table:
    columns = [
        *_WHO, Column("Way, km"), *(Column(f"{_EVENT_TITLES[event]}, 1/km") for event in EVENTS),
        Column("Mean jerk, m/s3"), Column("Largest acceleration, m/s2"), Column("Largest yaw rate, rad/s"),
    ]  # fmt: skip
    rows = [
        [
            *_who(arm),
            number(arm["way_km"], 1),
            *(_cell(arm["events_a_km"][event], 2) for event in EVENTS),
            *(_cell(arm["means"][name], 2) for name in ("mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps")),
        ]
        for arm in arms
    ]
    notes = ["From the branch to the end of each drive; drives that end early have driven less."]
    return Table(f"Events a kilometre and comfort, {condition}", columns, rows, notes, has_intervals=True)


def _decisions(arms: Sequence[Document], condition: str) -> Table:
    columns = [
        *_WHO, Column("Intervenes at first"), Column("Collision in that window"), Column("Collision later"),
        Column("Interventions a drive"), Column("First choices", is_text=True), Column("Later choices", is_text=True),
    ]  # fmt: skip
    rows = [
        [
            *_who(arm),
            percents(arm["shares"]["first_intervention"]),
            percents(arm["shares"]["collision_in_first_window"]),
            percents(arm["shares"]["collision_later"]),
            _cell(arm["means"]["interventions"], 2),
            _choices(arm["first_choices"]),
            _choices(arm["later_choices"]),
        ]
        for arm in arms
    ]
    notes = [
        "That window: the 2.5 s from the first decision on, in which later ones fall where they come sooner. Later is "
        "whatever comes after it."
    ]
    return Table(f"First decision and later ones, {condition}", columns, rows, notes, has_intervals=True)


def _choices(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{key} {count}" for key, count in counts.items()) or NONE


def _against_nominal(arms: Sequence[Document], condition: str) -> Table:
    columns = [
        *_WHO, Column("Score less nominal's"), Column("p, Holm"), Column("Collides where nominal does not"),
        Column("Does not where nominal does"), Column("Collisions less nominal's"), Column("Gate"),
    ]  # fmt: skip
    rows = []
    for arm in arms:
        found = arm["to_nominal"]
        if found is not None:
            score = found["score"]
            p = p_text(score["p_adjusted"], score["p_is_bound"])
            shares = (percents(found[name]) for name in ("worse", "better", "collision"))
            rows.append([*_who(arm), _cell(score), p, *shares, _GATE[found["gate_passed"]]])
    notes = [
        "Group by group, to nominal under the same schedule and noise. Tests flip signs of whole route clusters, and "
        "are adjusted over every selector, schedule and condition of the run.",
        "The gate, fixed before the first drive, fails where more drives collide than nominal's, of those that were "
        "both monitored, and is not judged without one. The interval is no part of it.",
    ]
    return Table(f"Against nominal, {condition}", columns, rows, notes, has_intervals=True)


def _ahead(arms: Sequence[Document], condition: str) -> Table:
    columns = [
        *_WHO, Column("First decision"), Column("Later ones"), Column("Later ones ranked"),
        Column("By decision", is_text=True),
    ]  # fmt: skip
    rows = []
    for arm in arms:
        found = arm["look_ahead"]
        each = [f"{number(one['value'])} ({one['num_ranked']})" for one in found["by_decision"] if one["num_ranked"]]
        later = found["later"]
        rows.append([*_who(arm), _cell(found["first"]), _cell(later), str(later["num_ranked"]), ", ".join(each)])
    notes = [
        "At every decision all candidates were driven ahead from the state that the selector's own drive was in, which "
        "no vehicle can. Regret is by how much the choice falls short of the best utility of their windows, as a share "
        "of the range from the worst to the best. Behind each decision stands in how many groups it was ranked: where "
        "every candidate has a utility.",
        "Regret looks no further than a window, so that a choice without regret may still lead into a collision.",
    ]
    return Table(f"Regret by look-ahead at every decision, {condition}", columns, rows, notes, has_intervals=True)


def _offline(results: Document) -> Table:
    found = results["offline"]
    rows = [
        [one["selector"], _cell(one["value"]), _cell(one["regret"]), percents(one["contact"])]
        for one in found["selectors"]
    ]
    columns = [Column.name("Selector"), Column("Value"), Column("Regret"), Column("Contact")]
    notes = [
        f"What the first choice of each selector is worth in its window of 2.5 s, profile {results['profile']}, in "
        f"{counted(found['num_ranked'], 'group')} in which every candidate has a utility. The bank was driven at the "
        "branch, so that offline figures and drives are of the same groups.",
        "Contact: a separation of 0 m to an actor in a saved frame of the window. That is less than a collision of a "
        "drive, which is any touch: also of walls and other things of the world that are no actors, from which no "
        "separation is measured, and between saved frames.",
    ]
    return Table("Offline figures of the same groups", columns, rows, notes, has_intervals=True)


def _orders(results: Document) -> Table:
    columns = [
        Column("Decisions", is_text=True), Column("Offline figure", is_text=True), Column("Selectors"),
        Column("Spearman"), Column("Kendall"), Column("R2"),
    ]  # fmt: skip
    rows = []
    for row in results["correlations"]:
        found = row["coefficients"]
        cells = [NONE] * len(COEFFICIENTS) if found is None else [_cell(found[name]) for name in COEFFICIENTS]
        rows.append([_decisions_text(row), _FIGURE_TITLES[row["figure"]], str(row["num_selectors"]), *cells])
    notes = [
        f"Whether the offline figure orders selectors as their driving scores do. Of {' and '.join(OFFLINE[1:])} less "
        "is better, and their sign is turned. Selectors that made the same choices in all groups count once.",
        "Intervals of 95 % resample route clusters: they tell what other groups would have given, not what other "
        f"selectors would. With fewer than {LEAST_SELECTORS} selectors, or a figure that is the same for all, there is "
        "none.",
    ]
    return Table("Offline against closed loop", columns, rows, notes, has_intervals=True)
