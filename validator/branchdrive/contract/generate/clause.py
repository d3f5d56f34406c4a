"""The ledger of clauses: the number of every requirement of the chapters, and what judges it.

A clause is a line of a chapter, outside of tables and generated regions, with MUST or SHOULD in capitals. Its tag
has its number and what judges it, ``[P/C 2-14: BD-RSP-001; no rule: actors alone]``. The number is the chapter, and a
count in the chapter that says nothing of the place. A new clause is written without a number, ``[C: BD-RSP-001]``, and
gets the next free one of its chapter; a line that lost its number, in a merge say, gets it back where the stored
ledger shows the same or nearly the same words in the same section.
`schemas/v0.1/clauses.json` and `spec/clauses.md` are written from the chapters. A stored number that no chapter has
any more stays in the file until the chapter says that it is withdrawn.

Source: spec/README.md, spec/08-versioning.md#anchors.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import TYPE_CHECKING, Any

from branchdrive.contract.generate.region import code, grid
from branchdrive.contract.resources import SPEC_VERSION, load_resource

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

__all__ = [
    "ENTRIES", "LEDGER", "Clause", "clauses_of", "entries_text", "judged", "ledger_faults", "ledger_text",
    "number_clauses",
]  # fmt: skip

ENTRIES = "clauses.json"
"""Name of the machine form of the ledger in `schemas/`."""

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
    r'^<a id="(?P<anchor>[a-z0-9-]+)"></a>$'
    r"|^(?P<text>.*?) \[(?P<origin>[PVIC/]+)(?: (?P<number>\d+-\d+))?(?:: (?P<judge>[^\]]+))?\]$",
    re.MULTILINE,
)
_DEMAND = re.compile(r"(?<!level )\b(MUST|SHOULD)\b")
_WITHDRAWN = re.compile(r"- Withdrawn: (.+)\.")
_NOTE = re.compile(r"(tests|people|not recorded|no rule): (.+)")
_NEXT = re.compile(r"; (?=tests: |people: |not recorded: |no rule: )")
_RULE = re.compile(r"BD-[A-Z]{3}-\d{3}")
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
        text: Its line without the tag.
        judge: What its tag says of what judges it, empty where it says nothing.
        open: Where its number ends in the text of the chapter, or would.
    """

    number: str | None
    anchor: str
    words: str
    text: str
    judge: str
    open: int

    @property
    def entry(self) -> dict[str, Any]:
        """What judges it, in the form of the machine-readable ledger; without what cannot be read."""
        found: dict[str, Any] = {}
        for part in _NEXT.split(self.judge):
            note = _NOTE.fullmatch(part)
            if note:
                found[note[1]] = note[2].split(", ") if note[1] == "tests" else note[2]
            elif all(map(_RULE.fullmatch, part.split(", "))):
                found["rules"] = part.split(", ")
        return found

    @property
    def is_readable(self) -> bool:
        """Whether every part of its tag is a list of rules, of tests, or a reason why no rule judges it."""
        return bool(self.judge) and len(self.entry) == len(_NEXT.split(self.judge))


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
            end = match.end("number" if match["number"] else "origin")
            yield Clause(match["number"], anchor, _first_words(match["text"]), match["text"], match["judge"] or "", end)


def _withdrawn(chapter: str) -> dict[str, str]:
    """Reasons of the clauses that the text of a chapter calls withdrawn, by number."""
    notes = ((match["number"], _WITHDRAWN.fullmatch(match["text"] or "")) for match in _PLACE.finditer(chapter))
    return {number: note[1] for number, note in notes if number and note}


