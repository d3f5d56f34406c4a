"""What the validator says of one defect of every rule, for the pages of the rules.

``python -m tests.rule_examples`` writes `docs/rules/examples.json` from the first mutant of every rule;
the test of that mutant says whether it is still true. Rule ids behind the command write those alone.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.mutation import MUTANTS, Mutant, new_draft
from tests.validator.engine.rules.case import judged

from branchdrive.contract.generate.page import EXAMPLES_FILE
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.report import Report

__all__ = ["EXAMPLE_MUTANTS", "example", "without_numbers"]

EXAMPLES_PATH = Path(__file__).parents[1] / EXAMPLES_FILE

_DIGEST = re.compile(r"(?<![.\w])[0-9a-f]{12,}\b")
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")

EXAMPLE_MUTANTS: Mapping[str, Mutant] = {mutant.rule: mutant for mutant in reversed(MUTANTS)}
"""The first mutant of every rule."""


def example(mutant: Mutant, report: Report) -> dict[str, Any]:
    """The defect in words, and the finding of it; digests depend on writers and are left out."""
    finding = next(f for f in report.findings if f.rule == mutant.rule and mutant.at.items() <= f.location.items())
    return {
        "defect": mutant.name.replace("_", " "),
        "location": {
            key: _plain(value) if isinstance(value, str) else value for key, value in finding.location.items()
        },
        "expected": _plain(finding.expected),
        "found": _plain(finding.found),
    }


def _plain(text: str) -> str:
    return _DIGEST.sub("DIGEST", text)


def without_numbers(value: Any) -> Any:
    """An example with its numbers taken out of its words, whose last digits depend on libraries."""
    words = {key: _NUMBER.sub("N", value[key]) for key in ("expected", "found")}
    return {**value, **words}


def main(rules: Iterable[str]) -> None:
    """Write the examples of these rules, of all where none is named."""
    wanted = list(rules) or list(EXAMPLE_MUTANTS)
    found = json.loads(EXAMPLES_PATH.read_text("utf-8")) if EXAMPLES_PATH.is_file() else {}
    for rule in wanted:
        mutant = EXAMPLE_MUTANTS[rule]
        with TemporaryDirectory() as folder:
            draft = new_draft(mutant.base)
            mutant.edit(draft)
            found[rule] = example(mutant, judged(draft, Path(folder)))
    ordered = {rule: found[rule] for rule in CATALOGUE if rule in found}
    EXAMPLES_PATH.parent.mkdir(exist_ok=True)
    EXAMPLES_PATH.write_text(json.dumps(ordered, indent=2) + "\n", "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
