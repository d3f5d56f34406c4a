"""The ledger of clauses: the number of every requirement of the chapters, and what judges it.

A clause is a line of a chapter, outside of tables and generated regions, with MUST or SHOULD in capitals. Its tag
ends with its number, ``[P/C 2-14]``: the chapter, and a count in the chapter that says nothing of the place. A new
clause is written without a number and gets the next free one of its chapter; a line that lost its number, in a
merge say, gets it back where the stored ledger shows the same or nearly the same words in the same section.
`schemas/v0.1/clauses.json` says of every number what judges it; `spec/clauses.md` is written from both.

Source: spec/README.md, spec/08-versioning.md#anchors.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import TYPE_CHECKING, Any

from branchdrive.contract.generate.region import code, grid
from branchdrive.contract.resources import load_resource

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

__all__ = ["LEDGER", "Clause", "clauses_of", "ledger_faults", "ledger_text", "number_clauses"]

LEDGER = "clauses.md"
"""Name of the ledger in `spec/`."""

KINDS: Mapping[str, str] = {
    "rules": "judged by rules of the [catalogue](07-rules.md#catalogue)",
    "tests": "a demand on a program; judged by tests, here those of the reference implementation",
    "people": "judged by people, since it is about words, plans or decisions",
    "not recorded": "no recorded column could refute it",
    "no rule": "recorded columns could refute it, and no rule of this version does",
    "withdrawn": "no longer demanded; the number is not used again",
}
"""Kinds of judgement, in the order of the ledger's summary."""

_OUTSIDE = re.compile(r"<!-- generated: .*?<!-- end generated -->|^```.*?^```|^\|.*?$", re.DOTALL | re.MULTILINE)
_PLACE = re.compile(
    r'^<a id="(?P<anchor>[a-z0-9-]+)"></a>$|^(?P<text>.*?) \[(?P<origin>[PVIC/]+)(?: (?P<number>\d+-\d+))?\]$',
    re.MULTILINE,
)
_DEMAND = re.compile(r"(?<!level )\b(MUST|SHOULD)\b")
_ROW = re.compile(r'^\| <a id="c(\d+-\d+)"></a>\[.*?\]\((.*?)\) \| (.*?) \|', re.MULTILINE)
_WORDS = 12
_ALIKE = 0.6


@dataclass(frozen=True)
class Clause:
    """One requirement of a chapter.

    Attributes:
        number: Chapter and count, or None where the line has none yet.
        anchor: Anchor of the section that holds it.
        words: Its first words, as the ledger shows them.
        end: Where its line ends in the text of the chapter.
    """

    number: str | None
    anchor: str
    words: str
    end: int


def _first_words(text: str) -> str:
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text.removeprefix("- "))
    words = plain.split()
    return " ".join(words[:_WORDS]) + (" ..." if len(words) > _WORDS else "")


def clauses_of(chapter: str) -> Iterator[Clause]:
    """Clauses of the text of a chapter, in order."""
    prose = _OUTSIDE.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), chapter)
    anchor = ""
    for match in _PLACE.finditer(prose):
        if match["anchor"]:
            anchor = match["anchor"]
        elif _DEMAND.search(match["text"]):
            yield Clause(match["number"], anchor, _first_words(match["text"]), match.end())


def number_clauses(chapters: Mapping[str, str], ledger: str) -> dict[str, str]:
    """Texts of the chapters, by file name, in which every clause has a number.

    Args:
        chapters: Texts by file name; the name begins with the number of the chapter.
        ledger: The stored ledger, which knows the first words of the clauses that it lists.
    """
    stored = {number: (place, words) for number, place, words in _ROW.findall(ledger)}
    found = {name: list(clauses_of(text)) for name, text in chapters.items()}
    taken = {clause.number for clauses in found.values() for clause in clauses}
    known = {*taken, *stored, *load_resource("clauses.json")["clauses"]} - {None}
    texts = {}
    for name, text in chapters.items():
        prefix = str(int(name[:2]))
        free = max((int(n.split("-")[1]) for n in known if n and n.split("-")[0] == prefix), default=0) + 1
        parts, begin = [], 0
        for clause in found[name]:
            if clause.number:
                continue
            place = f"{name}#{clause.anchor}"
            lost = {n: words for n, (there, words) in stored.items() if there == place and n not in taken}
            number = max(lost, key=lambda n: _alike(lost[n], clause.words), default=None)
            if number is None or _alike(lost[number], clause.words) < _ALIKE:
                number, free = f"{prefix}-{free}", free + 1
            taken.add(number)
            parts += [text[begin : clause.end - 1], f" {number}"]
            begin = clause.end - 1
        texts[name] = "".join([*parts, text[begin:]])
    return texts


