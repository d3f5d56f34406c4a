"""Options of the form ``NAME=NUMBER,...``: which names they take, and the words in which they refuse others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from branchdrive.errors import UsageError

__all__ = ["ShareList"]


@dataclass(frozen=True)
class ShareList:
    """An option that gives names a number of 0 to 1 each.

    Attributes:
        option: The option, ``--faults`` for example.
        names: Names that it takes.
        number: What a number is called.
        unknown: What a name is that it does not take.
        form: How it is written, in the words of its refusals; the names follow.
        is_division: Whether the numbers divide a whole, so that they add up to at most 1.
    """

    option: str
    names: tuple[str, ...]
    number: str
    unknown: str
    form: str
    is_division: bool = False

    def parse(self, text: str, presets: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
        """Numbers of a text: ``none``, a preset's name, or ``NAME=NUMBER`` separated by commas.

        Args:
            text: What the user wrote.
            presets: Numbers by the name of their preset.

        Returns:
            Numbers by name; those that are 0 are left out.

        Raises:
            UsageError: A name is unknown or comes twice, a number is not from 0 to 1, or they add up to too much.
        """
        if text == "none":
            return {}
        if text in presets:
            return dict(presets[text])
        found: dict[str, float] = {}
        for part in text.split(","):
            name, _, number = (piece.strip() for piece in part.partition("="))
            if name not in self.names:
                raise self._refused(text, f"{name!r} {self.unknown}", presets)
            if name in found:
                raise self._refused(text, f"{name!r} comes twice", presets)
            try:
                found[name] = float(number)
            except ValueError:
                raise self._refused(text, f"{number!r} is no {self.number} of {name!r}", presets) from None
            if not 0 <= found[name] <= 1:
                raise self._refused(text, f"the {self.number} {number} of {name!r} is not in 0 .. 1", presets)
        if self.is_division and (total := sum(found.values())) > 1:
            raise self._refused(text, f"the {self.number}s add up to {total:g}, which is more than 1", presets)
        return {name: number for name, number in found.items() if number > 0}

    def _refused(self, text: str, problem: str, presets: Mapping[str, Mapping[str, float]]) -> UsageError:
        wholes, names = ", ".join(["none", *presets]), ", ".join(self.names)
        return UsageError(f"{self.option} {text!r}: {problem}; give one of {wholes}, or {self.form} {names}")
