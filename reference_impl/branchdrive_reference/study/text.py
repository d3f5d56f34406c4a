"""A study as text for people: tables that fit 100 columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from io import StringIO
from operator import attrgetter
from typing import TextIO, TypeAlias

from rich.console import Console
from rich.table import Table
from rich.text import Text

from branchdrive.contract.timing import ACTIVE_TICKS, TICK_S
from branchdrive_reference.study.study import Population, Rate, Scenario, Spread, Study

__all__ = ["render_study"]

_PLAIN_WIDTH = 100
_NOTHING = "-"
Shares: TypeAlias = Callable[[Scenario], Mapping[str, Rate]]
_COLLIDED: Shares = attrgetter("collided")
_IN_WINDOW: Shares = attrgetter("collided_in_window")
_BEST: Shares = attrgetter("best")
_WORST: Shares = attrgetter("worst")
_NUM_GROUPS: Callable[[Scenario], int] = attrgetter("num_groups")
_NUM_RANKED: Callable[[Scenario], int] = attrgetter("num_ranked")

_WINDOW = f"{ACTIVE_TICKS * TICK_S:g} s"


def render_study(study: Study, stdout: TextIO, *, is_file: bool = False) -> str:
    """The study as text, coloured if `stdout` is a terminal and the text goes there."""
    buffer = StringIO()
    is_terminal = stdout.isatty() and not is_file
    width = Console(file=stdout).width if is_terminal else _PLAIN_WIDTH
    console = Console(file=buffer, force_terminal=is_terminal, width=width, highlight=False, emoji=False)
    console.print(Text(f"{study.dataset_id} {study.dataset_version}", style="bold"))
    _print_population(console, study.population)
    _print_outcomes(console, study)
    _print_spreads(console, "interventions", study.interventions)
    _print_spreads(console, "nominal replays", study.nominal_replays)
    _print_equality(console, study)
    return "\n".join(line.rstrip(" ") for line in buffer.getvalue().split("\n"))


def _title(console: Console, title: str, note: str = "") -> None:
    console.print()
    console.print(Text(title, style="bold"))
    if note:
        console.print(Text(note, style="dim"))


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for column, heading in enumerate(headings):
        table.add_column(Text(heading), justify="right" if column else "left", overflow="fold")
    return table


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count:,}" for name, count in counts.items())


def _print_population(console: Console, population: Population) -> None:
    lacking = population.num_groups - population.num_complete_banks
    skipped = f"; {lacking:,} skipped below" if lacking else ""
    if population.num_without_nominal:
        skipped += f", {population.num_without_nominal:,} of them for want of a good nominal"
    hours = population.num_ticks * TICK_S / 3600
    facts = {
        "branch groups": f"{population.num_groups:,}, {population.num_complete_banks:,} with a complete bank{skipped}",
        "scenario types": f"{len(population.scenario_types):,}: {_listed(population.scenario_types)}",
        "towns": f"{len(population.towns):,}: {_listed(population.towns)}",
        "route clusters": f"{population.num_route_clusters:,}",
        "attempts": f"{sum(population.attempts.values()):,}: {_listed(population.attempts)}",
        "ticks": f"{population.num_ticks:,}, {hours:,.1f} hours of driving",
    }
    _title(console, "Population")
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in facts.items():
        table.add_row(Text(name, style="dim"), Text(value))
    console.print(table)


def _percent(rate: Rate) -> str:
    """A share in per cent; what is not quite none or all never reads as if it were."""
    if rate is None:
        return _NOTHING
    if 0 < rate < 0.0005:
        return "<0.1"
    if 0.9995 <= rate < 1 - 1e-12:
        return ">99.9"
    return f"{100 * rate:.1f}"


def _print_outcomes(console: Console, study: Study) -> None:
    unseen = f"; not always monitored: {', '.join(study.not_monitored)}" if study.not_monitored else ""
    rows = [*study.scenarios, study.overall]
    families = list(study.overall.best)
    _title(console, "Nominal drives, % of groups with a complete bank", f"clean: no collision, no infraction{unseen}")
    _print_rows(
        console,
        rows,
        ["completed", "clean"],
        lambda s: [_percent(s.completed), _percent(s.clean)],
        lambda s: s.num_groups,
    )
    if not study.has_evidence:
        _title(console, "Collisions and ranks are unknown: the dataset claims no risk evidence")
        return
    headings = [family.replace("_", "\n") for family in families]
    groups = "groups with a complete bank"
    ranked = f"utility profile {study.profile}; groups in which every candidate has a separation; ties are shared"
    for title, note, shares, num_groups in (
        ("Drives with a collision, % of each family", groups, _COLLIDED, _NUM_GROUPS),
        (f"Drives with a collision within {_WINDOW} of the branch, % of each family", "", _IN_WINDOW, _NUM_GROUPS),
        ("Family of the best candidate, % of ranked groups", ranked, _BEST, _NUM_RANKED),
        ("Family of the worst candidate, % of ranked groups", "", _WORST, _NUM_RANKED),
    ):
        _title(console, title, note)

        def cells(scenario: Scenario, shares: Shares = shares) -> list[str]:
            return [_percent(shares(scenario)[family]) for family in families]

        _print_rows(console, rows, headings, cells, num_groups)


def _print_rows(
    console: Console,
    scenarios: Sequence[Scenario],
    headings: Sequence[str],
    cells: Callable[[Scenario], Sequence[str]],
    num_groups: Callable[[Scenario], int],
) -> None:
    """One row for each scenario type, the last one for all."""
    table = _table("scenario type", "groups", *headings)
    for scenario in scenarios:
        style = "bold" if scenario is scenarios[-1] else ""
        row = [scenario.scenario_type, f"{num_groups(scenario):,}", *cells(scenario)]
        table.add_row(*(Text(cell, style=style) for cell in row))
    console.print(table)


def _print_spreads(console: Console, subjects: str, spreads: Sequence[Spread]) -> None:
    _title(console, f"Discrepancy before the branch of {spreads[0].num:,} {subjects} from their nominals")
    if not spreads[0].num:
        return
    lacking = ["one side only"] if any(spread.num_infinite for spread in spreads) else []
    table = _table("variable", "unit", "median", "90 %", "99 %", "max", "zero, %", *lacking)
    for spread in spreads:
        quantiles = (spread.median, spread.q90, spread.q99, spread.max)
        table.add_row(
            spread.variable,
            spread.unit,
            *("inf" if value is None else f"{value:.3g}" for value in quantiles),
            _percent(spread.zero),
            *(f"{spread.num_infinite:,}" for _ in lacking),
        )
    console.print(table)


def _print_equality(console: Console, study: Study) -> None:
    equality = study.equality
    tables = ", ".join(equality.differing)
    console.print()
    if not equality.num_compared:
        said, style = "No nominal replay could be compared bit by bit with its nominal.", "yellow"
    elif equality.num_equal == equality.num_compared:
        said = f"All {equality.num_compared:,} compared nominal replays are bit-equal to their nominals in {tables}."
        style = "green"
    else:
        differ = ", ".join(f"{table} {count:,}" for table, count in equality.differing.items() if count)
        unequal = f"{equality.num_compared - equality.num_equal:,} of {equality.num_compared:,}"
        said = f"{unequal} compared nominal replays differ from their nominals: {differ}."
        style = "yellow"
    alone = equality.num_replays - equality.num_compared
    if alone:
        said += f" {alone:,} more lack a complete nominal or are not complete."
    console.print(Text(said, style=style))
