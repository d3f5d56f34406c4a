"""Pages of the rules in `docs/rules/`: what a rule demands and why, its clauses, an example, and what to do.

Sources: the catalogue, the chapters, and two files beside the pages: `areas.json` says why an area has rules, or why
one of them is there where that is another reason, and `examples.json` holds what the validator says of one defect of
every rule.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

from branchdrive.contract.generate.clause import clauses_of, judged
from branchdrive.contract.generate.region import code, grid
from branchdrive.contract.rule import AREAS, CATALOGUE, RuleInfo

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

__all__ = ["AREAS_FILE", "EXAMPLES_FILE", "rule_pages"]

AREAS_FILE = "docs/rules/areas.json"
EXAMPLES_FILE = "docs/rules/examples.json"

_SPEC = "../../spec/"
_LINK = re.compile(r"\]\((?!https?:)(?P<file>[^)#]*)(?P<anchor>#[^)]*)?\)")
_WIDTH = 110

_KINDS: Mapping[str, str] = {
    "structure": "a failure makes the dataset `invalid`: it breaks the format",
    "claim": "a failure makes the dataset `invalid`: it says something that recomputation refutes",
    "qualification": "what fails does not qualify; the dataset stays valid",
    "diagnostic": "reported, and nothing else",
}
_SCOPES: Mapping[str, str] = {
    "dataset": "the files and documents of the dataset",
    "rows": "the rows of a shard",
    "rollout": "the attempts of a shard, one by one",
    "group": "the candidates of a branch group",
    "layers": "the derived layers",
    "layer_rows": "the rows of derived layers about the attempts and groups of a shard",
}


def rule_pages(root: Path, chapters: Mapping[str, str]) -> dict[Path, str]:
    """Text of the page of every rule and of their index, by path.

    Args:
        root: The checkout.
        chapters: Texts of the chapters by file name, with all numbers.
    """
    examples, areas = (
        json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        for path in (root / EXAMPLES_FILE, root / AREAS_FILE)
    )
    clauses = _clauses(chapters)
    folder = root / "docs" / "rules"
    pages = {folder / "README.md": _index()}
    for info in CATALOGUE.values():
        pages[folder / f"{info.id}.md"] = _page(
            info, areas.get(info.id, areas.get(info.id[3:6], "")), clauses.get(info.id, []), examples.get(info.id)
        )
    return pages


def _clauses(chapters: Mapping[str, str]) -> dict[str, list[str]]:
    """Lines of a list for the clauses that every rule judges, in the order of their numbers; links lead to each."""
    lines = {
        clause.number: f"- [{clause.number}]({_SPEC}{name}#{clause.anchor}): "
        + re.sub(r":$", ", as listed there.", _relinked(clause.text.removeprefix("- "), name))
        for name, text in chapters.items()
        for clause in clauses_of(text)
    }
    found: dict[str, list[str]] = {}
    for number, entry in judged(chapters).items():
        for rule in entry.get("rules", ()):
            found.setdefault(rule, []).append(lines.get(number, ""))
    return found


def _relinked(text: str, chapter: str) -> str:
    """Text of a chapter with its links as seen from the pages."""

    def link(match: re.Match[str]) -> str:
        file, anchor = match["file"], match["anchor"] or ""
        there = f"../../{file[3:]}" if file.startswith("../") else f"{_SPEC}{file or chapter}"
        return f"]({there}{anchor})"

    return _LINK.sub(link, text)


def _page(info: RuleInfo, why: str, clauses: Sequence[str], example: Mapping[str, Any] | None) -> str:
    parts = [
        f"# {info.id}: {info.title}",
        "<!-- generated: rule -->",
        grid(["", ""], _facts(info)).rstrip(),
        *(["## Why", why] if why else []),
        "## Clauses",
        f"Section [{info.clause.removeprefix('spec/')}](../../{info.clause}). It judges, alone or with other rules:",
        "\n".join(clauses),
        *_example_parts(info, example),
        "## What to do",
        info.remedy,
        _alone(info),
        "<!-- end generated -->",
        "[All rules](README.md)",
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _alone(info: RuleInfo) -> str:
    command = f"`branchdrive-validate DATASET --select {info.id}`"
    waiver = "; where a failure is known and accepted, a [waiver](../../spec/07-rules.md#waivers) covers it"
    return f"{command} judges this rule alone, at best as `partial`{waiver if info.decides else ''}."


def _facts(info: RuleInfo) -> Iterator[list[str]]:
    # A failure of a recommendation changes nothing, whatever its kind.
    means = "a recommendation; reported, and nothing else" if info.level == "SHOULD" else _KINDS[info.kind]
    yield ["kind", f"{info.kind}: {means}"]
    yield ["looks at", _SCOPES[info.scope]]
    yield ["counts", f"{info.grain}s" if info.grain != "dataset" else "the dataset"]
    if info.stage:
        yield ["costs a group", f"the stage `{info.stage}` of the [funnel](../../spec/07-rules.md#funnel)"]
    if info.streams:
        yield ["only where claimed", f"a stream of {code(info.streams)}"]
    if info.layer:
        yield ["only where claimed", f"the layer `{info.layer}`" + (", with its raw layer" if info.needs_raw else "")]
    if info.reads:
        yield ["reads", code(info.reads)]
    if info.requires:
        yield ["after", ", ".join(f"[{rule}]({rule}.md)" for rule in info.requires)]
    if info.consequences:
        yield ["breaks with it", ", ".join(f"[{rule}]({rule}.md)" for rule in info.consequences)]


def _example_parts(info: RuleInfo, example: Mapping[str, Any] | None) -> Iterator[str]:
    if example is None:
        return
    place = " ".join(f"{key}={_short(str(value))}" for key, value in example["location"].items()) or "dataset"
    lines = [
        f"{info.id}  {info.broken}",
        f"    {place}",
        f"      expected {_short(example['expected'])}",
        f"      found    {_short(example['found'])}",
    ]
    yield "## An example"
    yield f"Of a dataset with one defect - {example['defect']} - the validator says:"
    yield "\n".join(["```text", *lines, "```"])


def _short(text: str) -> str:
    return text if len(text) <= _WIDTH else text[: _WIDTH - 3] + "..."


def _index() -> str:
    parts = [
        "# Rules",
        "<!-- generated: rules-index -->",
        f"The {len(CATALOGUE)} rules of the [catalogue](../../spec/07-rules.md#catalogue), a page for each: what it "
        "demands and why, its clauses, an example, and what to do.",
    ]
    for area, title in AREAS.items():
        rows = [
            [f"[{info.id}]({info.id}.md)", info.title, info.kind + (", recommended" if info.level == "SHOULD" else "")]
            for info in CATALOGUE.values()
            if info.id[3:6] == area
        ]
        parts += [f"## {area}: {title}", grid(["rule", "title", "kind"], rows).rstrip()]
    return "\n\n".join([*parts, "<!-- end generated -->"]) + "\n"
