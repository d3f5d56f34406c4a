"""Rules as text for people."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TextIO

from rich.console import Console
from rich.markdown import Markdown
from rich.text import Text

from branchdrive.contract.resources import rule_page_text
from branchdrive.contract.rule import AREAS, CATALOGUE, RuleInfo
from branchdrive.text.terminal import print_facts
from branchdrive.text.terminal import render as drawn

__all__ = ["render_rule", "render_rules"]


def render_rules(rules: Sequence[RuleInfo], stdout: TextIO) -> str:
    """Rules as a list, by area."""
    return drawn(partial(_print_rule_list, rules=rules), stdout)


def _print_rule_list(console: Console, rules: Sequence[RuleInfo]) -> None:
    area = None
    for info in rules:
        if info.id[3:6] != area:
            area = info.id[3:6]
            console.print(Text(AREAS[area], style="bold"))
        line = Text.assemble("  ", (info.id, "cyan"), f"  {info.kind:<13}  {info.title}")
        console.print(line, soft_wrap=True)


def render_rule(info: RuleInfo, stdout: TextIO) -> str:
    """One rule in full."""
    return drawn(partial(_print_rule, info=info), stdout)


def _print_rule(console: Console, info: RuleInfo) -> None:
    console.print(Text.assemble((info.id, "bold cyan"), f"  {info.title}"))
    facts = {
        "kind": info.kind + (f", costs a group the stage `{info.stage}`" if info.stage else ""),
        "level": info.level,
        "counted by": info.grain,
        "clause": info.clause,
        "only if claimed": ", ".join(info.streams),
        "after": ", ".join(f"{r} ({CATALOGUE[r].title})" for r in info.requires),
        "page": info.url or "",
    }
    print_facts(console, [fact for fact in facts.items() if fact[1]])
    console.print()
    console.print(Markdown(rule_page_text(info.id)))
