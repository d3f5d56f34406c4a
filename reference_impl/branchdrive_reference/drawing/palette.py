"""Colours: families of policies by hue, magnitudes by lightness, actors in quiet tones of their own.

Hues are those of Okabe and Ito, which readers with any common colour vision tell apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from branchdrive.contract.bank import ActionBank

__all__ = ["ACTORS", "BACKDROP", "Rgb", "candidate_colours"]

Rgb = tuple[float, float, float]
"""Red, green and blue in ``[0, 1]``."""


def _rgb(code: str) -> Rgb:
    red, green, blue = (int(code[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue


_NOMINAL = _rgb("#111418")
_FAMILIES = {
    "accelerate": _rgb("#d55e00"),
    "brake": _rgb("#0072b2"),
    "steer_left": _rgb("#b5478f"),
    "steer_right": _rgb("#009e73"),
}
_OTHER_FAMILIES = (_rgb("#e69f00"), _rgb("#56b4e9"), _rgb("#8c6d1f"), _rgb("#6a51a3"))

BACKDROP: Mapping[str, Rgb] = MappingProxyType(
    {
        "ink": _rgb("#1f2328"),
        "quiet": _rgb("#6a737d"),
        "ground": _rgb("#eef1ea"),
        "paved": _rgb("#dcdee0"),
        "carriageway": _rgb("#c6c9ce"),
        "parking": _rgb("#d3d5d9"),
        "kerb": _rgb("#989da5"),
        "marking": _rgb("#ffffff"),
        "route": _rgb("#5f4bb6"),
        "window": _rgb("#f1f2f4"),
    }
)
"""Everything that is neither a candidate nor an actor."""

ACTORS: Mapping[str, Rgb] = MappingProxyType(
    {
        "vehicle": _rgb("#66788f"),
        "cycle": _rgb("#56b4e9"),
        "pedestrian": _rgb("#f0c808"),
        "static": _rgb("#7a5a43"),
    }
)
"""Fill of an actor's box by its class."""


def _mixed(colour: Rgb, other: float, share: float) -> Rgb:
    red, green, blue = (channel + share * (other - channel) for channel in colour)
    return red, green, blue


def _shade(colour: Rgb, rank: float) -> Rgb:
    """Lighter than `colour` for ranks below 0.5, darker above; `rank` in ``[0, 1]``."""
    return _mixed(colour, 1.0, 0.9 * (0.5 - rank)) if rank < 0.5 else _mixed(colour, 0.0, 0.75 * (rank - 0.5))


def candidate_colours(bank: ActionBank) -> dict[str, Rgb]:
    """Colour of every policy of a bank by action key: hue by family, darker with magnitude."""
    families: dict[str, list[float]] = {}
    for policy in bank.interventions:
        families.setdefault(policy.family, []).append(policy.magnitude)
    others = [family for family in families if family not in _FAMILIES]
    hues = {**_FAMILIES, **{name: _OTHER_FAMILIES[i % len(_OTHER_FAMILIES)] for i, name in enumerate(others)}}
    colours = {bank.nominal.key: _NOMINAL}
    for policy in bank.interventions:
        magnitudes = sorted(set(families[policy.family]))
        rank = magnitudes.index(policy.magnitude) / (len(magnitudes) - 1) if len(magnitudes) > 1 else 0.5
        colours[policy.key] = _shade(hues[policy.family], rank)
    return colours
