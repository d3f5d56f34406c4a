"""Cases: a dataset as a recipe against a base dataset, and exactly what a validator must say of it.

Source: conformance_tests/README.md; the form is `case.schema.json`.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import UsageError
from branchdrive.runtime.environment import folder_command

__all__ = [
    "MAX_LOCATIONS", "Case", "Expectation", "Outcome", "base_expectation", "case_text", "cases_dir", "load_case",
    "load_cases", "stated_rules",
]  # fmt: skip

MAX_LOCATIONS = 10
"""Locations that a case lists for a rule; with more findings than that, a validator must list some of them."""

Kind = Literal["pass", "fail", "boundary"]

_CASES, _CASES_FOLDER = "branchdrive-conformance-cases", "conformance_tests"
"""The distribution of the cases, and the folder that it is built from."""

_CASES_PACKAGE = "branchdrive_conformance_cases"
"""What it is imported as; it holds no modules."""

_CHECKOUT_DIR = Path(__file__).resolve().parents[1] / "cases"


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
        if isinstance(document, str):
            return cls(document)
        return cls(**{**document, "locations": tuple(document["locations"])})

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
        document["expected"] = {
            "verdict": self.expected.verdict,
            "rules": stated_rules(self.expected.rules, None if base is None else base.rules),
            "free": sorted(self.expected.free),
        }
        return {key: value for key, value in document.items() if value not in (None, {})}


def stated_rules(rules: Mapping[str, Outcome], base: Mapping[str, Outcome] | None) -> dict[str, Any]:
    """Outcomes of rules as a file states them: those that differ from the base's.

    An area stands for its rules that are not named, where many of them have one status.
    """
    if base is None:
        return {rule: outcome.to_json() for rule, outcome in rules.items()}
    stated: dict[str, Any] = {}
    for area in dict.fromkeys(map(_area, rules)):
        mine = {rule: outcome for rule, outcome in rules.items() if _area(rule) == area}
        changed = {rule: outcome for rule, outcome in mine.items() if outcome != base[rule]}
        statuses = Counter(outcome.status for outcome in changed.values() if outcome.status != "fail")
        status, count = statuses.most_common(1)[0] if statuses else ("", 0)
        others = {rule: outcome for rule, outcome in mine.items() if outcome.status != status}
        if count > 1 + len(others.keys() - changed.keys()):
            stated[area], changed = status, others
        stated |= {rule: outcome.to_json() for rule, outcome in changed.items()}
    return stated


def _area(rule: str) -> str:
    return rule.rpartition("-")[0]


def _outcomes(stated: Mapping[str, Any], base: Mapping[str, Outcome]) -> dict[str, Outcome]:
    """Outcomes of all rules, from what a file states and what is expected of its base."""
    found = dict(base)
    for rule in found:
        if (outcome := stated.get(rule, stated.get(_area(rule)))) is not None:
            found[rule] = Outcome.of(outcome)
    return found


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
    """Folder of the cases of this version: of a checkout, or of their own distribution.

    Raises:
        UsageError: Neither is there.
    """
    installed = find_spec(_CASES_PACKAGE)
    places = [_CHECKOUT_DIR, *map(Path, installed.submodule_search_locations or () if installed else ())]
    for folder in places:
        if (folder / f"v{SPEC_VERSION}" / "bases").is_dir():
            return folder / f"v{SPEC_VERSION}"
    raise UsageError(
        f"no conformance cases of version {SPEC_VERSION} are installed: {folder_command(_CASES, _CASES_FOLDER)},"
        " or name a folder or an archive of them with --cases"
    )


@cache
def base_expectation(folder: Path, base: str) -> Expectation:
    """What is expected of a base dataset.

    Raises:
        UsageError: There is no such base, or it is damaged.
    """
    document = _read(folder / "bases" / f"{base}.json")
    stated = document["rules"]
    if document["parent"] is None:
        return Expectation(document["verdict"], {rule: Outcome.of(found) for rule, found in stated.items()})
    return Expectation(document["verdict"], _outcomes(stated, base_expectation(folder, document["parent"]).rules))


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
        expected = Expectation(stated["verdict"], _outcomes(stated["rules"], base.rules), frozenset(stated["free"]))
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
