"""A report as a reader gets it: its elements, its data, and the series of a group decoded from their text."""

from __future__ import annotations

import base64
import io
import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from branchdrive.cli.main import run

__all__ = ["Page", "made", "report", "whole_numbers"]


def report(*arguments: object) -> tuple[int, str, str]:
    """Exit code and outputs of `branchdrive report`."""
    stdout, stderr = io.StringIO(), io.StringIO()
    return run(["report", *map(str, arguments)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def made(dataset: Path, output: Path, *arguments: object) -> Page:
    """The report of a dataset."""
    code, _, err = report(dataset, "--output", output, *arguments)
    assert (code, err) == (0, "")
    return Page(output)


class Page(HTMLParser):
    """The elements of a page.

    Attributes:
        path: Where it is.
        content: Its bytes.
        elements: Names and attributes of all elements, in order.
        text: What a reader sees, without scripts and styles.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self.content = path.read_bytes()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: dict[str, str] = {}
        self.code = ""
        self.style = ""
        self.text = ""
        self._inside: tuple[str, str | None] | None = None
        self.feed(self.content.decode())
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.elements.append((tag, found))
        self._inside = (tag, found.get("id")) if tag in ("script", "style") else None

    def handle_endtag(self, tag: str) -> None:
        self._inside = None

    def handle_data(self, data: str) -> None:
        match self._inside:
            case ("script", None):
                self.code += data
            case ("script", str(name)):
                self.scripts[name] = data
            case ("style", _):
                self.style += data
            case _:
                self.text += data

    def of(self, tag: str) -> list[dict[str, str | None]]:
        """Attributes of all elements of a name."""
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def shared(self) -> dict[str, Any]:
        """What all groups have in common."""
        found: dict[str, Any] = json.loads(self.scripts["shared-data"])
        return found

    @property
    def groups(self) -> list[dict[str, Any]]:
        """Data of the groups that open in the page."""
        return [json.loads(text) for name, text in self.scripts.items() if name.startswith("group-data-")]


def whole_numbers(content: bytes, counts: list[tuple[int, int]]) -> list[list[int]]:
    """Series of packed numbers, by count and order of differences of each; nothing may be left."""
    stream, at, found = base64.b64decode(content), 0, []

    def token() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte = stream[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    for count, order in counts:
        values: list[int] = []
        while len(values) < count:
            number = token()
            if number == 0:
                values += [0] * (1 + token())
            else:
                values.append(-(number + 1) // 2 if number % 2 else number // 2)
        for _ in range(order):
            for place in range(1, count):
                values[place] += values[place - 1]
        found.append(values)
    assert at == len(stream)
    return found
