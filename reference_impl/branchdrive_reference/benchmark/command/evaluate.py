"""`branchdrive evaluate`: metrics, rankings and guards of locked predictions, or of predictions of others."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from branchdrive.cli.output import check_output
from branchdrive.cli.place import local
from branchdrive.contract.layout import BENCHMARK
from branchdrive.contract.text import printable
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.command.option import (
    add_no_figures,
    add_protocol,
    add_release,
    at_work,
    bars,
    need_plots,
)

if TYPE_CHECKING:
    from rich.console import Console

    from branchdrive_reference.benchmark.evaluation import Evaluation

__all__ = ["ORDER", "SUMMARY", "add_arguments", "add_format", "format_evaluation", "render_results", "run"]

SUMMARY = "evaluate predictions on the test partition: tables, figures, and what guards promise"
ORDER = 170


def _name(text: str) -> str:
    from branchdrive_reference.learning.configuration import is_model_name

    if not is_model_name(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not up to 64 letters, digits, dots, dashes and underscores")
    return text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_release(parser, is_read_only=True)
    parser.add_argument(
        "--predictions", metavar="FILE", type=Path, help="evaluate these predictions (Parquet) beside those published"
    )
    parser.add_argument("--name", metavar="NAME", type=_name, help="name of the model that made them")
    parser.add_argument(
        "--output", metavar="DIR", type=Path, help="write results, tables and figures of --predictions there"
    )
    parser.add_argument(
        "--by-type", action="store_true", help="print regret by scenario type too; no file of the release has it"
    )
    parser.add_argument(
        "--clean-risk",
        action="store_true",
        help="learn how probable a drive is that is clean to its end, and print its calibration and choices with it",
    )
    add_no_figures(parser)
    add_format(parser)
    add_protocol(parser)


def add_format(parser: argparse.ArgumentParser) -> None:
    """What is printed."""
    parser.add_argument(
        "--format",
        choices=("text", "markdown", "json"),
        default="text",
        help="headlines as text, all tables as markdown, or all results as json (default: text)",
    )


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Evaluate and print the tables.

    Raises:
        PlatformError: An extra is not installed.
        UsageError: The options do not go together, or nothing is predicted.
        DatasetError: The release or the predictions cannot be read.
    """
    if (args.predictions is None) != (args.name is None):
        raise UsageError("`--predictions` and `--name` need each other; give both or neither")
    if args.predictions is None and args.output is not None:
        raise UsageError("`--output` needs `--predictions`; without it, results are published in the release")
    if (args.by_type or args.clean_risk) and (args.predictions is not None or args.format == "json"):
        raise UsageError(
            "`--by-type` and `--clean-risk` print tables of the published models; leave out `--predictions` and JSON"
        )
    if not args.no_figures and (args.predictions is None or args.output is not None):
        need_plots()
    if args.clean_risk:
        from branchdrive_reference.benchmark.clean_risk import need_forest

        need_forest()
    if args.predictions is None:
        from branchdrive_reference.benchmark.evaluation import evaluate_published

        release = local(args.release, "`evaluate` without `--predictions`")
        with at_work(release, args.protocol) as (workspace, protocol), bars(stderr)("evaluating") as show:
            found = evaluate_published(
                workspace,
                protocol,
                show=show,
                with_figures=not args.no_figures,
                with_types=args.by_type,
                with_clean_risk=args.clean_risk,
            )
        folder = release / BENCHMARK
    else:
        check_output(args.output, outside=args.release, is_folder=True)
        if args.output is not None and args.output.is_dir() and any(args.output.iterdir()):
            raise UsageError(f"--output: {str(args.output)!r} holds files; name a new folder, or an empty one")
        found, folder = _foreign(args), args.output
        if args.output is not None:
            kinds = "results and tables" if args.no_figures else "results, tables and figures"
            stderr.write(f"{kinds} are in {printable(str(args.output))}\n")
    stdout.write(format_evaluation(found, args.format, stdout, folder))
    return 0


def _foreign(args: argparse.Namespace) -> Evaluation:
    from branchdrive.formats.durable import replace_file
    from branchdrive_reference.benchmark.document import published_protocol, read_protocol_file
    from branchdrive_reference.benchmark.evaluation import evaluate_foreign
    from branchdrive_reference.benchmark.foreign import read_predictions
    from branchdrive_reference.benchmark.release import benchmark_data, open_release

    release = open_release(args.release)
    protocol = published_protocol(release) if args.protocol is None else read_protocol_file(args.protocol)
    data = benchmark_data(release)
    predictions = read_predictions(args.predictions, args.name, data, protocol)
    with_figures = args.output is not None and not args.no_figures
    found = evaluate_foreign(release, protocol, predictions, data, with_figures=with_figures)
    if args.output is not None:
        for path, content in found.files.items():
            place = args.output / path
            place.parent.mkdir(parents=True, exist_ok=True)
            replace_file(place, content)
    return found


def format_evaluation(found: Evaluation, form: str, stdout: TextIO, folder: Path | None) -> str:
    """The evaluation as text, Markdown or JSON; text names the folder that the tables are in, if there is one."""
    from branchdrive.text.markdown import section_lines
    from branchdrive.text.terminal import print_section, render

    if form == "text":
        said = render_results(found.results, stdout, tables=None if folder is None else str(folder / "TABLES.md"))
        return said + "".join(
            render(partial(print_section, section=section), stdout) + "\n" for section in found.printed
        )
    said = found.files["TABLES.md" if form == "markdown" else "results.json"].decode()
    warnings = found.results["warnings"]
    return said + "".join("\n" + "\n".join(section_lines(section, warnings)) + "\n" for section in found.printed)


def render_results(results: Mapping[str, Any], stdout: TextIO, *, tables: str | None = None) -> str:
    """Prediction, regret of selections and guard as text, coloured if `stdout` is a terminal.

    Args:
        results: Document ``results.json``, which conforms to its schema.
        stdout: Where the text is to go.
        tables: Path of all tables, if they are in a file.
    """
    from branchdrive.text.terminal import render

    return render(partial(_print_results, results=results, tables=tables), stdout)


def _print_results(console: Console, results: Mapping[str, Any], tables: str | None) -> None:
    from rich.text import Text

    from branchdrive.benchmark.headline import headline_sections
    from branchdrive.benchmark.shortage import inconclusive_sentence
    from branchdrive.text.terminal import print_section

    population = results["population"]
    if (sentence := inconclusive_sentence(population["groups"], population["clusters"])) is not None:
        console.print(Text(sentence, style="yellow"))
        console.print()
    for warning in results["warnings"]:
        console.print(Text(f"Warning: {printable(warning)}", style="yellow"))
    if results["warnings"]:
        console.print()
    for section in headline_sections(results):
        print_section(console, section)
        console.print()
    said = "These are the headlines; --format markdown prints all tables"
    console.print(Text(f"{said}." if tables is None else f"{said}, which are in {printable(tables)}.", style="dim"))
