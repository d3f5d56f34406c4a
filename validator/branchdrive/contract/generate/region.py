"""Regions of the chapters that are written by machine, by name.

Conditions of availability as prose. Source: spec/06-masks.md#conditions.

Markdown of the generated regions: tables, names, ranges.
"""

from __future__ import annotations

import re
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.columns import LAYER_TABLES, PATTERNS, STREAMS, TABLES, declared_table
from branchdrive.contract.encoding import ENCODING_WIDTH, encode_bank, encoding_digest
from branchdrive.contract.layer import LAYERS, table_path
from branchdrive.contract.metric import DECLARED_METRICS
from branchdrive.contract.resources import SPEC_VERSION, load_resource
from branchdrive.contract.semantic_bev import CHANNEL_MEANING, CLASS_MEANING, SemanticChannel, SemanticClass
from branchdrive.contract.timing import (
    CONTROL_HISTORY_TICKS,
    FUTURE_OBSERVATIONS,
    HISTORY_OBSERVATIONS,
    OBSERVATION_STRIDE_TICKS,
    TICK_S,
)
from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from enum import Enum

    from branchdrive.contract.policy import ActuatorRule
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from branchdrive.contract.columns import Availability, Column

__all__ = ["CONDITIONS", "REGIONS", "allowed", "code", "grid", "null", "render_regions"]

_REGION = re.compile(r"(<!-- generated: (\S+) -->\n).*?(<!-- end generated -->)", re.DOTALL)


def _columns_region(table: str) -> str:
    declared = declared_table(table)
    header = ["column", "type", "unit", "frame", "track", "values", "null", "description"]
    rows = [
        [
            f"`{c.name}`",
            c.type,
            c.unit or "",
            c.frame or "",
            c.track,
            allowed(c),
            null(c.available),
            c.description,
        ]
        for c in declared.columns
    ]
    first = [table_path(table, one) for one in declared.partitions or (None,)] if table in LAYER_TABLES else []
    files, noun = code(first or [declared.file_name]), "Files" if declared.partitions else "File"
    further = " and further parts" if table in LAYER_TABLES and declared.is_of_groups else ""
    place = f"{noun} {files}{further}, rate {declared.rate}, key {code(declared.key)}."
    return f"{declared.title}\n{place}\n\n{grid(header, rows)}"


def _streams_region() -> str:
    rows = [
        [
            f"`{s.name}`",
            s.title,
            s.rate,
            s.track,
            code(s.tables),
            code(s.cameras),
            "yes" if s.required else "no",
        ]
        for s in STREAMS.values()
    ]
    return grid(["stream", "title", "rate", "track", "tables", "cameras", "required"], rows)


def _semantic_bev_region() -> str:
    classes = [[f"{kind.value}", f"class {_words(kind)}", CLASS_MEANING[kind]] for kind in SemanticClass]
    channels = [[f"{bit.value}", f"channel {_words(bit)}", CHANNEL_MEANING[bit]] for bit in SemanticChannel]
    return grid(["value", "name", "pixels that have it"], [*classes, *channels])


def _words(member: Enum) -> str:
    return f"{member.name}".lower().replace("_", " ")


def _layer_documents_region() -> str:
    rows = [
        [
            f"`{layer.name}/{document.name}`",
            document.title,
            f"[{document.schema}](../schemas/v{SPEC_VERSION}/{document.schema})",
            "no" if document.optional else "yes",
        ]
        for layer in LAYERS.values()
        for document in layer.documents.values()
    ]
    return grid(["document", "what it says", "schema", "required"], rows)


def _patterns_region() -> str:
    rows = [[f"`{name}`", f"`{regex}`"] for name, regex in PATTERNS.items()]
    return grid(["name", "regular expression"], rows)


def _masks_region() -> str:
    masked: dict[str, list[str]] = {}
    for table in (*TABLES.values(), *LAYER_TABLES.values()):
        for column in table.columns:
            if column.available and column.available.mask:
                masked.setdefault(f"{table.name}.{column.available.mask}", []).append(column.name)
    rows = [[f"`{mask}`", code(names)] for mask, names in masked.items()]
    return grid(["mask", "columns that it governs"], rows)


