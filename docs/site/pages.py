"""Pages of the site: the repository's Markdown with what it links to, and pages that are made from other files.

Paths are those of the repository, so that relative links lead there on the site too. What GitHub's Markdown takes and
Python-Markdown does not is rewritten: links to folders and notebooks, and lists without an empty line before them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

__all__ = ["ROOT", "nav", "schemas_page", "site_files"]

ROOT = Path(__file__).resolve().parents[2]

_LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)\s#]+)")
_FENCE = re.compile(r"(^ *```.*?^ *```$)", re.DOTALL | re.MULTILINE)
_ITEM = re.compile(r"^(?:- |\d+\. )")
_HIDDEN = ("docs/site/",)

SCHEMAS = "schemas/v0.1"


def site_files() -> dict[str, bytes]:
    """Content of every file of the site by its path: pages, and what they show or link to."""
    pages = [
        *ROOT.glob("*.md"),
        *ROOT.glob("spec/*.md"),
        *ROOT.glob("docs/**/*.md"),
        ROOT / "conformance_tests/README.md",
    ]
    made = {_name(path): _page(path) for path in pages if not _name(path).startswith(_HIDDEN)}
    files = {name: text.encode() for name, text in made.items()}
    for name, text in made.items():
        for target in _links(text):
            path = (ROOT / name).parent.joinpath(target).resolve()
            if path.is_file() and path.suffix != ".md":
                files[_name(path)] = path.read_bytes()
    for path in sorted(ROOT.glob("docs/*.ipynb")):
        files[_name(path)] = path.read_bytes()
        files[_name(path.with_suffix(".md"))] = notebook_page(path).encode()
    for path in sorted((ROOT / SCHEMAS).rglob("*.json")):
        files[_name(path)] = path.read_bytes()
    files[f"{SCHEMAS}/README.md"] = schemas_page().encode()
    return files


def nav(entries: Any, names: list[str]) -> Any:
    """A navigation whose globs of pages are written out, in order of their paths."""
    if isinstance(entries, dict):
        return {title: nav(inner, names) for title, inner in entries.items()}
    if isinstance(entries, list):
        found: list[Any] = []
        for entry in entries:
            inner = nav(entry, names)
            found += inner if isinstance(inner, list) else [inner]
        return found
    matching = sorted(name for name in names if fnmatch(name, entries) and name.count("/") == entries.count("/"))
    return matching if "*" in entries else entries


def schemas_page() -> str:
    """A table of the files of the machine form."""
    lines = [
        "# Machine form",
        "",
        "Schemas, declarations and vectors of version 0.1.",
        "Where text and machine form differ, [chapter 8](../../spec/08-versioning.md#precedence) says which counts.",
        "",
        "| file | what it is |",
        "| --- | --- |",
    ]
    for path in sorted((ROOT / SCHEMAS).rglob("*.json")):
        name, schema = path.relative_to(ROOT / SCHEMAS).as_posix(), path.with_suffix(".schema.json")
        if path.name.endswith(".schema.json"):
            document = json.loads(path.read_text("utf-8"))
            words = f"{document['title']}: {document['description']}".replace("|", "\\|").replace("<", "&lt;")
        elif schema.exists():
            words = f"in the form of [{schema.name}]({schema.name})"
        else:
            words = "test vectors" if "/" in name else "a benchmark protocol"
        lines.append(f"| [{name}]({name}) | {words} |")
    return "\n".join([*lines, ""])


def notebook_page(path: Path) -> str:
    """A notebook as Markdown: texts, code, and what was printed."""
    parts = []
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", []):
            if picture := output.get("data", {}).get("image/png"):
                parts.append(f"![What the cell drew](data:image/png;base64,{picture.strip()})")
            else:
                parts.append(f"```text\n{''.join(output['text']).rstrip()}\n```")
    return "\n\n".join([*parts, f"The notebook itself: [{path.name}]({path.name})", ""])


def _page(path: Path) -> str:
    """Text of a page, rewritten for Python-Markdown."""
    parts = _FENCE.split(path.read_text("utf-8"))
    return "".join(part if i % 2 else _with_empty_lines(_relinked(part, path)) for i, part in enumerate(parts))


def _relinked(text: str, path: Path) -> str:
    def target(link: re.Match[str]) -> str:
        there = path.parent / link[1]
        if there.is_dir():
            return f"{link[1].rstrip('/')}/README.md"
        return link[1].removesuffix(".ipynb") + ".md" if there.suffix == ".ipynb" else link[1]

    return _LINK.sub(target, text)


def _with_empty_lines(text: str) -> str:
    """An empty line before a list that follows a paragraph at once."""
    lines: list[str] = []
    for line in text.split("\n"):
        before = lines[-1] if lines else ""
        if _ITEM.match(line) and before.strip() and not _ITEM.match(before) and not before.startswith(" "):
            lines.append("")
        lines.append(line)
    return "\n".join(lines)


def _links(text: str) -> Iterator[str]:
    for i, part in enumerate(_FENCE.split(text)):
        if i % 2 == 0:
            yield from (link[1] for link in _LINK.finditer(part))


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()
