"""A study as text for people."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from operator import attrgetter
from typing import TextIO, TypeAlias

from rich.console import Console
from rich.text import Text

from branchdrive.contract.text import NONE, counted
from branchdrive.contract.timing import ACTIVE_TICKS, TICK_S
from branchdrive.driving.discrepancy import CORE
from branchdrive.text.table import Column, Passage, Table
from branchdrive.text.terminal import print_facts, print_section, render
from branchdrive_reference.study.label import label
from branchdrive_reference.study.study import CollectedDrives, CollectedGroups, Rate, Scenario, Spread, Study

__all__ = ["render_study", "study_sections"]

Shares: TypeAlias = Callable[[Scenario], Mapping[str, Rate]]
_COLLIDED: Shares = attrgetter("collided")
_IN_WINDOW: Shares = attrgetter("collided_in_window")
_BEST: Shares = attrgetter("best")
_WORST: Shares = attrgetter("worst")
_NUM_GROUPS: Callable[[Scenario], int] = attrgetter("num_groups")
_NUM_RANKED: Callable[[Scenario], int] = attrgetter("num_ranked")

_WINDOW = f"{ACTIVE_TICKS * TICK_S:g} s"
_RANKING = (
    f"Utility profile {{}}: a third each of separation, displacement and comfort over {_WINDOW}, scaled by this "
    "dataset's quantiles. It knows a collision only by what that does to these, and is no judgement of safety. Ranked "
    "are groups in which every candidate has a separation; ties are shared."
)


_KINDS = {
    "onset": "at the manoeuvre",
    "early": "half a second before it or more",
    "quiet": "controls without one",
    "none": "none",
}
"""Kinds of branch in words."""


def render_study(study: Study, stdout: TextIO, *, is_file: bool = False, is_full: bool = True) -> str:
    """The study as text for `stdout` or a file: every table, or a page of headlines."""
    return render(partial(_print_study if is_full else _print_headlines, study=study), stdout, is_file=is_file)


def study_sections(study: Study) -> list[Table | Passage]:
    """The headlines of a study as values: what was collected, outcomes, discrepancies, and whether replays repeat."""
    facts = [[name, text] for name, text in _population_facts(study).items()]
    collected = Table("What was collected", [Column.name("of"), Column("there are", is_text=True)], facts)
    if study.drives is not None:
        return [collected, Passage("Outcomes", [_OF_DRIVES])]
    discrepancies = _largest_discrepancies(study)
    return [
        collected,
        *_overall_sections(study),
        *([] if discrepancies is None else [discrepancies]),
        Passage("Nominal replays", [_equality_text(study)[0]]),
    ]


def _print_headlines(console: Console, study: Study) -> None:
    """What fits on a screen: outcomes of all groups together, and the largest discrepancies."""
    console.print(Text(f"{label(study.dataset_id)} {label(study.dataset_version)}", style="bold"))
    _print_population(console, study)
    console.print()
    if study.drives is not None:
        console.print(Text(_OF_DRIVES))
        return
    _print_overall(console, study)
    if discrepancies := _largest_discrepancies(study):
        console.print()
        print_section(console, discrepancies)
    _print_equality(console, study)
    console.print(Text("--full has every scenario type and variable, --format json every number.", style="dim"))


_NO_OUTCOMES = "No outcomes: no group is integrity-complete"
_OF_DRIVES = (
    "Drives are in no branch group: there is no bank to rank and no replay to compare. What drives came to stands in "
    "the results of the run that recorded them."
)
_NO_EVIDENCE = "Collisions and ranks are unknown: the dataset claims no risk evidence"


def _print_overall(console: Console, study: Study) -> None:
    """Outcomes of all groups: of nominal drives in words, of families as a table."""
    if not study.overall.num_groups:
        console.print(Text(_NO_OUTCOMES, style="bold"))
        return
    if not study.has_evidence:
        console.print(Text(_nominal_sentence(study)))
        console.print(Text(_NO_EVIDENCE, style="bold"))
        return
    print_section(console, _outcome_table(study))
    if len(study.branches) > 1:
        console.print()
        print_section(console, _branch_table(study))
    if study.overall.num_ranked:
        _print_ranking(console, study)


def _overall_sections(study: Study) -> list[Table | Passage]:
    """The same as values."""
    if not study.overall.num_groups:
        return [Passage("Outcomes", [f"{_NO_OUTCOMES}."])]
    if not study.has_evidence:
        return [Passage("Outcomes", [_nominal_sentence(study), f"{_NO_EVIDENCE}."])]
    found: list[Table | Passage] = [_outcome_table(study)]
    if len(study.branches) > 1:
        found.append(_branch_table(study))
    if study.overall.num_ranked:
        found.append(Passage("What the ranks mean", _ranking_texts(study)))
    return found


def _nominal_sentence(study: Study) -> str:
    """What became of nominal drives."""
    unseen = f"; not always monitored: {', '.join(study.not_monitored)}" if study.not_monitored else ""
    overall = study.overall
    return (
        f"Of nominal drives {_percent(overall.completed)} % completed their route, {_percent(overall.clean)} % "
        f"without a collision or an infraction{unseen}."
    )


def _outcome_table(study: Study) -> Table:
    """Outcomes of the families of all groups."""
    overall = study.overall
    title = f"Outcomes of {counted(overall.num_groups, 'integrity-complete group')}, % of each family"
    shares = {f"collides within {_WINDOW}": overall.collided_in_window, "collides ever": overall.collided}
    if overall.num_ranked:
        ranked = counted(overall.num_ranked, "ranked group")
        shares |= {f"has the best of {ranked}": overall.best, f"has the worst of {ranked}": overall.worst}
    families = list(overall.best)
    rows = [[name, *(_percent(rates[family]) for family in families)] for name, rates in shares.items()]
    return Table(title, [Column.name("outcome"), *map(Column, families)], rows, [_nominal_sentence(study)])


def _branch_table(study: Study) -> Table:
    """Families of the best candidates by the kind of branch."""
    rows = [
        [
            _KINDS[row.scenario_type],
            f"{row.num_groups:,}",
            *map(_percent, row.best.values()),
            _percent(row.best_collided_in_window),
        ]
        for row in study.branches
    ]
    columns = [Column.name("branch"), *map(Column, ("groups", *study.overall.best, f"collides within {_WINDOW}"))]
    return Table("Family of the best candidate by the kind of branch, % of ranked groups", columns, rows)


def _largest_discrepancies(study: Study) -> Table | None:
    """The largest discrepancy from the nominal before the branch, by variable; ``None`` where nothing was compared."""
    subjects = {"interventions": study.interventions, "nominal replays": study.nominal_replays}
    compared = {f"{spreads[0].num:,} {name}": spreads for name, spreads in subjects.items() if spreads[0].num}
    if not compared:
        return None
    variables = [(spread.variable, spread.unit) for spread in study.interventions[: len(CORE)]]
    columns = [Column(f"{name}, {unit}" if unit else name) for name, unit in variables]
    rows = [[name, *(_extent(spread.max) for spread in spreads[: len(CORE)])] for name, spreads in compared.items()]
    groups = counted(study.population.num_integrity_complete, "integrity-complete group")
    title = f"Largest discrepancy from the nominal before the branch, in {groups}"
    return Table(title, [Column.name("of"), *columns], rows)


def _print_study(console: Console, study: Study) -> None:
    console.print(Text(f"{label(study.dataset_id)} {label(study.dataset_version)}", style="bold"))
    _print_population(console, study)
    if study.drives is not None:
        console.print()
        console.print(Text(_OF_DRIVES))
        return
    _print_outcomes(console, study)
    _print_spreads(console, "intervention", study.interventions)
    _print_spreads(console, "nominal replay", study.nominal_replays)
    _print_equality(console, study)


def _title(console: Console, title: str) -> None:
    console.print()
    console.print(Text(title, style="bold"))


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{label(name)} {count:,}" for name, count in counts.items())


def _skipped(population: CollectedGroups) -> str:
    """How many groups the tables leave out, and why; empty if none."""
    skipped = population.num_groups - population.num_integrity_complete
    if not skipped:
        return ""
    reasons = []
    if count := population.num_without_complete:
        reasons.append(f"{count:,} that {'lacks' if count == 1 else 'lack'} a complete attempt")
    if count := population.num_noncompliant:
        reasons.append(f"{count:,} that {'breaks' if count == 1 else 'break'} a rule")
    verb = "is" if skipped == 1 else "are"
    return f"; left out of outcomes, ranks and discrepancies {verb} {' and '.join(reasons)}"


def _held(population: CollectedGroups, drives: CollectedDrives | None) -> dict[str, str]:
    """Branch groups, or what is there in place of them, by what it is called."""
    if drives is not None:
        return {
            "contexts": f"{drives.num_contexts:,}",
            "drives": f"{drives.num_drives:,}",
            "decisions": f"{drives.num_decisions:,}: {_listed(drives.choices)}",
        }
    complete = f"{population.num_integrity_complete:,} integrity-complete{_skipped(population)}"
    return {"branch groups": f"{population.num_groups:,}, {complete}"}


def _population_facts(study: Study) -> dict[str, str]:
    """What was collected, by what it is called."""
    population = study.population
    hours = population.num_ticks * TICK_S / 3600
    return {
        **_held(population, study.drives),
        "scenario types": f"{len(population.scenario_types):,}: {_listed(population.scenario_types)}",
        "towns": f"{len(population.towns):,}: {_listed(population.towns)}",
        "branches": ", ".join(f"{_KINDS[kind]} {count:,}" for kind, count in population.branches.items()),
        "route clusters": f"{population.num_route_clusters:,}",
        "attempts": f"{sum(population.attempts.values()):,}: {_listed(population.attempts)}",
        "ticks": f"{population.num_ticks:,}, {hours:,.1f} hours of driving",
    }


def _print_population(console: Console, study: Study) -> None:
    _title(console, "Population")
    print_facts(console, _population_facts(study).items())


def _percent(rate: Rate, *, is_whole: bool = False) -> str:
    """A share in per cent; what is not quite none or all never reads as if it were."""
    if rate is None:
        return NONE
    if 0 < rate < 0.0005:
        return "<0.1"
    if 0.9995 <= rate < 1 - 1e-12:
        return ">99.9"
    return f"{100 * rate:.{0 if is_whole else 1}f}"


def _are_whole(rates: Iterable[Rate]) -> bool:
    """Whether every rate is none or all, so that decimals would say nothing."""
    return all(rate is None or rate in (0, 1) for rate in rates)


def _print_outcomes(console: Console, study: Study) -> None:
    if not study.overall.num_groups:
        _title(console, "No outcomes: no group is integrity-complete")
        return
    unseen = f"; not always monitored: {', '.join(study.not_monitored)}" if study.not_monitored else ""
    rows = [*study.scenarios, study.overall]
    families = list(study.overall.best)

    def print_rates(
        title: str,
        note: str,
        headings: Sequence[str],
        rates: Callable[[Scenario], Sequence[Rate]],
        num_groups: Callable[[Scenario], int] = _NUM_GROUPS,
    ) -> None:
        console.print()
        print_section(console, _rate_table(title, [note] if note else [], rows, headings, rates, num_groups))

    def print_families(
        title: str, note: str, shares: Shares, num_groups: Callable[[Scenario], int] = _NUM_GROUPS
    ) -> None:
        print_rates(title, note, families, lambda s: [shares(s)[family] for family in families], num_groups)

    print_rates(
        "Nominal drives, % of integrity-complete groups",
        f"clean: no collision, no infraction{unseen}",
        ["completed", "clean"],
        lambda s: [s.completed, s.clean],
    )
    if not study.has_evidence:
        _title(console, "Collisions and ranks are unknown: the dataset claims no risk evidence")
        return
    print_families("Drives with a collision, % of each family", "integrity-complete groups", _COLLIDED)
    print_families(f"Drives with a collision within {_WINDOW} of the branch, % of each family", "", _IN_WINDOW)
    if not study.overall.num_ranked:
        _title(console, "No ranks: in no group every candidate has a separation")
        return
    note = "by a utility that knows no collisions: the best may have hit something"
    print_families("Family of the best candidate, % of ranked groups", note, _BEST, _NUM_RANKED)
    print_families("Family of the worst candidate, % of ranked groups", "", _WORST, _NUM_RANKED)
    if len(study.branches) > 1:
        console.print()
        print_section(console, _branch_table(study))
    _print_ranking(console, study)


def _print_ranking(console: Console, study: Study) -> None:
    """What the ranks mean, and how often the best candidate collides."""
    meaning, collisions = _ranking_texts(study)
    console.print(Text(meaning, style="dim"))
    console.print(Text(collisions))


def _ranking_texts(study: Study) -> tuple[str, str]:
    rates = (study.overall.best_collided_in_window, study.overall.best_collided)
    within, ever = (_percent(rate, is_whole=_are_whole(rates)) for rate in rates)
    groups = counted(study.overall.num_ranked, "ranked group")
    collisions = f"The best candidate collides within {_WINDOW} in {within} % of {groups}, ever in {ever} %."
    return _RANKING.format(study.profile), collisions


def _rate_table(
    title: str,
    notes: Sequence[str],
    scenarios: Sequence[Scenario],
    headings: Sequence[str],
    rates: Callable[[Scenario], Sequence[Rate]],
    num_groups: Callable[[Scenario], int],
) -> Table:
    """One row for each scenario type, the last one for all; decimals only where some type has a use for them."""
    types_are_whole = _are_whole(rate for scenario in scenarios[:-1] for rate in rates(scenario))
    rows = []
    for scenario in scenarios:
        is_whole = types_are_whole and (scenario is not scenarios[-1] or _are_whole(rates(scenario)))
        cells = [_percent(rate, is_whole=is_whole) for rate in rates(scenario)]
        rows.append([label(scenario.scenario_type), f"{num_groups(scenario):,}", *cells])
    return Table(
        title, [Column.name("scenario type"), *map(Column, ("groups", *headings))], rows, notes, has_total=True
    )


def _extent(value: float | None) -> str:
    return "inf" if value is None else f"{value:.3g}"


def _print_spreads(console: Console, subject: str, spreads: Sequence[Spread]) -> None:
    num = spreads[0].num
    if not num:
        _title(console, f"No {subject} could be compared with its nominal before the branch")
        return
    whose = "its nominal" if num == 1 else "their nominals"
    title = f"Discrepancy before the branch of {counted(num, subject)} from {whose}"
    lacking = ["one side only"] if any(spread.num_infinite for spread in spreads) else []
    is_whole = _are_whole(spread.zero for spread in spreads)
    rows = [
        [
            spread.variable,
            spread.unit,
            *(_extent(value) for value in (spread.median, spread.q90, spread.q99, spread.max)),
            _percent(spread.zero, is_whole=is_whole),
            *(f"{spread.num_infinite:,}" for _ in lacking),
        ]
        for spread in spreads
    ]
    columns = [
        Column.name("variable"),
        Column("unit", is_text=True),
        *map(Column, ("median", "90 %", "99 %", "max", "zero, %", *lacking)),
    ]
    console.print()
    print_section(console, Table(title, columns, rows))


def _print_equality(console: Console, study: Study) -> None:
    text, style = _equality_text(study)
    console.print()
    console.print(Text(text, style=style))


def _equality_text(study: Study) -> tuple[str, str]:
    """Whether nominal replays repeat their nominals, and how a terminal shows it."""
    equality = study.equality
    num, unequal = equality.num_compared, equality.num_compared - equality.num_equal
    tables = ", ".join(equality.differing)
    if not num:
        text, style = "No nominal replay could be compared bit by bit with its nominal.", "yellow"
    elif not unequal:
        whose = "replay is bit-equal to its nominal" if num == 1 else "replays are bit-equal to their nominals"
        text, style = f"{'The one' if num == 1 else f'All {num:,}'} compared nominal {whose} in {tables}.", "green"
    else:
        differ = ", ".join(f"{table} {count:,}" for table, count in equality.differing.items() if count)
        whose = "differs from its nominal" if unequal == 1 else "differ from their nominals"
        text = f"{unequal:,} of {counted(num, 'compared nominal replay')} {whose}: {differ}."
        style = "yellow"
    if alone := equality.num_replays - num:
        text += f" {alone:,} more {'lacks' if alone == 1 else 'lack'} a complete nominal or "
        text += f"{'is' if alone == 1 else 'are'} not complete."
    left_out = study.population.num_groups - study.population.num_integrity_complete
    if num and left_out:
        text += " They are of all groups, also of those that are not integrity-complete."
    return text, style
