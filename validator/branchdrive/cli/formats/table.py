"""The forms that a report can be written in.

A form is a module with `render(report) -> str`, which is loaded when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from branchdrive.engine.report import Report

__all__ = ["FORMATS", "Output", "outputs", "renderer"]

FORMATS: Mapping[str, str] = MappingProxyType(
    {
        "text": "branchdrive.cli.text",
        "json": "branchdrive.cli.formats.document",
        "github": "branchdrive.cli.formats.github",
        "sarif": "branchdrive.cli.formats.sarif",
        "junit": "branchdrive.cli.formats.junit",
        "markdown": "branchdrive.cli.formats.markdown",
    }
)
"""Module of every form, by its name."""


class Output(NamedTuple):
    """A file that a report goes to, and its form; ``None`` is the one of `--format`."""

    path: Path
    form: str | None


def renderer(form: str) -> Callable[[Report], str]:
    """The function that writes a report in a form."""
    render: Callable[[Report], str] = import_module(FORMATS[form]).render
    return render


def outputs(places: list[str]) -> list[Output]:
    """What `--output` asks for, each `FORMAT=FILE` or a file alone.

    Raises:
        UsageError: Two reports would go to one file.
    """
    found = []
    for place in places:
        name, equals, path = place.partition("=")
        found.append(Output(Path(path), name) if equals and name in FORMATS else Output(Path(place), None))
    for i, output in enumerate(found):
        if any(output.path.absolute() == other.path.absolute() for other in found[:i]):
            raise UsageError(f"--output: {str(output.path)!r} is named twice; give every report a file of its own")
    return found
