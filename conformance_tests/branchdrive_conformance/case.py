"""Cases: a dataset as a recipe against a base dataset, and exactly what a validator must say of it.

Source: conformance_tests/README.md; the form is `case.schema.json`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any, Literal

from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import UsageError

__all__ = [
    "MAX_LOCATIONS", "Case", "Expectation", "Outcome", "base_expectation", "case_text", "cases_dir", "load_case",
    "load_cases",
]  # fmt: skip

MAX_LOCATIONS = 10
"""Locations that a case lists for a rule; with more findings than that, a validator must list some of them."""

Kind = Literal["pass", "fail", "boundary"]

_PACKAGE_DIR = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Outcome:
    """What is expected of one rule.

    Attributes:
        status: Its status in the report.
        violations: Violating subjects, exact.
        locations: Locations of findings in the order of the report, the first `MAX_LOCATIONS` of them.
    """

    status: str
    violations: int = 0
    locations: Sequence[Mapping[str, Any]] = ()

    @property
    def is_complete(self) -> bool:
        """Whether all locations are listed."""
        return len(self.locations) < MAX_LOCATIONS

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Outcome:
        """An outcome as a case or a base states it; a status alone is a text."""
        return cls(document) if isinstance(document, str) else cls(**document)

    def to_json(self) -> str | dict[str, Any]:
        """As a case states it."""
        if self.status != "fail":
            return self.status
        return {"status": self.status, "violations": self.violations, "locations": list(self.locations)}


@dataclass(frozen=True)
class Expectation:
    """What is expected of a report.

    Attributes:
        verdict: The verdict.
        rules: Outcome of every rule of the catalogue.
        free: Rules of whose outcome nothing is demanded: declared consequences of the one that fails.
    """

    verdict: str
    rules: Mapping[str, Outcome]
    free: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Case:
    """One dataset and what is expected of it.

    Attributes:
        name: ``RULE/name``.
        kind: Whether the rule passes on an unchanged base, must fail, or is at a limit that it must accept.
        rules: The rules that it is about, the first of which names its folder.
        what: What is special about the dataset.
        clauses: Clauses of the specification that it is about.
        base: Base dataset that the recipe changes.
        recipe: Operations, see `recipe`.
        raw: Operations on the raw dataset beside a detached release; ``None`` where it has none.
        options: Options of validation: ``waivers`` (a document), ``hash`` (false: digests are not compared).
        expected: What a validator must say.
    """

    name: str
    kind: Kind
    rules: tuple[str, ...]
    what: str
    clauses: tuple[str, ...]
    base: str
    recipe: Sequence[Mapping[str, Any]]
    expected: Expectation
    raw: Sequence[Mapping[str, Any]] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self, base: Expectation | None = None) -> dict[str, Any]:
        """As a file has it.

        Args:
            base: What is expected of the base: rules with the same outcome are then left out, as in `cases`.
        """
        document = {field.name: getattr(self, field.name) for field in fields(self)}
        rules = self.expected.rules
        changed = {rule: outcome for rule, outcome in rules.items() if base is None or outcome != base.rules[rule]}
        document["expected"] = {
            "verdict": self.expected.verdict,
            "rules": {rule: outcome.to_json() for rule, outcome in changed.items()},
            "free": sorted(self.expected.free),
        }
        return {key: value for key, value in document.items() if value not in (None, {})}


def case_text(document: Mapping[str, Any]) -> str:
    """JSON text of a case or a base: an operation, a rule, or any other member on a line.

    Names of files that are no UTF-8 hold surrogates, as Python reads them, and are escaped.
    """
    return _object({key: _value(key, value) for key, value in document.items()}, "") + "\n"


def _value(key: str, value: Any) -> str:
    if key in ("recipe", "raw") and value:
        return "[\n    " + ",\n    ".join(map(json.dumps, value)) + "\n  ]"
    if key == "expected":
        return _object({name: _value(name, member) for name, member in value.items()}, "  ")
    if key == "rules" and isinstance(value, Mapping) and value:
        return _object({rule: json.dumps(outcome) for rule, outcome in value.items()}, "    ")
    return json.dumps(value)


def _object(members: Mapping[str, str], indent: str) -> str:
    lines = ",\n".join(f"{indent}  {json.dumps(key)}: {text}" for key, text in members.items())
    return f"{{\n{lines}\n{indent}}}"


def cases_dir() -> Path:
    """Folder of the cases of this version: of an installed wheel or of a checkout.

    Raises:
        UsageError: The installation has none.
    """
    for folder in (_PACKAGE_DIR / "_cases", _PACKAGE_DIR.parent / "cases"):
        if (folder / f"v{SPEC_VERSION}" / "bases").is_dir():
            return folder / f"v{SPEC_VERSION}"
    raise UsageError(f"no conformance cases for version {SPEC_VERSION} beside {_PACKAGE_DIR}; name their folder")


@cache
def base_expectation(folder: Path, base: str) -> Expectation:
    """What is expected of a base dataset.

    Raises:
        UsageError: There is no such base, or it is damaged.
    """
    document = _read(folder / "bases" / f"{base}.json")
    return Expectation(document["verdict"], {rule: Outcome.of(found) for rule, found in document["rules"].items()})


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read: {error}") from error


def load_case(folder: Path, path: Path) -> Case:
    """The case in a file below `folder`.

    Raises:
        UsageError: The file cannot be read or is no case.
    """
    document = _read(path)
    try:
        base = base_expectation(folder, document["base"])
        stated = document["expected"]
        rules = {**base.rules, **{rule: Outcome.of(found) for rule, found in stated["rules"].items()}}
        expected = Expectation(stated["verdict"], rules, frozenset(stated["free"]))
        texts = {key: tuple(document[key]) for key in ("rules", "clauses")}
        return Case(**{**document, **texts, "expected": expected})
    except (KeyError, TypeError) as error:
        raise UsageError(f"{path} is no case: {error!r}") from error


def load_cases(folder: Path, rules: Sequence[str] = ()) -> Iterator[Case]:
    """All cases in the order of their names, or those in folders that start with one of `rules` or areas.

    Raises:
        UsageError: A file cannot be read or is no case.
    """
    for path in sorted(folder.glob("BD-*/*.json")):
        if not rules or path.parent.name.startswith(tuple(rules)):
            yield load_case(folder, path)
