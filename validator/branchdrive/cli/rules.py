"""`branchdrive rules`: the catalogue as a list, or one rule in full."""

from __future__ import annotations

import argparse
from typing import TextIO

from branchdrive.errors import UsageError

SUMMARY = "list the rules, or explain one"
ORDER = 110


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("id", metavar="ID", nargs="?", help="a rule such as BD-CTL-008, or an area such as BD-CTL")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Print the list or the rule."""
    from branchdrive.cli.rules_text import render_rule, render_rules
    from branchdrive.contract.rule import CATALOGUE

    wanted = (args.id or "BD").upper()
    if wanted in CATALOGUE:
        stdout.write(render_rule(CATALOGUE[wanted], stdout))
        return 0
    listed = [info for rule_id, info in CATALOGUE.items() if rule_id.startswith(f"{wanted}-")]
    if not listed:
        raise UsageError(f"no rule is called {args.id!r}; `branchdrive rules` lists them all")
    stdout.write(render_rules(listed, stdout))
    return 0
