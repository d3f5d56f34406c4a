"""What depends on the action bank: colours of candidates as a style sheet, and what all groups of a page share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.cli.formats.outcome import Level
from branchdrive.contract.bank import ActionBank
from branchdrive.contract.rule import CATALOGUE
from branchdrive_reference.drawing.palette import Rgb, candidate_colours
from branchdrive_reference.report.encode import STEPS
from branchdrive_reference.report.roads import STEP_M
from branchdrive_reference.study.label import label

__all__ = ["families", "palette", "shared_data"]


def _hex(colour: Rgb) -> str:
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in colour)


def _for_dark(colour: Rgb) -> Rgb:
    """The colour on dark ground: the darker, the more it is lightened."""
    red, green, blue = colour
    light = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    share = min(max(0.72 - light, 0.0), 0.9) if max(colour) - min(colour) > 0.1 else 0.95
    return red + share * (1 - red), green + share * (1 - green), blue + share * (1 - blue)


def palette(bank: ActionBank) -> str:
    """Colours of candidates and families as a style sheet: hue by family, darker with magnitude."""
    colours = candidate_colours(bank)
    lines, family_lines = [], []
    names = families(bank)
    for index, policy in enumerate(bank.policies):
        colour = colours[policy.key]
        lines.append(f"--c{index}: light-dark({_hex(colour)}, {_hex(_for_dark(colour))});")
        family_lines.append(f".c{index} {{ stroke: var(--c{index}); }}")
    for name, index in names.items():
        members = [i for i, policy in enumerate(bank.policies) if policy.family == name]
        family_lines.append(f".f{index} {{ stroke: var(--c{members[len(members) // 2]}); }}")
    actors = [f".{name} {{ fill: var(--{name}); }}" for name in ("vehicle", "cycle", "pedestrian", "static", "other")]
    return "\n".join([":root {", *lines, "}", *family_lines, *actors])


def families(bank: ActionBank) -> dict[str, int]:
    """Number of every family, the nominal's first."""
    names = dict.fromkeys([bank.nominal.family, *(policy.family for policy in bank.policies)])
    return {name: index for index, name in enumerate(names)}


def _words(key: str) -> str:
    return label(key).replace("_", " ")


def shared_data(
    bank: ActionBank | None, towns: Mapping[str, Any], levels: Mapping[str, Level], *, report: str = ""
) -> dict[str, Any]:
    """What all groups of a page have in common.

    Args:
        bank: The action bank.
        towns: Roads by town.
        levels: How grave it is that a rule fails, of rules that do.
        report: Address of the report that the page belongs to; empty where it is the page.
    """
    numbers = {} if bank is None else families(bank)
    return {
        "bank": []
        if bank is None
        else [
            {"key": policy.key, "label": _words(policy.key), "family": numbers[policy.family]}
            for policy in bank.policies
        ],
        "families": [_words(name) for name in numbers],
        "steps": {**STEPS, "road_m": STEP_M},
        "towns": dict(towns),
        "rules": {rule_id: [CATALOGUE[rule_id].broken, level] for rule_id, level in levels.items()},
        "report": report,
    }
