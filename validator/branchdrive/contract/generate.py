"""Everything in the repository that is written by machine: tables of the spec, and record schemas.

``python -m branchdrive.contract.generate`` writes them, ``--check`` only names the stale ones. A
generated region of a chapter lies between ``<!-- generated: NAME -->`` and ``<!-- end generated -->``;
`REGIONS` has a function for every name. Source of all of it: the files of `schemas/v0.1/`.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.columns import PATTERNS, STREAMS, TABLES, Availability, Column
from branchdrive.contract.encoding import ENCODING_WIDTH, encode_bank, encoding_digest
from branchdrive.contract.resources import SPEC_VERSION, load_resource, schema_dir
from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from branchdrive.contract.policy import ActuatorRule

__all__ = ["REGIONS", "generated_files", "main", "record_schemas", "render_regions", "stale_files"]

SCHEMA_URL = f"https://branchdrive.org/schemas/v{SPEC_VERSION}"
CONDITIONS: Mapping[str, str] = MappingProxyType(
    {
        "branched": "exactly where the row has a `branch_tick`",
        "not_complete": "exactly where `status` is not `complete`",
        "not_nominal": "exactly where `role` is not `nominal`",
        "valued": "exactly where the rule column of the same actuator is `absolute` or `floor`",
        "active": "exactly where `active` is true",
        "optional": "wherever the collector could know it",
    }
)
"""When a value of a conditional column is present, by the name of the condition."""

_REGION = re.compile(r"(<!-- generated: (\S+) -->\n).*?(<!-- end generated -->)", re.DOTALL)
_JSON_TYPES = {
    "string": "string",
    "bool": "boolean",
    "int32": "integer",
    "int64": "integer",
    "float32": "number",
    "float64": "number",
}


def _grid(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table; every cell is one line."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def _code(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(value)


def _allowed(column: Column) -> str:
    if column.values:
        return _code(column.values)
    if column.pattern:
        return f"pattern `{column.pattern}`"
    match column.min, column.max:
        case None, None:
            return ""
        case low, None if low is not None:
            return f"at least {_number(low)}"
        case None, high if high is not None:
            return f"at most {_number(high)}"
        case low, high:
            return f"{_number(low)} to {_number(high)}"  # type: ignore[arg-type]


def _null(available: Availability | None) -> str:
    if available is None:
        return "never"
    return f"mask `{available.mask}`" if available.mask else f"condition `{available.when}`"


def _columns_region(table: str) -> str:
    declared = TABLES[table]
    header = ["column", "type", "unit", "frame", "track", "values", "null", "description"]
    rows = [
        [
            f"`{c.name}`",
            c.type,
            c.unit or "",
            c.frame or "",
            c.track,
            _allowed(c),
            _null(c.available),
            c.description,
        ]
        for c in declared.columns
    ]
    place = f"File `{declared.file_name}`, rate {declared.rate}, key {_code(declared.key)}."
    return f"{declared.title}\n{place}\n\n{_grid(header, rows)}"


def _streams_region() -> str:
    rows = [
        [
            f"`{s.name}`",
            s.title,
            s.rate,
            s.track,
            _code(s.tables),
            _code(s.cameras),
            "yes" if s.required else "no",
        ]
        for s in STREAMS.values()
    ]
    return _grid(["stream", "title", "rate", "track", "tables", "cameras", "required"], rows)


def _patterns_region() -> str:
    rows = [[f"`{name}`", f"`{regex}`"] for name, regex in PATTERNS.items()]
    return _grid(["name", "regular expression"], rows)


def _masks_region() -> str:
    masked: dict[str, list[str]] = {}
    for table in TABLES.values():
        for column in table.columns:
            if column.available and column.available.mask:
                masked.setdefault(f"{table.name}.{column.available.mask}", []).append(column.name)
    rows = [[f"`{mask}`", _code(names)] for mask, names in masked.items()]
    return _grid(["mask", "columns that it governs"], rows)


def _conditions_region() -> str:
    governed: dict[str, list[str]] = {name: [] for name in CONDITIONS}
    for table in TABLES.values():
        for column in table.columns:
            if column.available and column.available.when:
                governed[column.available.when].append(f"{table.name}.{column.name}")
    rows = [[f"`{name}`", f"present {CONDITIONS[name]}", _code(names)] for name, names in governed.items()]
    return _grid(["condition", "meaning", "columns"], rows)


def _actuator(rule: ActuatorRule) -> str:
    return rule.rule if rule.value is None else f"{rule.rule}({rule.value:g})"


def _bank_region() -> str:
    header = ["key", "family", "magnitude", "duration in ticks", "steer", "throttle", "brake", "recovery"]
    rows = [
        [
            f"`{p.key}`",
            p.family,
            f"{p.magnitude:g}",
            str(p.duration_ticks),
            *map(_actuator, p.rules),
            p.recovery,
        ]
        for p in load_action_bank().policies
    ]
    return _grid(header, rows)


def _encoding_region() -> str:
    bank = load_action_bank()
    matrix = encode_bank(bank)
    first_of_family = {policy.family: row for row, policy in reversed(list(enumerate(bank.policies)))}
    shown = sorted(first_of_family.values())
    rows = [[str(index), *(str(matrix[row, index]) for row in shown)] for index in range(ENCODING_WIDTH)]
    table = _grid(["index", *(f"`{bank.policies[row].key}`" for row in shown)], rows)
    return f"{table}\nSHA-256 of the whole matrix of the bank `{bank.name}`: `{encoding_digest(bank)}`.\n"


def _rule_row(rule: Mapping[str, Any]) -> list[str]:
    clause = rule["clause"].removeprefix("spec/")
    return [
        f'<a id="{rule["id"].lower()}"></a>`{rule["id"]}`',
        rule["title"],
        rule["kind"],
        rule["level"],
        rule["grain"],
        rule.get("stage", ""),
        _code(rule.get("streams", ())),
        _code(rule.get("requires", ())),
        f"[{clause}]({clause})",
    ]


def _rules_region() -> str:
    catalogue = load_resource("rules.json")
    header = ["rule", "title", "kind", "level", "grain", "stage", "streams", "requires", "clause"]
    parts = []
    for area, title in catalogue["areas"].items():
        rows = [_rule_row(rule) for rule in catalogue["rules"] if rule["id"].startswith(f"BD-{area}-")]
        parts.append(f"### {area}: {title}\n\n{_grid(header, rows)}")
    return "\n".join(parts)


def _limits_region() -> str:
    limits = load_resource("limits.json")["limits"]
    rows = [[f"`{name}`", f"{it['value']:,}", it["unit"], it["description"]] for name, it in limits.items()]
    return _grid(["limit", "value", "unit", "what it bounds"], rows)


REGIONS: Mapping[str, Callable[[], str]] = MappingProxyType(
    {
        "streams": _streams_region,
        "patterns": _patterns_region,
        "masks": _masks_region,
        "conditions": _conditions_region,
        "bank": _bank_region,
        "encoding": _encoding_region,
        "rules": _rules_region,
        "limits": _limits_region,
        **{f"columns-{table}": partial(_columns_region, table) for table in TABLES},
    }
)
"""Markdown of every generated region, by name."""


def render_regions(text: str) -> str:
    """`text` of a chapter with every generated region rendered afresh.

    Raises:
        UsageError: A region has a name that `REGIONS` does not know.
    """

    def region(match: re.Match[str]) -> str:
        opening, name, closing = match.groups()
        if name not in REGIONS:
            raise UsageError(f"generated region {name!r} is unknown; there are {sorted(REGIONS)}")
        return f"{opening}\n{REGIONS[name]()}\n{closing}"

    return _REGION.sub(region, text)


def _value_schema(column: Column) -> dict[str, Any]:
    """Schema of one value of a column as JSON; a nullable column admits null."""
    element = _JSON_TYPES[column.type.removeprefix("list<").removesuffix(">")]
    item: dict[str, Any] = {"type": [element, "null"] if column.nullable else element}
    if column.values:
        item["enum"] = [*column.values, *([None] if column.nullable else [])]
    if column.pattern:
        item["pattern"] = PATTERNS[column.pattern]
    bounds = {"minimum": column.min, "maximum": column.max}
    item.update({word: bound for word, bound in bounds.items() if bound is not None})
    schema = {"type": "array", "items": item} if column.type.startswith("list<") else item
    return {**schema, "description": column.description}


def _present_unless(absent_where: Mapping[str, Any], names: Sequence[str], when: str) -> dict[str, Any]:
    """Columns `names` are null where the properties match `absent_where`, and not null elsewhere."""
    return {
        "if": {"properties": absent_where},
        "then": {"properties": {name: {"type": "null"} for name in names}},
        "else": {"properties": {name: {"not": {"type": "null"}} for name in names}},
        "description": f"{', '.join(names)}: present {CONDITIONS[when].replace('`', '')}",
    }


def _conditional(columns: Sequence[Column]) -> list[dict[str, Any]]:
    """Conditional availability among the columns of one rollouts row."""
    governed: dict[str, list[Column]] = {}
    for column in columns:
        if column.available and column.available.when:
            governed.setdefault(column.available.when, []).append(column)
    absent_where: dict[str, dict[str, Any]] = {
        "not_complete": {"status": {"const": "complete"}},
        "not_nominal": {"role": {"const": "nominal"}},
        "branched": {"branch_tick": {"type": "null"}},
    }
    clauses = []
    for when, members in governed.items():
        if when == "valued":
            no_value = {"not": {"enum": ["absolute", "floor"]}}
            for c in members:
                rule = c.available.rule if c.available else None
                clauses.append(_present_unless({str(rule): no_value}, [c.name], when))
        elif when in absent_where and (names := [c.name for c in members if c.name not in absent_where[when]]):
            clauses.append(_present_unless(absent_where[when], names, when))
    return clauses


def _record(columns: Sequence[Column], **extra: Any) -> dict[str, Any]:
    record: dict[str, Any] = {
        "type": "object",
        "additionalProperties": False,
        "required": [column.name for column in columns],
        "properties": {column.name: _value_schema(column) for column in columns},
    }
    record["required"] += list(extra)
    record["properties"].update(extra)
    clauses = _conditional(columns)
    return {**record, "allOf": clauses} if clauses else record


def record_schemas() -> dict[str, dict[str, Any]]:
    """Record schemas by file name: JSON Schema 2020-12 documents that `columns.json` implies."""
    records = load_resource("columns.json")["records"]
    table = TABLES[records["rollout"]["table"]]
    group = records["branch_group"]
    attempts = {
        "type": "array",
        "minItems": 1,
        "items": _record([table[name] for name in group["attempts"]]),
        "description": "Every attempt of the group, whatever its status; order carries no meaning.",
    }
    rollout_text = (
        f"{records['rollout']['title']} Generated from columns.json (spec/05-raw-streams.md). "
        "Beyond this schema: both route coordinates have the same number of vertices, two or more, "
        "and ego extents are above 0 m and at most 100 m."
    )
    group_text = (
        f"{group['title']} Generated from columns.json (spec/05-raw-streams.md). "
        "Beyond this schema: rollout_id is unique."
    )
    members = _record([table[name] for name in group["shared"]], attempts=attempts)
    return {
        name: {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "$id": f"{SCHEMA_URL}/{name}",
            "title": title,
            "description": text,
            **record,
        }
        for name, title, text, record in (
            ("rollout.schema.json", "Rollout", rollout_text, _record(table.columns)),
            ("branch-group.schema.json", "Branch group", group_text, members),
        )
    }


def generated_files(root: Path) -> dict[Path, str]:
    """Text that every file with generated content should have, for the checkout at `root`.

    Raises:
        UsageError: `root` is no checkout of this repository.
    """
    chapters = sorted((root / "spec").glob("*.md"))
    if not chapters:
        raise UsageError(f"{root} has no spec/ folder; run this in a checkout of the repository")
    files = {path: render_regions(path.read_text(encoding="utf-8")) for path in chapters}
    schemas = root / "schemas" / f"v{SPEC_VERSION}"
    for name, schema in record_schemas().items():
        files[schemas / name] = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    return files


def stale_files(root: Path) -> list[Path]:
    """Files of the checkout at `root` whose generated content is not up to date, relative to it."""
    return [
        path.relative_to(root)
        for path, text in generated_files(root).items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write generated content, or with ``--check`` report what is stale.

    Returns:
        0 if everything is up to date (now), 1 if ``--check`` found stale files.
    """
    parser = argparse.ArgumentParser(
        prog="python -m branchdrive.contract.generate",
        description="Write the generated parts of spec/ and schemas/.",
    )
    parser.add_argument("--check", action="store_true", help="change nothing; name stale files, exit 1 if any")
    check = parser.parse_args(arguments).check
    root = schema_dir().parents[1]
    stale = stale_files(root)
    for path in stale:
        sys.stdout.write(f"{'stale' if check else 'written'}: {path.as_posix()}\n")
    if not check:
        texts = generated_files(root)
        for path in stale:
            (root / path).write_text(texts[root / path], encoding="utf-8")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
