"""The report as text, Markdown and JSON: what the validator says, then the sections."""

from __future__ import annotations

import json
from functools import partial
from io import StringIO
from typing import TextIO

from rich.console import Console
from rich.text import Text

from branchdrive.cli.formats.markdown import render as validation_markdown
from branchdrive.cli.text import render_report
from branchdrive.text.markdown import plain, section_lines
from branchdrive.text.table import Table
from branchdrive.text.terminal import print_section, render
from branchdrive_reference.report.facts import DatasetReport
from branchdrive_reference.report.section import sections

__all__ = ["render_json", "render_markdown", "render_text"]


def render_json(report: DatasetReport) -> str:
    """Everything as one document."""
    return json.dumps(report.to_json(), indent=2, sort_keys=True, allow_nan=False) + "\n"


def render_text(report: DatasetReport, stdout: TextIO, *, is_file: bool = False) -> str:
    """The report for `stdout` or a file."""
    validation = render_report(report.validation, StringIO() if is_file else stdout)
    return validation + render(partial(_print_sections, report=report), stdout, is_file=is_file)


def _print_sections(console: Console, report: DatasetReport) -> None:
    for section in sections(report):
        console.print()
        console.rule(section.title, align="left", characters="-")
        for part in section.parts:
            console.print()
            if isinstance(part, Table) or part.title:
                print_section(console, part, section.warnings)
            else:
                for paragraph in part.paragraphs:
                    console.print(Text(paragraph))


def render_markdown(report: DatasetReport) -> str:
    """The report as Markdown."""
    lines = [validation_markdown(report.validation).rstrip("\n")]
    for section in sections(report):
        lines += ["", f"# {section.title}"]
        for part in section.parts:
            if isinstance(part, Table) or part.title:
                lines += ["", *section_lines(part, section.warnings)]
            else:
                lines += [line for paragraph in part.paragraphs for line in ("", plain(paragraph))]
    return "\n".join(lines) + "\n"
