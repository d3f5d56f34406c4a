"""Populations other than the frozen one: declared by flags, counted and digested apart, never merged with it.

A variant is the groups whose flags of `group_quality` are as it says. The variant `extended` comes with
every release; a builder may be given more as a JSON list of ``{"name", "title", "where": {column: bool}}``.

Source: paper, "Intended Use" (alternative subsets are reported separately); spec/10-layers.md#variants.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES, PATTERNS
from branchdrive.errors import UsageError
from branchdrive.tables.frame import Frame, num_rows

__all__ = [
    "EXTENDED",
    "FLAGS",
    "FROZEN",
    "RESERVED",
    "Variant",
    "declared_of",
    "declared_variants",
    "members",
    "variants_document",
]

MAX_VARIANTS = 100
"""Variants that may be declared beside `extended`."""

_MAX_TITLE = 200


class Variant(NamedTuple):
    """A population by the flags of its groups.

    Attributes:
        name: Identifier.
        title: What it is, one line.
        where: Value that each named column must have.
    """

    name: str
    title: str
    where: Mapping[str, bool]


FLAGS = tuple(column.name for column in LAYER_TABLES["group_quality"].columns if column.type == "bool")
"""Columns of `group_quality` that a variant may ask for."""

FROZEN: Mapping[str, bool] = MappingProxyType({"core_valid": True, "near_duplicate": False})
"""Flags of the frozen population."""

EXTENDED = Variant(
    "extended",
    "Replay-valid by the extended variables too",
    MappingProxyType({"core_valid": True, "extended_valid": True, "near_duplicate": False}),
)
"""The variant that comes with every release."""

RESERVED = ("frozen", "core", EXTENDED.name)
"""Names that no declared variant may take."""


def declared_variants(declared: Any) -> tuple[Variant, ...]:
    """Variants of a JSON list, in its order.

    Raises:
        UsageError: Not a list of such objects, a name that is taken or no identifier, or a column that is no flag.
    """
    if not isinstance(declared, list) or len(declared) > MAX_VARIANTS:
        raise UsageError(f"variants are a list of at most {MAX_VARIANTS} objects with `name`, `title` and `where`")
    variants: list[Variant] = []
    for i, entry in enumerate(declared):
        variant = _variant(i, entry)
        if variant.name in (*RESERVED, *(other.name for other in variants)):
            raise UsageError(f"variant {i}: the name {variant.name!r} is taken; choose another")
        variants.append(variant)
    return tuple(variants)


def _variant(i: int, entry: Any) -> Variant:
    if not isinstance(entry, Mapping) or set(entry) != {"name", "title", "where"}:
        raise UsageError(f"variant {i}: expected an object with `name`, `title` and `where`")
    name, title, where = entry["name"], entry["title"], entry["where"]
    if not isinstance(name, str) or not re.fullmatch(PATTERNS["id"].removesuffix("$"), name):
        raise UsageError(f"variant {i}: `name` must match {PATTERNS['id']}")
    if not isinstance(title, str) or not 0 < len(title) <= _MAX_TITLE or not title.isprintable():
        raise UsageError(f"variant {name!r}: `title` must be one printable line of at most {_MAX_TITLE} characters")
    if not isinstance(where, Mapping) or not where or not all(isinstance(value, bool) for value in where.values()):
        raise UsageError(f"variant {name!r}: `where` must give true or false for at least one column")
    unknown = sorted(set(where) - set(FLAGS))
    if unknown:
        raise UsageError(f"variant {name!r}: {unknown} are not flags of `group_quality`; those are {list(FLAGS)}")
    return Variant(name, title, MappingProxyType(dict(where)))


def declared_of(document: Mapping[str, Any]) -> tuple[Variant, ...]:
    """Variants that a document ``variants.json`` declares beside `extended`, as `variants_document` takes them.

    Raises:
        UsageError: They could not have been declared.
    """
    keys = ("name", "title", "where")
    own = [{key: entry[key] for key in keys} for entry in document["variants"] if entry["name"] != EXTENDED.name]
    return declared_variants(own)


def variants_document(groups: Frame, declared: Sequence[Variant] = ()) -> dict[str, Any]:
    """The document ``variants.json``: the frozen population, `extended`, and what was declared, in its order.

    Args:
        groups: Rows of `group_quality`.
        declared: Variants, as `declared_variants` reads them.
    """
    return {
        "frozen": {"where": dict(FROZEN), **_counted(groups, FROZEN)},
        "variants": [
            {"name": name, "title": title, "where": dict(where), **_counted(groups, where)}
            for name, title, where in (EXTENDED, *declared)
        ],
    }


def members(groups: Frame, where: Mapping[str, bool]) -> NDArray[np.bool_]:
    """Whether each group has the flags ``[groups]``."""
    belongs = np.ones(num_rows(groups), np.bool_)
    for column, value in where.items():
        belongs &= np.asarray(groups[column], np.bool_) == value
    return belongs


def _counted(groups: Frame, where: Mapping[str, bool]) -> dict[str, Any]:
    """Number of groups and SHA-256 of their sorted ids, one a line."""
    group_ids = sorted(groups["group_id"][members(groups, where)].tolist())
    lines = "".join(f"{group_id}\n" for group_id in group_ids)
    return {"num_groups": len(group_ids), "digest": hashlib.sha256(lines.encode()).hexdigest()}
