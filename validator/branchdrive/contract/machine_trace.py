"""Traces of the machine that wrote a text: absolute paths, hosts, times on the clock of the wall.

They tell nothing of the data, differ between equal data, and can tell who worked where. What is looked for has a
form that texts about driving do not have: a path of two parts or more, a host with a user or a port, a date with a
time of day. A bare date, a version, a relative path, a web address and a mail address are none.
Source: spec/02-time-frames-units.md#clock, spec/05-raw-streams.md#values.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.text import quote

__all__ = ["trace_mismatches", "trace_of"]

_BEFORE = r"(?:^|(?<=[\s\"'`=(,;:|\[{]))"
_YEAR, _HOUR = r"(?:19|20)\d\d", r"(?:[01]\d|2[0-3])"
_DAY = (r"(?:0[1-9]|1[0-2])", r"(?:0[1-9]|[12]\d|3[01])")
_TRACES = {
    "an absolute path": re.compile(
        rf"{_BEFORE}~?/[\w.@+-]+/[\w.@+-]|{_BEFORE}~/[\w.]|{_BEFORE}file:///?\w|(?<![A-Za-z0-9])[A-Za-z]:[\\/][\w.]"
        r"|\\\\[\w.-]+\\[\w.$-]"
    ),
    "a host": re.compile(
        rf"{_BEFORE}[a-z_][a-z0-9_-]*@[A-Za-z0-9-]+(?![A-Za-z0-9-]*\.[A-Za-z])|\blocalhost:\d"
        r"|(?<![\d.])\d{1,3}(?:\.\d{1,3}){3}:\d{2,5}(?!\d)"
    ),
    "a time on the clock": re.compile(
        rf"(?<!\d){_YEAR}-{_DAY[0]}-{_DAY[1]}[Tt _-]{_HOUR}[:._-][0-5]\d(?!\d)"
        rf"|(?<![0-9A-Za-z]){_YEAR}-?{_DAY[0]}-?{_DAY[1]}[Tt _-]?{_HOUR}[0-5]\d[0-5]\d[Zz]?(?![0-9A-Za-z])"
    ),
}
_MAY_HOLD_ONE = re.compile(r"[/\\@]|localhost:|\.\d{1,3}:\d|\d{4}-?\d\d-?\d\d")
"""What every trace holds; most texts do not, and are done with."""


def trace_of(text: str) -> str | None:
    """What trace of a machine `text` holds, in words; ``None`` if none is found."""
    if not _MAY_HOLD_ONE.search(text):
        return None
    return next((trace for trace, pattern in _TRACES.items() if pattern.search(text)), None)


def trace_mismatches(document: object, pointer: str = "") -> Iterator[Mismatch]:
    """Texts of a document that hold a trace of a machine, by pointer."""
    if isinstance(document, str):
        if trace := trace_of(document):
            yield Mismatch({"pointer": pointer or "/"}, f"a text without {trace}", quote(document))
    elif isinstance(document, dict):
        for key, member in document.items():
            yield from trace_mismatches(member, f"{pointer}/{key.replace('~', '~0').replace('/', '~1')}")
    elif isinstance(document, list):
        for index, item in enumerate(document):
            yield from trace_mismatches(item, f"{pointer}/{index}")
