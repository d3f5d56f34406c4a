"""Schemas that declarations imply: records from `columns.json`, and lists of metrics from `metrics.json`."""

from __future__ import annotations

import copy
import re
from typing import TYPE_CHECKING, Any

from branchdrive.contract.columns import PATTERNS, TABLES, Column
from branchdrive.contract.generate.region import CONDITIONS
from branchdrive.contract.metric import metric_names
from branchdrive.contract.resources import SPEC_VERSION, load_resource

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["metric_schemas", "protocol_text", "record_schemas"]

SCHEMA_URL = f"https://branchdrive.org/schemas/v{SPEC_VERSION}"
"""Base of the schemas' identifiers: names, which lead nowhere."""

_JSON_TYPES = {
    "string": "string",
    "bool": "boolean",
    "int32": "integer",
    "int64": "integer",
    "float32": "number",
    "float64": "number",
}

_LIST = re.compile(r'("metrics": \[).*?(\n  \])', re.DOTALL)


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


def metric_schemas() -> dict[str, dict[str, Any]]:
    """Schemas by file name, with the names of all metrics and of those that tests compare models in."""
    protocol, results = (copy.deepcopy(load_resource(f"{name}.schema.json")) for name in ("protocol", "results"))
    targets = protocol["properties"]["targets"]["const"]
    names = metric_names(targets)
    protocol["properties"]["metrics"]["const"] = names
    kinds = {kind["properties"]["kind"]["const"]: kind for kind in protocol["properties"]["families"]["items"]["oneOf"]}
    member = kinds["prediction"]["properties"]["members"]["items"]
    member["properties"]["metric"]["enum"] = metric_names(targets, paired_only=True)
    results["$defs"]["estimate"]["properties"]["metric"]["enum"] = names
    return {"protocol.schema.json": protocol, "results.schema.json": results}


def protocol_text(text: str) -> str:
    """Text of a normative protocol with its metrics."""
    names = metric_names(load_resource("benchmark-protocol.json")["targets"])
    listed = ",".join(f'\n    "{name}"' for name in names)
    return _LIST.sub(rf"\g<1>{listed}\g<2>", text)