def _alike(left: str, right: str) -> float:
    return SequenceMatcher(None, left, right).ratio()


def ledger_faults(chapters: Mapping[str, str]) -> list[str]:
    """What is wrong between the clauses of the chapters and `clauses.json`, one sentence for each fault."""
    entries: Mapping[str, Mapping[str, Any]] = load_resource("clauses.json")["clauses"]
    rules = [declared["id"] for declared in load_resource("rules.json")["rules"]]
    numbers = Counter(clause.number for text in chapters.values() for clause in clauses_of(text) if clause.number)
    withdrawn = {number for number, entry in entries.items() if "withdrawn" in entry}
    judging = {rule for entry in entries.values() for rule in entry.get("rules", ())}
    foreign = [
        number
        for name, text in chapters.items()
        for number in (clause.number for clause in clauses_of(text))
        if number and number.split("-")[0] != str(int(name[:2]))
    ]
    return [
        *(f"clause {n} stands {count} times; give one of them no number" for n, count in numbers.items() if count > 1),
        *(f"clause {n} is in another chapter; give it no number" for n in foreign),
        *(f"clause {n} has no entry in clauses.json" for n in numbers if n not in entries),
        *(f"clause {n} is withdrawn and stands in a chapter" for n in numbers if n in withdrawn),
        *(f"clauses.json has {n}, which no chapter has" for n in entries if n not in {*numbers, *withdrawn}),
        *(f"clauses.json names {rule}, which is not in rules.json" for rule in sorted(judging.difference(rules))),
        *(f"{rule} judges no clause" for rule in rules if rule not in judging),
    ]


def _judgement(entry: Mapping[str, Any]) -> str:
    parts = []
    if "rules" in entry:
        parts.append(", ".join(f"[{rule}](07-rules.md#{rule.lower()})" for rule in entry["rules"]))
    if "tests" in entry:
        parts.append("tests: " + code(entry["tests"]))
    parts += [f"{kind}: {entry[kind]}" for kind in KINDS if isinstance(entry.get(kind), str)]
    return "; ".join(parts)


def ledger_text(chapters: Mapping[str, str]) -> str:
    """`spec/clauses.md`: how many clauses are judged in which way, and each of them with what judges it."""
    entries: Mapping[str, Mapping[str, Any]] = load_resource("clauses.json")["clauses"]
    kinds = Counter(next(kind for kind in KINDS if kind in entry) for entry in entries.values())
    lines = [
        "# Ledger of clauses\n",
        "Every requirement of the chapters by its number, and what judges it; written by",
        "`python -m branchdrive.contract.generate` from the chapters and from",
        "[clauses.json](../schemas/v0.1/clauses.json), never edited by hand.",
        "A clause that rules judge in part says what is left; it counts once, under `rules`.\n",
        grid(["judged", "meaning", "clauses"], [[kind, KINDS[kind], str(kinds[kind])] for kind in KINDS]),
    ]
    for name, text in chapters.items():
        title = text.split("\n", 1)[0].removeprefix("# ")
        rows = [
            [
                f'<a id="c{clause.number}"></a>[{clause.number}]({name}#{clause.anchor})',
                clause.words,
                _judgement(entries.get(clause.number or "", {})),
            ]
            for clause in clauses_of(text)
        ]
        if rows:
            lines.append(f"## {title}\n\n{grid(['clause', 'it begins', 'judged by'], rows)}")
    return "\n".join(lines)