def judged(chapters: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """What judges every clause, by number and in the order of numbers; stored clauses that no chapter has are kept."""
    entries = dict(_stored())
    for text in chapters.values():
        entries |= {clause.number: clause.entry for clause in clauses_of(text) if clause.number}
        entries |= {number: {"withdrawn": reason} for number, reason in _withdrawn(text).items()}
    return {number: entries[number] for number in sorted(entries, key=lambda n: tuple(map(int, n.split("-"))))}


def _stored() -> Mapping[str, dict[str, Any]]:
    entries: Mapping[str, dict[str, Any]] = load_resource(ENTRIES)["clauses"]
    return entries


def entries_text(chapters: Mapping[str, str]) -> str:
    """`clauses.json`: what judges every clause, one line for each."""
    lines = ",\n".join(
        f"    {json.dumps(number)}: {json.dumps(entry, ensure_ascii=False)}"
        for number, entry in judged(chapters).items()
    )
    return f'{{\n  "version": "{SPEC_VERSION}",\n  "clauses": {{\n{lines}\n  }}\n}}\n'


def number_clauses(chapters: Mapping[str, str], ledger: str) -> dict[str, str]:
    """Texts of the chapters, by file name, in which every clause has a number.

    Args:
        chapters: Texts by file name; the name begins with the number of the chapter.
        ledger: The stored ledger, which knows the first words of the clauses that it lists.
    """
    stored = {number: (place, words) for number, place, words in _ROW.findall(ledger)}
    found = {name: list(clauses_of(text)) for name, text in chapters.items()}
    taken = {clause.number for clauses in found.values() for clause in clauses}
    known = {*taken, *stored, *_stored()} - {None}
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
            parts += [text[begin : clause.open], f" {number}"]
            begin = clause.open
        texts[name] = "".join([*parts, text[begin:]])
    return texts


def _alike(left: str, right: str) -> float:
    return SequenceMatcher(None, left, right).ratio()


def ledger_faults(chapters: Mapping[str, str]) -> list[str]:
    """What is wrong between the clauses of the chapters and the rules, one sentence for each fault."""
    rules = [declared["id"] for declared in load_resource("rules.json")["rules"]]
    clauses = [(str(int(name[:2])), clause) for name, text in chapters.items() for clause in clauses_of(text)]
    clauses = [(chapter, clause) for chapter, clause in clauses if clause.number]
    numbers = Counter(clause.number for _, clause in clauses)
    withdrawn = {number for text in chapters.values() for number in _withdrawn(text)}
    judging = {rule for _, clause in clauses for rule in clause.entry.get("rules", ())}
    return [
        *(f"clause {n} stands {count} times; give one of them no number" for n, count in numbers.items() if count > 1),
        *(
            f"clause {clause.number} is in another chapter; give it no number"
            for chapter, clause in clauses
            if (clause.number or "").split("-")[0] != chapter
        ),
        *(
            f"the tag of clause {clause.number} names no rule that judges it, no test, and no reason why none does"
            if not clause.judge
            else f"the tag of clause {clause.number} is to name rules, or tests, people, not recorded, no rule: what"
            for _, clause in clauses
            if not clause.is_readable
        ),
        *(f"clause {n} is withdrawn and stands in a chapter" for n in numbers if n in withdrawn),
        *(
            f"clauses.json has {n}, which no chapter has; say in its chapter why it is withdrawn"
            for n in _stored()
            if n not in {*numbers, *withdrawn}
        ),
        *(f"a clause names {rule}, which is not in rules.json" for rule in sorted(judging.difference(rules))),
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
    kinds = Counter(next((kind for kind in KINDS if kind in entry), "") for entry in judged(chapters).values())
    lines = [
        "# Ledger of clauses\n",
        "Every requirement of the chapters by its number, and what judges it; written by",
        "`python -m branchdrive.contract.generate` from the tags of the chapters, never edited by hand;",
        "[clauses.json](../schemas/v0.1/clauses.json) has the same for machines.",
        "A clause that rules judge in part says what is left; it counts once, under `rules`.\n",
        grid(["judged", "meaning", "clauses"], [[kind, KINDS[kind], str(kinds[kind])] for kind in KINDS]),
    ]
    for name, text in chapters.items():
        title = text.split("\n", 1)[0].removeprefix("# ")
        rows = [
            [
                f'<a id="c{clause.number}"></a>[{clause.number}]({name}#{clause.anchor})',
                clause.words,
                _judgement(clause.entry),
            ]
            for clause in clauses_of(text)
        ]
        if rows:
            lines.append(f"## {title}\n\n{grid(['clause', 'it begins', 'judged by'], rows)}")
    return "\n".join(lines)
