"""The verbs of the Makefile are explained, by `make help` and in CONTRIBUTING.md."""

from __future__ import annotations

import re
import subprocess

from tests.repo.checkout import ROOT

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
VERBS = {verb: text for text, verb in re.findall(r"^## (.+)\n([a-z-]+):", MAKEFILE, re.M)}
"""What every verb does."""


def test_every_verb_is_explained() -> None:
    phony = re.search(r"^\.PHONY: (.+)", MAKEFILE, re.M)
    assert phony is not None
    assert sorted(VERBS) == sorted(phony[1].split())


def test_contributors_read_of_every_verb() -> None:
    table = re.findall(r"^\| `make ([a-z-]+)` \|", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.M)
    assert sorted(table) == sorted(VERBS)


def test_the_help_lists_every_verb() -> None:
    printed = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert dict(re.findall(r"^make ([a-z-]+) +(.+)", printed, re.M)) == VERBS
    variables = re.findall(r"^([A-Z]+) \?=", MAKEFILE, re.M)
    assert re.findall(r"\b([A-Z]+)=", printed) == variables
