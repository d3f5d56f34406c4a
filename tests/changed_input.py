"""Files of strangers with one change each, and how a command must end on them: in words, and never in a traceback."""

from __future__ import annotations

import io
import json
import random
from collections.abc import Iterator
from pathlib import Path

from tests.validator.contract.changing import changed, sample

from branchdrive.cli.main import run
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest

__all__ = ["changed_contents", "poor_end", "poor_ends"]


def changed_contents(name: str, content: bytes, size: int) -> Iterator[tuple[str, bytes]]:
    """A sample of changes of a file, always the same: what was changed, and the content then."""
    if name.endswith(".json"):
        document = json.loads(content)
        for place, new in sample(name, document, size):
            yield f"{place} {new!r:.60}", json.dumps(changed(document, place, new)).encode()
        return
    lines = content.decode().splitlines(keepends=True)
    others = [(i, other) for i, line in enumerate(lines) for other in changed_lines(line)]
    for i, other in random.Random(f"changes of {name}").sample(others, min(size, len(others))):
        yield f"line {i} {other!r:.60}", "".join([*lines[:i], other, *lines[i + 1 :]]).encode()


def changed_lines(line: str) -> tuple[str, ...]:
    """What may stand in the place of a line of a manifest."""
    digest, path = line[:66], line[66:]
    swapped = f"{line[:-2]}0\n"
    return ("", "\n", line * 2, line.replace("  ", " "), line.upper(), f"x{line}", swapped, line.replace("/", "//"),
            f"{digest}../{path}", f"{digest}{'x' * 5000}\n", f"{digest}\u00e9\u202e\n", "\x00\n")  # fmt: skip


def poor_end(*argv: object) -> str:
    """What is wrong with the end of a command on data that is not its fault; empty if nothing is."""
    stdout, stderr = io.StringIO(), io.StringIO()
    code = run([str(argument) for argument in argv], stdout, stderr)
    message = stderr.getvalue()
    *notes, last = message.splitlines() or [""]
    is_sentence = last.startswith("branchdrive: ") and last.isprintable() and len(last) < 2000
    is_sentence &= not any(line.startswith("branchdrive: ") or not line.isprintable() for line in notes)
    return "" if code in (0, 1, 3) or (code == 2 and is_sentence) else f"{argv[0]} ended with {code}: {message[-600:]}"


def poor_ends(root: Path, path: str, size: int, *commands: tuple[object, ...]) -> list[str]:
    """How commands end poorly on a dataset whose file at `path` is changed, with a manifest that agrees."""
    original, found = (root / path).read_bytes(), []
    for what, content in changed_contents(f"{commands[0][0]} {path}", original, size):
        (root / path).write_bytes(content)
        if path != MANIFEST_FILE:
            write_manifest(Folder(root), build_manifest(Folder(root)))
        found += [f"{path} {what}: {end}" for command in commands if (end := poor_end(*command))]
    (root / path).write_bytes(original)
    return found
