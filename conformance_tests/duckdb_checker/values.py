"""Rules VAL, NUL and BOX: one statement for each rule, written from the columns that `columns.json` declares."""

import re
from collections.abc import Callable
from typing import Any

from contract import PATTERNS, PLACE, TABLES

Column = dict[str, Any]
EXTENTS = {"ego_length_m", "ego_width_m", "ego_height_m", "length_m", "width_m", "height_m"}
PLACES = ("rollout_id", "tick", "actor_id", "camera", "town", "element_id")
FREE_PATTERNS = {"name", "label", "text"}  # the other patterns admit no path, host or time


def _text(value: str) -> str:
    return "'" + value.replace("'", "''") + "'"


def _each(column: Column, violates: Callable[[str], str]) -> str:
    """A condition on a value, or on any value of a list."""
    name = column["name"]
    if not column["type"].startswith("list"):
        return violates(name)
    return f"coalesce(list_bool_or([{violates('value')} for value in {name}]), false)"


def _is_number(column: Column) -> bool:
    return column["type"].removeprefix("list<").startswith(("int", "float"))


def _is_extent(table: str, column: Column) -> bool:
    return table in ("rollouts", "actors") and column["name"] in EXTENTS


def _val_001(table: str, column: Column) -> str | None:
    if "float" not in column["type"] or _is_extent(table, column):
        return None
    if column["type"].startswith("list"):
        return _each(column, lambda value: f"not coalesce(isfinite({value}), false)")
    return f"not isfinite({column['name']})"


def _val_002(table: str, column: Column) -> str | None:
    if not _is_number(column) or ("min" not in column and "max" not in column):
        return None
    real = "float" in column["type"]
    bounds = [f"< {column['min']!r}" if "min" in column else None, f"> {column['max']!r}" if "max" in column else None]
    tests = [bound for bound in bounds if bound]

    def outside(value: str) -> str:
        number = f"{value}::double" if real else value
        either = " or ".join(f"{number} {test}{'::double' if real else ''}" for test in tests)
        return f"(isfinite({value}) and ({either}))" if real else f"({either})"

    return _each(column, outside)


def _val_003(table: str, column: Column) -> str | None:
    words = ", ".join(_text(word) for word in column.get("values", []))
    return f"{column['name']} not in ({words})" if words else None


def _val_004(table: str, column: Column) -> str | None:
    if "pattern" not in column:
        return None
    name, expression = column["name"], PATTERNS[column["pattern"]].removeprefix("^").removesuffix("$")
    matches = f"regexp_full_match({name}, {_text(expression)})"
    if repeated := re.search(r"\{([01]),(\d+)\}", expression):  # RE2 would unroll it: the length is judged apart
        loose = expression.replace(repeated[0], "*" if repeated[1] == "0" else "+")
        most = int(repeated[2]) + len(re.findall(r"\[[^]]+\]", expression)) - 1
        matches = f"regexp_full_match({name}, {_text(loose)}) and length({name}) <= {most}"
    return f"not ({matches})"


def _val_006(table: str, column: Column) -> str | None:
    if column.get("pattern") not in FREE_PATTERNS:
        return None
    return f"regexp_matches({column['name']}, {_text(PLACE)})"


def _box_001(table: str, column: Column) -> str | None:
    name = column["name"]
    return f"not (isfinite({name}) and {name} > 0 and {name} <= 100)" if _is_extent(table, column) else None


def _nul_001(table: str, column: Column) -> str | None:
    return None if "available" in column else f"{column['name']} is null"


def _nul_002(table: str, column: Column) -> str | None:
    mask = column.get("available", {}).get("mask")
    return f"{mask} <> ({column['name']} is not null)" if mask else None


def _nul_003(table: str, column: Column) -> str | None:
    return f"active <> ({column['name']} is not null)" if column.get("available", {}).get("when") == "active" else None


def _nul_004(table: str, column: Column) -> str | None:
    available = column.get("available", {})
    condition = {
        "branched": "branch_tick is not null",
        "not_complete": "status <> 'complete'",
        "not_nominal": "role <> 'nominal'",
        "valued": f"{available.get('rule')} in ('absolute', 'floor')",
    }.get(available.get("when", ""))
    return f"({condition}) <> ({column['name']} is not null)" if condition else None


def _nul_006(table: str, column: Column) -> str | None:
    if column.get("available", {}).get("when") != "recorded":
        return None
    return f"({column['name']} is null) <> list_contains($unrecorded, '{table}.{column['name']}')"


VIOLATIONS: dict[str, Callable[[str, Column], str | None]] = {
    "BD-VAL-001": _val_001,
    "BD-VAL-002": _val_002,
    "BD-VAL-003": _val_003,
    "BD-VAL-004": _val_004,
    "BD-VAL-006": _val_006,
    "BD-BOX-001": _box_001,
    "BD-NUL-001": _nul_001,
    "BD-NUL-002": _nul_002,
    "BD-NUL-003": _nul_003,
    "BD-NUL-004": _nul_004,
    "BD-NUL-006": _nul_006,
}


def statement(rule: str, tables: list[str]) -> str | None:
    """The statement of a rule over the claimed tables; None where it is about none of their columns."""
    selects, judged = [], []
    for table in tables:
        columns = TABLES[table]["columns"]
        violations = {column["name"]: VIOLATIONS[rule](table, column) for column in columns}
        violations = {name: condition for name, condition in violations.items() if condition}
        if violations:
            judged.append(table)
            marks = ", ".join(f"case when {test} then '{name}' end" for name, test in violations.items())
            key = TABLES[table]["key"]
            keys = ", ".join(name if name in key else f"null as {name}" for name in PLACES)
            selects.append(
                f'select shard, \'{table}\' as "table", {keys}, unnest([{marks}]) as "column" from {table} '
                f"where {' or '.join(violations.values())}"
            )
    if not selects:
        return None
    union = " union all ".join(f"({select})" for select in selects)
    return f'-- subjects: {" + ".join(judged)}\nselect * from ({union}) where "column" is not null'
