"""The machine form of the specification: rules, columns, bounds and schemas of `schemas/v0.1`, as they stand there."""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

SCHEMAS = Path(__file__).resolve().parents[2] / "schemas" / "v0.1"

#: Types of DuckDB for the declared types of columns.
TYPES = {
    "string": "VARCHAR",
    "bool": "BOOLEAN",
    "int32": "INTEGER",
    "int64": "BIGINT",
    "float32": "FLOAT",
    "float64": "DOUBLE",
    "list<float64>": "DOUBLE[]",
}


@cache
def document(name: str) -> Any:
    """A document of `schemas/v0.1` by its file name."""
    return json.loads((SCHEMAS / name).read_text(encoding="utf-8"))


RULES: list[dict[str, Any]] = [rule for rule in document("rules.json")["rules"] if "layer" not in rule]
TABLES: dict[str, dict[str, Any]] = document("columns.json")["tables"]
RAW_TABLES = tuple(TABLES)
DERIVED: dict[str, dict[str, Any]] = document("layers.json")["layers"]
STREAMS: dict[str, dict[str, Any]] = document("columns.json")["streams"]
PATTERNS: dict[str, str] = document("columns.json")["patterns"]
LIMITS: dict[str, int] = {name: limit["value"] for name, limit in document("limits.json")["limits"].items()}
BOUNDS: dict[str, float] = {name: bound["value"] for name, bound in document("limits.json")["bounds"].items()}
VERSION: str = document("rules.json")["version"]

#: What names a path, a host or a wall-clock time (spec/02-time-frames-units.md#clock), for RE2 and for Python.
PLACE = "|".join(
    (
        r"(?:^|[\s\"'=(,;<>|]|\bfile://)/[\w.+@-]+/[\w.+@-]+",  # an absolute path of two parts or more
        r"\b[A-Za-z]:[\\/][\w.+@-]+[\\/][\w.+@-]+",  # the same with a drive
        r"\\\\[\w.-]+\\[\w.$-]+",  # a share
        r"(?:^|[^\w./@-])[a-z_][\w-]*@[\w-]+(?:[^\w.@-]|$)",  # a host with a user
        r"(?:^|[^\w./:@-])[\w-]+@[\w.-]+:[\w/~]",
        r"(?:^|[^\w./:@-])(?:localhost|[A-Za-z0-9-]+(?:\.[A-Za-z0-9-]+)+):[0-9]{2,5}(?:[^\w.]|$)",  # with a port
        r"\b[0-9]{4}-[0-9]{2}-[0-9]{2}[Tt\s_-]+[0-9]{2}[:._-]?[0-9]{2}",  # a date with a time of day
        r"\b[0-9]{8}[Tt][0-9]{4}",
    )
)


def names_place(text: str) -> bool:
    """Whether a text names a path, a host or a wall-clock time."""
    return re.search(PLACE, text, re.ASCII) is not None
