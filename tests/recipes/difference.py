"""The recipe that leads from one dataset to another: the inverse of `recipe.apply_recipe`."""

from __future__ import annotations

import base64
import json
import stat
import zlib
from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

import jsonpatch
from tests.recipes.byte_difference import parts_between
from tests.recipes.table_difference import TablesAlike, table_operations

from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive_conformance.recipe import Operation, sealed_digests

__all__ = ["manifest_edits", "recipe_between", "templated", "tree"]

_MIN_COPIED_BYTES = 200
"""Files of fewer bytes are written out, though another one is the same."""

_MAX_TEXT_BYTES = 20_000
"""Files of text up to this size are written out."""


def tree(root: Path) -> dict[str, tuple[str, str]]:
    """Kind of everything below `root` by path, and the target of links; folders that are not empty are left out."""
    found: dict[str, tuple[str, str]] = {}
    for path in sorted(root.rglob("*")):
        mode = path.lstat().st_mode
        name = path.relative_to(root).as_posix()
        if stat.S_ISLNK(mode):
            found[name] = "link", str(path.readlink())
        elif stat.S_ISDIR(mode):
            if not any(path.iterdir()):
                found[name] = "folder", ""
        else:
            found[name] = ("file" if stat.S_ISREG(mode) else "fifo"), ""
    return found


def recipe_between(base: Path, changed: Path, *, takes_rows: bool = True) -> list[Operation]:
    """Operations that make of the files of `base` those of `changed`, manifests left out.

    Args:
        base: A dataset.
        changed: Another one.
        takes_rows: Whether tables may take rows of other ones, which are those of a base dataset.

    Raises:
        pyarrow.ArrowException: A table of `base` cannot be read.
    """
    return list(_operations(base, changed, takes_rows))


def _operations(base: Path, changed: Path, takes_rows: bool) -> Iterator[Operation]:
    before, after = tree(base), tree(changed)
    for entries in (before, after):
        entries.pop(MANIFEST_FILE, None)
    alike = TablesAlike(base, [path for path in before if path.endswith(".parquet")] if takes_rows else [])
    copies = {
        path: _origin(base, changed, path, alike)
        for path, (kind, _) in after.items()
        if kind == "file" and path not in before
    }
    moved = _moved(base, before, changed, after)
    origin = {path: source for path, source in copies.items() if source is not None and path not in moved.values()}
    yield from ({"op": "copy", "path": source, "to": path} for path, source in origin.items())
    yield from ({"op": "move", "path": path, "to": to} for path, to in moved.items())
    before = {moved.get(path, path): entry for path, entry in before.items()}
    before |= dict.fromkeys(origin, ("file", ""))
    origin |= {to: path for path, to in moved.items()}
    for path in before:
        if path not in after:
            below = any(other.startswith(f"{path}/") for other in after)
            if before[path][0] != "folder" or not below:
                yield {"op": "delete", "path": path}
        elif before[path] != after[path]:
            yield {"op": "delete", "path": path}
    for path, (kind, target) in after.items():
        if kind == "file":
            old = (base / origin.get(path, path)).read_bytes() if before.get(path, ("",))[0] == "file" else None
            new = (changed / path).read_bytes()
            if old != new:
                yield from _of_file(path, old, new, alike)
        elif before.get(path) != (kind, target):
            yield {"op": kind, "path": path, **({"target": target} if kind == "link" else {})}


Tree = dict[str, tuple[str, str]]


def _moved(base: Path, before: Tree, changed: Path, after: Tree) -> dict[str, str]:
    """Files that have another name in the other dataset, each with that name."""
    gone = {path: (base / path).read_bytes() for path in before if path not in after and before[path][0] == "file"}
    found: dict[str, str] = {}
    for path in after if gone else ():
        if path not in before and after[path][0] == "file":
            content = (changed / path).read_bytes()
            same = next((old for old in gone if gone[old] == content and old not in found), None)
            if same is not None:
                found[same] = path
    return found


