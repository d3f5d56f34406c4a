"""The rules, one module per area; importing this package binds every rule to the catalogue."""

from branchdrive.audit.rules import (
    controls,
    documents,
    evidence,
    groups,
    keys,
    layout,
    media,
    nulls,
    status,
    tables,
    ticks,
    trigger,
    values,
    windows,
)

__all__ = [
    "controls",
    "documents",
    "evidence",
    "groups",
    "keys",
    "layout",
    "media",
    "nulls",
    "status",
    "tables",
    "ticks",
    "trigger",
    "values",
    "windows",
]