def _conditions_region() -> str:
    governed: dict[str, list[str]] = {name: [] for name in CONDITIONS}
    for table in (*TABLES.values(), *LAYER_TABLES.values()):
        for column in table.columns:
            if column.available and column.available.when:
                governed[column.available.when].append(f"{table.name}.{column.name}")
    rows = [[f"`{name}`", f"present {CONDITIONS[name]}", code(names)] for name, names in governed.items()]
    return grid(["condition", "meaning", "columns"], rows)


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
    return grid(header, rows)


def _encoding_region() -> str:
    bank = load_action_bank()
    matrix = encode_bank(bank)
    first_of_family = {policy.family: row for row, policy in reversed(list(enumerate(bank.policies)))}
    representatives = sorted(first_of_family.values())
    rows = [[str(index), *(str(matrix[row, index]) for row in representatives)] for index in range(ENCODING_WIDTH)]
    table = grid(["index", *(f"`{bank.policies[row].key}`" for row in representatives)], rows)
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
        code(rule.get("streams", ())),
        code(rule.get("requires", ())),
        f"[{clause}]({clause})",
    ]


def _rules_region() -> str:
    catalogue = load_resource("rules.json")
    header = ["rule", "title", "kind", "level", "grain", "stage", "streams", "requires", "clause"]
    parts = []
    for area, title in catalogue["areas"].items():
        rows = [_rule_row(rule) for rule in catalogue["rules"] if rule["id"].startswith(f"BD-{area}-")]
        parts.append(f"### {area}: {title}\n\n{grid(header, rows)}")
    return "\n".join(parts)


def _limits_region() -> str:
    limits = load_resource("limits.json")["limits"]
    rows = [[f"`{name}`", f"{it['value']:,}", it["unit"], it["description"]] for name, it in limits.items()]
    return grid(["limit", "value", "unit", "what it bounds"], rows)


def _bounds_region() -> str:
    bounds = load_resource("limits.json")["bounds"]
    rows = [[f"`{name}`", f"{it['value']:g}", it["unit"], it["description"]] for name, it in bounds.items()]
    return grid(["bound", "value", "unit", "what it bounds, and why"], rows)


def _floors_region() -> str:
    floors = load_resource("limits.json")["floors"]
    rows = [[f"`{name}`", f"{it['value']:g}", it.get("unit", ""), it["reason"]] for name, it in floors.items()]
    return grid(["variable", "floor", "unit", "reason"], rows)


def _metrics_region() -> str:
    rows = [
        [
            f"`{metric.name}`" + (" and the target" if metric.per_target else ""),
            metric.title,
            "that of the target" if metric.unit == "target" else metric.unit,
            str(metric.best),
            "yes" if metric.paired else "no",
            metric.description,
        ]
        for metric in DECLARED_METRICS
    ]
    return grid(["metric", "title", "unit", "best", "tested", "what it is"], rows)


