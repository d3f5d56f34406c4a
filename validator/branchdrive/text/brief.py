"""Numbers in sentences with as many digits as people read."""

from __future__ import annotations

import re

__all__ = ["brief"]

_DIGITS = 7
"""Significant digits that are shown: those of a float32, which most columns are."""

_NUMBER = re.compile(r"(?<![\w.])\d+\.\d+(?:e[+-]?\d+)?(?![\w.])")
_LEAST_PLAIN, _MOST_PLAIN = 1e-4, 1e6
"""Between these a rounded number is written without an exponent; others stay as they are."""


def brief(*texts: str) -> tuple[str, ...]:
    """Texts that stand side by side, with numbers of more than seven significant digits rounded to these.

    Where two different numbers would look equal then, all stay as they are.
    """
    numbers = {number for text in texts for number in _NUMBER.findall(text)}
    shown = {number: _rounded(number) for number in numbers}
    if len({float(short) for short in shown.values()}) < len({float(number) for number in numbers}):
        return texts
    return tuple(_NUMBER.sub(lambda match: shown[match[0]], text) for text in texts)


def _rounded(number: str) -> str:
    digits = number.partition("e")[0].replace(".", "").lstrip("0")
    if len(digits) <= _DIGITS or not _LEAST_PLAIN <= float(number) < _MOST_PLAIN:
        return number
    return f"{float(number):.{_DIGITS}g}"
