"""`branchdrive-conformance`: hold a validator against the cases, or write them out as plain datasets."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from rich.console import Console

from branchdrive.cli.output import check_output
from branchdrive.cli.progress import progress_bar
from branchdrive.cli.validate import at_least
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import counted
from branchdrive.errors import UsageError
from branchdrive.formats.durable import replace_file
from branchdrive.runtime.process import python_command
from branchdrive.text.table import Column, Table
from branchdrive.text.terminal import print_section, render
from branchdrive_conformance.archive import unpacked
from branchdrive_conformance.case import Case, cases_dir, load_cases
from branchdrive_conformance.materialize import materialize
from branchdrive_conformance.validator import Command, Result, run_cases

SUMMARY = "hold a validator against the conformance cases"

_SHOWN = 20
"""Departures that the text lists."""

_MEANING = {
    (True, False): "conforms",
    (True, True): "conforms in all cases that it could be given",
    (False, False): "does not conform",
    (False, True): "does not conform",
}
"""What it means whether all cases are right, and whether some were left out."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    judge = verbs.add_parser("validator", help="run a validator over the cases and score what it says")
    judge.add_argument(
        "--command", metavar="LINE", help='such as "my-validator {dataset}", see the README; default: this project\'s'
    )
    judge.add_argument("--claims", metavar="RULE", action="append", help="rules or areas it claims (repeatable)")
    judge.add_argument(
        "--limit-s", metavar="S", type=at_least(1), default=120, help="seconds for a case (default: 120)"
    )
    judge.add_argument("--jobs", metavar="N", type=at_least(1), default=1, help="commands at once (default: 1)")
    judge.add_argument("--format", choices=("text", "json"), default="text", help="what to print (default: text)")
    judge.add_argument("--output", metavar="FILE", type=Path, help="write it there instead of to the terminal")
    write = verbs.add_parser("materialize", help="write the cases as plain datasets")
    write.add_argument("folder", metavar="FOLDER", type=Path, help="a new folder")
    for verb in (judge, write):
        verb.add_argument("--cases", metavar="PLACE", type=Path, help="folder or archive of cases (default: installed)")
        verb.add_argument(
            "--select", metavar="RULE", action="append", default=[], help="only cases of these rules or areas"
        )


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Carry the verb out; 0 where a validator is right in every case, 1 where it is not.

    Raises:
        UsageError: A place, a rule or a command cannot be used.
    """
    selected = _rules(args.select)
    with _cases(args.cases) as folder:
        cases = list(load_cases(folder, selected))
        if not cases:
            raise UsageError("no case is left; name rules or areas of the catalogue")
        if args.verb == "materialize":
            return _materialize(folder, cases, args.folder, stdout, stderr)
        return _judge(folder, cases, args, stdout, stderr)


@contextmanager
def _cases(place: Path | None) -> Iterator[Path]:
    if place is None:
        yield cases_dir()
    elif place.is_dir():
        if not (place / "bases").is_dir():
            raise UsageError(f"--cases: {str(place)!r} holds no base datasets; name the folder of a version")
        yield place
    else:
        with unpacked(place) as folder:
            yield folder


def _rules(names: Sequence[str]) -> list[str]:
    """Rules that names of rules or areas stand for."""
    found = []
    for name in names:
        prefix = name if name.startswith("BD-") else f"BD-{name}"
        rules = [rule for rule in CATALOGUE if rule == prefix or rule.startswith(f"{prefix}-")]
        if not rules:
            raise UsageError(f"{name!r} is no rule and no area of the catalogue")
        found += rules
    return found


def _materialize(folder: Path, cases: Sequence[Case], target: Path, stdout: TextIO, stderr: TextIO) -> int:
    if target.exists():
        raise UsageError(f"{str(target)!r} exists; name a new folder")
    with progress_bar(stderr, "writing cases") as progress:
        for done, case in enumerate(cases, start=1):
            materialize(folder, case, target / case.name)
            progress(done, len(cases))
    stdout.write(f"{counted(len(cases), 'case')} written to {target}\n")
    return 0


def _judge(folder: Path, cases: Sequence[Case], args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    check_output(args.output)
    claimed = frozenset(_rules(args.claims) if args.claims else CATALOGUE)
    words = python_command("-m", "branchdrive_conformance.reference", "{cases}")
    command = Command(tuple(words), args.limit_s) if args.command is None else Command.of(args.command, args.limit_s)
    about = [case for case in cases if claimed & set(case.rules)]
    if not about:
        raise UsageError("no case is about a rule that is claimed")
    with progress_bar(stderr, "running cases") as progress:
        result = run_cases(folder, about, command, claimed=claimed, jobs=args.jobs, progress=progress)
    if args.format == "json":
        text = json.dumps(_document(result, about), indent=2) + "\n"
    else:
        text = render(lambda console: _print(console, result, about), stdout, is_file=args.output is not None)
    if args.output is None:
        stdout.write(text)
    else:
        replace_file(args.output, text.encode())
    return 0 if result.is_right else 1


def _document(result: Result, cases: Sequence[Case]) -> dict[str, object]:
    return {
        "right": result.is_right,
        "claimed": sorted(result.claimed),
        "num_cases": len(cases),
        "num_right": result.num_right,
        "left_out": list(result.left_out),
        "cases": {name: [vars(departure) for departure in found] for name, found in result.departures.items()},
    }


def _print(console: Console, result: Result, cases: Sequence[Case]) -> None:
    areas: dict[str, list[Case]] = {}
    for case in cases:
        areas.setdefault(case.rules[0][3:6], []).append(case)
    rows = [[area, *_counts(result, found)] for area, found in areas.items()]
    columns = [
        Column.name("Area", is_code=True), Column("Rules"), Column("Cases"), Column("Right"), Column("Verdict wrong"),
        Column("Status wrong"), Column("Count wrong"), Column("Place wrong"), Column("No report"), Column("Left out"),
    ]  # fmt: skip
    table = Table("Conformance", columns, [*rows, ["All", *_counts(result, cases)]], has_total=True)
    print_section(console, table)
    departures = [departure for found in result.departures.values() for departure in found]
    for departure in departures[:_SHOWN]:
        subject = f"{departure.rule} " if departure.rule else ""
        line = f"{departure.case}: {subject}{departure.what}: expected {departure.expected}; found {departure.found}"
        console.print(line, markup=False)
    if len(departures) > _SHOWN:
        console.print(f"... and {len(departures) - _SHOWN} more (--format json lists all)", markup=False)
    if result.left_out:
        reason = "because the command takes neither {options} nor {cases}"
        named = ", ".join(result.left_out[:5])
        console.print(f"{counted(len(result.left_out), 'case')} left out, {reason}: {named}", markup=False)
    console.print(
        f"{result.num_right} of {counted(len(cases), 'case')} right, {counted(len(result.claimed), 'rule')} claimed of"
        f" {len(CATALOGUE)}: {_MEANING[result.is_right, bool(result.left_out)]}",
        style="green" if result.is_right else "red",
        markup=False,
    )


def _counts(result: Result, cases: Sequence[Case]) -> list[str]:
    found = [result.departures[case.name] for case in cases if case.name in result.departures]
    wrong = [
        sum(any(departure.what == what for departure in departures) for departures in found)
        for what in ("verdict", "status", "count", "location", "no report")
    ]
    rules = {rule for case in cases for rule in case.rules[:1]}
    numbers = [len(rules), len(cases), sum(not departures for departures in found), *wrong, len(cases) - len(found)]
    return [f"{number:,}" if number or place < 3 else "" for place, number in enumerate(numbers)]
