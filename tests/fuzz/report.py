"""The summary of a run: what was tried, what came of it, and which share of cell edits each column's rules catch."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from tests.fuzz.cell import SUBTLE

__all__ = ["render", "summary"]

Row = Mapping[str, Any]


def summary(rows: Iterable[Row], planned: int) -> dict[str, Any]:
    """Figures of results, which are documents of `Result`.

    Of a cell edit, `caught` says that a rule's status or number of findings differs from the valid dataset's, and
    ``subtle`` are edits with values that the declaration of the column allows.
    """
    rows = sorted(rows, key=lambda row: row["index"])
    columns: dict[str, Counter[str]] = defaultdict(Counter)
    catchers: dict[str, Counter[str]] = defaultdict(Counter)
    damages: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        damages[row["damage"]]["tried"] += 1
        damages[row["damage"]][row["verdict"] or "none"] += 1
        damages[row["damage"]]["sealed"] += row["is_sealed"]
        if row["column"]:
            seen = columns[row["column"]]
            is_subtle, is_caught = row["kind"] in SUBTLE, bool(row["rules"])
            seen.update(tried=1, caught=is_caught, subtle=is_subtle, subtle_caught=is_subtle and is_caught)
            catchers[row["column"]].update(row["rules"])
    return {
        "planned": planned,
        "tried": len(rows),
        "sealed": sum(row["is_sealed"] for row in rows),
        "changed": sum(row["is_changed"] for row in rows),
        "verdicts": dict(sorted(Counter(row["verdict"] or "none" for row in rows).items())),
        "bases": dict(sorted(Counter(row["base"] for row in rows).items())),
        "failures": [dict(row) for row in rows if row["failure"]],
        "cpu_s": sum(row["cpu_s"] for row in rows),
        "slowest": dict(max(rows, key=lambda row: row["cpu_s"])) if rows else None,
        "largest": dict(max(rows, key=lambda row: row["memory_bytes"])) if rows else None,
        "damages": {name: dict(sorted(seen.items())) for name, seen in sorted(damages.items())},
        "columns": {
            name: {**seen, "rules": [rule for rule, _ in catchers[name].most_common(3)]}
            for name, seen in sorted(columns.items(), key=lambda item: (_share(item[1]), item[0]))
        },
    }


def _share(seen: Mapping[str, int]) -> float:
    return seen["caught"] / seen["tried"]


def render(found: Mapping[str, Any], *, is_full: bool = True) -> str:
    """The summary as text; not `is_full`, with the twenty columns whose edits are caught least."""
    lines = [
        f"fuzz: {found['tried']:,} of {found['planned']:,} damaged datasets, {found['sealed']:,} of them with a "
        f"manifest that agrees, {found['changed']:,} that differ from the valid one",
        "verdicts: " + ", ".join(f"{name} {count:,}" for name, count in found["verdicts"].items()),
        "of: " + ", ".join(f"{name} {count:,}" for name, count in found["bases"].items()),
        f"failures (tracebacks, exit code 4, hangs, bounds, writes outside): {len(found['failures'])}",
    ]
    lines += [
        f"  case {row['index']} ({row['base']}, {row['damage']}: {row['what']}): "
        f"{row['failure'].strip().splitlines()[-1]}"
        for row in found["failures"]
    ]
    for name, unit, value in (
        ("slowest", "s", lambda row: f"{row['cpu_s']:.1f}"),
        ("largest", "MiB", lambda row: f"{row['memory_bytes'] / 2**20:.0f}"),
    ):
        if (row := found[name]) is not None:
            lines.append(f"{name}: {value(row)} {unit}, case {row['index']}, {row['damage']}: {row['what']}")
    lines += ["", f"{'damage':<14}{'tried':>8}{'sealed':>8}  verdicts"]
    for name, seen in found["damages"].items():
        verdicts = {word: count for word, count in seen.items() if word not in ("tried", "sealed")}
        counts = ", ".join(f"{word} {count}" for word, count in verdicts.items())
        lines.append(f"{name:<14}{seen['tried']:>8}{seen['sealed']:>8}  {counts}")
    columns = list(found["columns"].items())
    shown = columns if is_full else columns[:20]
    lines += ["", f"{'column':<56}{'edits':>6}{'caught':>8}{'subtle':>8}{'caught':>8}  rules"]
    for name, seen in shown:
        subtle = f"{seen['subtle_caught'] / seen['subtle']:.0%}" if seen["subtle"] else "-"
        lines.append(
            f"{name:<56}{seen['tried']:>6}{_share(seen):>8.0%}{seen['subtle']:>8}{subtle:>8}  {' '.join(seen['rules'])}"
        )
    if len(shown) < len(columns):
        lines.append(f"... and {len(columns) - len(shown)} more columns")
    return "\n".join(line.rstrip() for line in lines) + "\n"