def _protocol_region() -> str:
    protocol, bank = load_resource("benchmark-protocol.json"), load_action_bank()
    use, counts = protocol["partitions"], protocol["statistics"]
    families = list(dict.fromkeys(policy.family for policy in bank.policies if policy is not bank.nominal))
    models = ", ".join(f"`{m['id']}` of {len(m['seeds'])}" for m in protocol["models"])
    profiles = "; ".join(
        f"`{p['name']}` {p['separation']:.2g}, {p['displacement']:.2g}, {p['comfort']:.2g}"
        + (f" with a near range of {p['near_m']:g} m" if "near_m" in p else "")
        for p in protocol["profiles"]
    )
    tests = ", ".join(f"`{f['name']}` {len(f['members'])}" for f in protocol["families"])
    window_s = FUTURE_OBSERVATIONS * OBSERVATION_STRIDE_TICKS * TICK_S
    rows = [
        ["protocol", f"`{protocol['name']}` {protocol['version']}"],
        ["statistical unit", f"a branch group with {len(bank.policies)} candidate futures; claims by route clusters"],
        ["population", "the frozen population of a release, in its partitions"],
        [
            "canonical history",
            f"{HISTORY_OBSERVATIONS} state frames, {OBSERVATION_STRIDE_TICKS * TICK_S:g} s apart, and "
            f"{CONTROL_HISTORY_TICKS} controls, {TICK_S:g} s apart",
        ],
        ["candidate bank", f"nominal and {len(bank.policies) - 1} interventions of the families {code(families)}"],
        ["action encoding", f"{ENCODING_WIDTH} numbers: family, magnitude, duration, rules of the actuators, recovery"],
        ["horizon", f"{FUTURE_OBSERVATIONS} saved frames over {window_s:g} s"],
        ["scalar targets", code(protocol["targets"])],
        ["trajectory target", f"{code(protocol['trajectory'])} at each frame"],
        ["scales", f"from `{use['fit']}` alone; what is not available is masked"],
        ["models and seeds", models],
        ["fitted, chosen, calibrated, reported", code(use[name] for name in ("fit", "select", "calibrate", "report"))],
        [
            "test protocol",
            "models and metrics are locked, then selections; every access of `test` is recorded",
        ],
        [
            "statistics",
            f"{counts['resamples']} resamples and {counts['flips']} sign flips, of groups and of clusters; intervals "
            f"of {100 * counts['level']:g} %",
        ],
        ["families of tests", tests],
        ["selectors", code(protocol["selectors"])],
        ["utility profiles: separation, displacement, comfort", profiles],
        ["guard", ", ".join(f"`{name}` {value}" for name, value in protocol["guard"].items())],
        ["excluded claims", "binary safety, null-equivalence, causality, closed-loop benefit"],
    ]
    return grid(["item", "frozen protocol"], rows)


REGIONS: Mapping[str, Callable[[], str]] = MappingProxyType(
    {
        "streams": _streams_region,
        "semantic-bev": _semantic_bev_region,
        "layer-documents": _layer_documents_region,
        "patterns": _patterns_region,
        "masks": _masks_region,
        "conditions": _conditions_region,
        "bank": _bank_region,
        "encoding": _encoding_region,
        "rules": _rules_region,
        "limits": _limits_region,
        "bounds": _bounds_region,
        "floors": _floors_region,
        "metrics": _metrics_region,
        "protocol": _protocol_region,
        **{f"columns-{table}": partial(_columns_region, table) for table in (*TABLES, *LAYER_TABLES)},
    }
)
"""Markdown of every generated region, by name."""


def render_regions(text: str) -> str:
    """`text` of a chapter with every generated region rendered again.

    Raises:
        UsageError: A region has a name that `REGIONS` does not know.
    """

    def region(match: re.Match[str]) -> str:
        opening, name, closing = match.groups()
        if name not in REGIONS:
            raise UsageError(f"generated region {name!r} is unknown; there are {sorted(REGIONS)}")
        return f"{opening}\n{REGIONS[name]()}\n{closing}"

    return _REGION.sub(region, text)


CONDITIONS: Mapping[str, str] = MappingProxyType(
    {
        "branched": "exactly where the row has a `branch_tick`",
        "not_complete": "exactly where `status` is not `complete`",
        "not_nominal": "exactly where `role` is not `nominal`",
        "valued": "exactly where the rule column of the same actuator is `absolute` or `floor`",
        "active": "exactly where `active` is true",
        "recorded": "exactly where `unrecorded` of the descriptor lists neither the column nor the one it follows from",
        "optional": "wherever the collector could know it",
    }
)
"""When a value of a conditional column is present, by the name of the condition."""


def grid(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table; every cell is one line."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def code(names: Iterable[str]) -> str:
    """Names in back-ticks, separated by commas."""
    return ", ".join(f"`{name}`" for name in names)


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(value)


def allowed(column: Column) -> str:
    """Vocabulary, pattern or range of a column; empty where anything of its type is allowed."""
    if column.values:
        return code(column.values)
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


def null(available: Availability | None) -> str:
    """When a column may hold a null."""
    if available is None:
        return "never"
    return f"mask `{available.mask}`" if available.mask else f"condition `{available.when}`"
