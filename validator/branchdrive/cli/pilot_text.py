"""The pilot report as text for people: on a terminal, where the end is seen first, and as Markdown."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TextIO

from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from branchdrive.contract.text import counted, printable
from branchdrive.pilot.report import PilotReport
from branchdrive.pilot.section import Concern, Section
from branchdrive.text.markdown import plain, section_lines
from branchdrive.text.table import Column, Table
from branchdrive.text.terminal import print_section, render

__all__ = ["pilot_markdown", "render_pilot"]

_STYLE = {"problem": "bold red", "not examined": "yellow", "advice": "yellow", "in part": "", "fine": "green"}

_SHOWN = {"in part": "fine as far as examined"}
"""Results in other words than those of programs."""


def render_pilot(report: PilotReport, stdout: TextIO, *, is_file: bool = False) -> str:
    """The report as text; sections first, then what to do."""
    return render(partial(_print, report=report), stdout, is_file=is_file)


def pilot_markdown(report: PilotReport) -> str:
    """The report as Markdown; what to do first, then the sections."""
    lines = [f"# Pilot of {plain(_name(report))}", "", _size(report), "", *section_lines(_overview(report)), ""]
    if report.concerns:
        lines += ["## To do", ""]
        for number, (section, concern) in enumerate(report.concerns, 1):
            lines.append(f"{number}. **{section.title}, {_kind(concern)}.** {_said(concern.what)}")
            lines.append(f"   *Do:* {_said(concern.remedy)}")
        lines.append("")
    for section in report.sections:
        lines += [f"## {section.title}: {_result(section)}", ""]
        for text in (*section.facts, *(f"Not examined: {reason}." for reason in _reasons(section))):
            lines += [_said(text), ""]
        for table in section.tables:
            lines += [f"#{line}" if line.startswith("## ") else line for line in section_lines(table)] + [""]
    return "\n".join([*lines, _conclusion(report)]) + "\n"


def _said(text: str) -> str:
    return plain(printable(text))


def _print(console: Console, report: PilotReport) -> None:
    console.print(Text(f"Pilot of {printable(_name(report))}", style="bold"))
    console.print(Text(_size(report)))
    for section in report.sections:
        console.print()
        _print_topic(console, section)
    console.print()
    print_section(console, _overview(report))
    if report.concerns:
        console.print()
        console.print(Text("To do", style="bold"))
        console.print(_to_do(report))
    console.print()
    console.print(Text(_conclusion(report), style="bold red" if report.num_problems else "bold"))


def _print_topic(console: Console, section: Section) -> None:
    console.print(Text.assemble((section.title, "bold underline"), ": ", (_result(section), _STYLE[section.result])))
    for fact in section.facts:
        console.print(Text(printable(fact)))
    for table in section.tables:
        console.print()
        print_section(console, table)
    if section.not_examined and (section.facts or section.tables):
        console.print()
    for reason in _reasons(section):
        console.print(Text(f"Not examined: {printable(reason)}.", style="yellow"))


def _to_do(report: PilotReport) -> Grid:
    """What is to be changed, problems first, each with its remedy."""
    grid = Grid.grid(padding=(0, 1))
    grid.add_column(justify="right")
    grid.add_column(overflow="fold")
    for number, (section, concern) in enumerate(report.concerns, 1):
        style = _STYLE["problem" if concern.is_problem else "advice"]
        head = f"{section.title}, {_kind(concern)}: "
        grid.add_row(f"{number}.", Text.assemble((head, style), printable(concern.what)))
        grid.add_row("", Text(f"Do: {printable(concern.remedy)}", style="dim"))
    return grid


def _result(section: Section) -> str:
    return _SHOWN.get(section.result, section.result)


def _kind(concern: Concern) -> str:
    return "problem" if concern.is_problem else "advice"


def _name(report: PilotReport) -> str:
    facts = report.pilot.report.dataset
    name = (
        f"{facts.dataset_id} {facts.dataset_version}" if facts.dataset_id else "a dataset with an unusable descriptor"
    )
    return f"{name} at {facts.path}"


def _size(report: PilotReport) -> str:
    facts = report.pilot.report.dataset
    return (
        f"{counted(facts.num_groups, 'branch group')}, {counted(facts.num_rollouts, 'rollout')}; forecasts are for "
        f"{counted(report.pilot.num_wanted, 'group')}"
    )


def _reasons(section: Section) -> Iterator[str]:
    return (reason.rstrip(".") for reason in section.not_examined)


def _overview(report: PilotReport) -> Table:
    rows = []
    for section in report.sections:
        num_problems = sum(concern.is_problem for concern in section.concerns)
        counts = num_problems, len(section.concerns) - num_problems, len(section.not_examined)
        rows.append([section.title, _result(section), *(f"{count}" if count else "" for count in counts)])
    heads = [
        Column.name("Section"), Column("Result", is_text=True), Column("Problems"), Column("Advice"),
        Column("Not examined"),
    ]  # fmt: skip
    return Table("Overview", heads, rows)


def _conclusion(report: PilotReport) -> str:
    num_advice = len(report.concerns) - report.num_problems
    unexamined = sum(len(section.not_examined) for section in report.sections)
    parts = [
        f"{counted(report.num_problems, 'problem')} to settle before more is collected" if report.num_problems
        else "No problem was found in what was examined",
    ]  # fmt: skip
    if num_advice:
        parts.append(f"{num_advice} pieces of advice" if num_advice > 1 else "1 piece of advice")
    if unexamined:
        parts.append(f"{counted(unexamined, 'point')} not examined")
    return ", ".join(parts) + "."