def _origin(base: Path, changed: Path, path: str, alike: TablesAlike) -> str | None:
    """The file of the base that a new one is made from: the same one, or a table with the same columns."""
    content = (changed / path).read_bytes()
    if len(content) < _MIN_COPIED_BYTES:
        return None
    files = (place for place in sorted(base.rglob("*")) if place.is_file() and not place.is_symlink())
    same = (place for place in files if place.stat().st_size == len(content) and place.read_bytes() == content)
    found = next((place.relative_to(base).as_posix() for place in same), None)
    return found or (next(iter(alike.of(content)), None) if path.endswith(".parquet") else None)


def _of_file(path: str, old: bytes | None, new: bytes, alike: TablesAlike) -> Sequence[Operation]:
    """The shortest operations that make the file; those that say less of what changes count twice."""
    plain: list[Sequence[Operation]] = []
    other: list[Sequence[Operation]] = []
    whole = _whole(path, new)
    (plain if old is None else other).append([whole])
    if old is not None:
        if path.endswith(".parquet") and (found := table_operations(path, old, new, alike)) is not None:
            plain.append(found)
        if path.endswith(".json"):
            plain += _of_document(path, old, new)
        if _is_text(old) and _is_text(new):
            edits = _line_edits(_lines(old.decode()), _lines(new.decode()))
            (other if path.endswith(".json") else plain).append([{"op": "lines", "file": path, "edits": edits}])
        elif len(plain) == 0:
            other.append([{"op": "splice", "file": path, "parts": parts_between(old, new)}])
    ways = [(1, operations) for operations in plain] + [(2, operations) for operations in other]
    return min(ways, key=lambda way: way[0] * sum(map(_size, way[1])))[1]


def _is_text(content: bytes) -> bool:
    try:
        return "\0" not in content.decode()
    except UnicodeDecodeError:
        return False


def _whole(path: str, content: bytes) -> Operation:
    if _is_text(content) and len(content) <= _MAX_TEXT_BYTES:
        return {"op": "text", "file": path, "text": content.decode()}
    return {"op": "bytes", "file": path, "base64": base64.b64encode(zlib.compress(content, 9)).decode()}


def _size(operation: Operation) -> int:
    return len(json.dumps(operation))


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def _line_edits(old: Sequence[str], new: Sequence[str]) -> list[list[Any]]:
    start = next((i for i, (one, other) in enumerate(zip(old, new, strict=False)) if one != other), None)
    start = min(len(old), len(new)) if start is None else start
    most = min(len(old), len(new)) - start
    alike = next((i for i in range(most) if old[-1 - i] != new[-1 - i]), most)
    matcher = SequenceMatcher(None, old[start : len(old) - alike], new[start : len(new) - alike], autojunk=False)
    found = [opcode for opcode in matcher.get_opcodes() if opcode[0] != "equal"]
    return [[start + i, start + j, list(new[start + k : start + m])] for _, i, j, k, m in found]


def _of_document(path: str, old: bytes, new: bytes) -> list[list[Operation]]:
    try:
        before, after = json.loads(old), json.loads(new)
        if dump_json(after) != new:
            return []
    except (ValueError, RecursionError):
        return []
    return [[{"op": "json", "file": path, "patch": jsonpatch.make_patch(before, after).patch}]]


# Manifests


def templated(root: Path, digests: dict[str, str]) -> list[str]:
    """Lines of the manifest at `root`, digests of it that are right as placeholders."""
    lines = (root / MANIFEST_FILE).read_bytes().decode().splitlines(keepends=True)
    owner = {digest: name for name, digest in reversed(digests.items())}
    result = []
    for line in lines:
        for digest, name in owner.items():
            own = f"{{sha256 {line[66:].rstrip()}}}"
            if digest in line:
                line = line.replace(digest, own if digests.get(own) == digest else name)
        result.append(line)
    return result


def manifest_edits(sealed: Path, changed: Path) -> list[list[Any]]:
    """Edits of lines that make the manifest of `changed` of that of `sealed`, whose files are the same."""
    digests = sealed_digests(sealed)
    return _line_edits(templated(sealed, digests), templated(changed, digests))
