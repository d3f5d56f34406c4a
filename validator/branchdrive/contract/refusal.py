"""What is wrong with a document, in plain words: where, what was expected and what was found.

Source: spec/07-rules.md#findings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, ValidationError

from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.resources import load_resource
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import printable, quote
from branchdrive.errors import ContractError

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
    from pydantic_core import ErrorDetails
else:
    ModelMetaclass = type(BaseModel)

__all__ = ["Document", "mismatches_of", "refusal"]

CLOCK = load_resource("descriptor.schema.json")["properties"]["rates"]["properties"]["tick_s"]["description"]
"""What a tick is, and what a simulator at another rate does."""

_TEXTS = MappingProxyType(
    {
        "^[a-z0-9]": "1 to 128 lower-case letters, digits, `.`, `_` and `-`, a letter or a digit first",
        "^[A-Za-z0-9]": "1 to 128 letters, digits, blanks and `. _ : / + -`, a letter or a digit first",
        "^[!-~]": "1 to 128 characters of printable ASCII without a blank at either end",
        "^(0|[1-9]": "a version of three numbers, such as 1.0.0",
        "^[0-9a-f]{64}$": "64 hexadecimal digits in lower case",
    }
)
"""Patterns of the descriptor by how they begin."""


def _pattern(context: Mapping[str, Any]) -> str:
    pattern = str(context["pattern"])
    return next((text for start, text in _TEXTS.items() if pattern.startswith(start)), f"text like {pattern}")


_EXPECTED: Mapping[str, Callable[[Mapping[str, Any]], str]] = MappingProxyType(
    {
        "string_pattern_mismatch": _pattern,
        "greater_than": lambda context: f"more than {context['gt']:g}",
        "greater_than_equal": lambda context: f"at least {context['ge']:g}",
        "less_than": lambda context: f"less than {context['lt']:g}",
        "less_than_equal": lambda context: f"at most {context['le']:g}",
        "literal_error": lambda context: f"one of {context['expected']}",
        "missing": lambda _: "a value",
        "extra_forbidden": lambda _: "no property of this name",
    }
)
"""What was expected, by the kind of an error."""


def mismatches_of(error: ValidationError) -> tuple[Mismatch, ...]:
    """One mismatch for every problem, with the pointer of its place; found values are safe to print."""
    return tuple(_mismatches(error))


def _mismatches(error: ValidationError) -> Iterator[Mismatch]:
    for detail in error.errors(include_url=False):
        pointer = "".join(f"/{part}" for part in detail["loc"]) or "/"
        yield Mismatch({"pointer": pointer}, _expected(detail), _found(detail))


def _found(detail: ErrorDetails) -> str:
    if detail["type"] == "missing":
        return "nothing"
    found = quote(detail["input"])
    is_cut = isinstance(detail["input"], Mapping) and found.endswith("...")
    return "properties that contradict it" if is_cut else found


def _expected(detail: ErrorDetails) -> str:
    if detail["loc"] and detail["loc"][-1] == "tick_s":
        return str(CLOCK)
    text = _EXPECTED.get(detail["type"])
    return text(detail.get("ctx", {})) if text else detail["msg"].removeprefix("Value error, ")


def refusal(what: str, error: ValidationError) -> ContractError:
    """The error of a call that made `what` of values which break the format: one line for every problem."""
    found = mismatches_of(error)
    lines = [
        f"- BD-DOC-003 {printable(str(wrong.location['pointer']))}: expected {printable(wrong.expected)}, "
        f"found {wrong.found}"
        for wrong in found
    ]
    remedy = CATALOGUE["BD-DOC-003"].remedy
    return ContractError("\n".join([f"{what} breaks the format; {remedy[:1].lower()}{remedy[1:]}", *lines]), found)


class _PlainlyRefused(ModelMetaclass):
    """Calls with values that break the format raise findings in plain words, not pydantic's own text."""

    def __call__(self, *arguments: Any, **fields: Any) -> Any:
        """An instance.

        Raises:
            ContractError: With one finding for each problem.
        """
        try:
            return super().__call__(*arguments, **fields)
        except ValidationError as error:
            raise refusal(f"`{self.__name__}`", error) from None


class Document(BaseModel, metaclass=_PlainlyRefused):
    """Frozen values of a document, or of a part of it, without properties that are not declared."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
