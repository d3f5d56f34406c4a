"""Rules on the derived layers: on the layers as a whole, or on the rows of one part.

Rules of the scope `layer_rows` compare stored rows with what raw rows of the same groups give, so they are judged
part by part, on the files of the part and on the shards that it is of; totals add up. Rules of the scope `layers` need
all rows. Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import paths_by_table
from branchdrive.contract.mismatch import Check, Location, Mismatch
from branchdrive.contract.rule import CATALOGUE, RULES
from branchdrive.engine.judge import judge
from branchdrive.engine.rules import bind_rules
from branchdrive.engine.spool import Spool, SpooledFrames, SpooledTables
from branchdrive.engine.tally import Tally
from branchdrive.layers.compare import key_of
from branchdrive.layers.view import RawLayer, ReleaseView
from branchdrive.runtime.executor import memory_limit
from branchdrive.tables.frame import Frame, take

__all__ = ["POPULATION_RULE", "LayersResult", "LayersTask", "RawRows", "judge_layers", "judge_part", "view_of"]

POPULATION_RULE = "BD-QUA-011"
"""The rule that a population must pass before a report shows it."""


@dataclass(frozen=True)
class RawRows:
    """Rows that the raw layer gives for the derived ones, in a spool; none where `reason` says why.

    Attributes:
        shards: Prefixes of the shards in the spool.
        is_own: Whether their rows are those to compare with; else there are none, and they say what columns are.
        names: Frames of each shard.
        reason: Why there are none.
        digest: Digest of the content of the raw layer; ``None`` where it is not known.
        descriptor: Its dataset's descriptor; ``None`` where it is unusable.
    """

    shards: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    is_own: bool = True
    reason: str = ""
    digest: str | None = None
    descriptor: Descriptor | None = None


@dataclass(frozen=True, kw_only=True)
class LayersTask:
    """What a worker needs to judge rules on the derived layers, or on a part of their rows.

    Attributes:
        rules: The rules, in order of the catalogue.
        part: Number of the part whose rows are judged; ``None`` where they are of several.
        raw: Rows of the raw layer: of the shards of the part, or of all shards.
        spool: Where tables, documents and rows are.
        descriptor: The dataset's descriptor.
        tables: Tables all of whose files are in the spool.
        num_rows: Rows of each of their files, of the part and of no part.
        names: Files of the layers and beside them, of the part and of no part.
        digests: SHA-256 of them; empty where digests were not computed.
        sizes: Bytes of the checkpoints.
        broken: Tables that fail each rule on structure.
        content: Digest of what each table and document says; empty where digests were not computed.
        max_bytes: Private memory that the process may take.
    """

    rules: tuple[str, ...]
    part: int | None
    raw: RawRows
    spool: Spool
    descriptor: Descriptor
    tables: tuple[str, ...]
    num_rows: Mapping[str, int]
    names: tuple[str, ...]
    digests: Mapping[str, str]
    sizes: Mapping[str, int]
    broken: Mapping[str, frozenset[str]]
    content: Mapping[str, str]
    max_bytes: int


@dataclass
class LayersResult:
    """What became of the rules: their totals, and the population if its rule is among them and passes."""

    tallies: dict[str, Tally] = field(default_factory=dict)
    population: dict[str, Any] | None = None


def judge_part(task: LayersTask) -> LayersResult:
    """Judge the rules of a task."""
    view = view_of(task)
    with memory_limit(task.max_bytes):
        tallies, _ = judge_layers(view, task.rules, task.broken)
    from branchdrive.quality.rules.qualification import POPULATION

    holds = POPULATION_RULE in tallies and tallies[POPULATION_RULE].status == "pass"
    return LayersResult(tallies, view.document(POPULATION) if holds else None)


def view_of(task: LayersTask) -> ReleaseView:
    """What the rules of a task see."""
    paths = paths_by_table(task.num_rows)
    return ReleaseView(
        task.descriptor,
        SpooledTables(task.spool, {name: paths.get(name, ()) for name in task.tables}),
        task.spool.get("documents"),
        task.spool.get("contents"),
        _raw_layer(task),
        frozenset(task.names),
        digests=task.digests,
        num_rows=task.num_rows,
        part=task.part,
        sizes=task.sizes,
        content=task.content,
    )


def _raw_layer(task: LayersTask) -> RawLayer:
    raw = task.raw
    if raw.reason:
        return RawLayer(None, raw.reason, digest=raw.digest, descriptor=raw.descriptor)
    rows: Mapping[str, Frame] = SpooledFrames(task.spool, raw.shards, raw.names)
    if not raw.is_own:
        none = np.zeros(0, np.int64)
        rows = {name: take(frame, none) for name, frame in rows.items()}
    return RawLayer(rows, digest=raw.digest, descriptor=raw.descriptor)


@np.errstate(all="ignore")  # what overflows or is not a number is found by the rules, not by warnings
def judge_layers(
    view: ReleaseView, rule_ids: Iterable[str], broken_before: Mapping[str, frozenset[str]] = MappingProxyType({})
) -> tuple[dict[str, Tally], dict[str, frozenset[str]]]:
    """Judge rules on derived layers in order; tables that fail a rule are kept from those that require it.

    Args:
        view: The layers, or a part of their rows.
        rule_ids: Rules of the scopes `layers` and `layer_rows`, in order of the catalogue.
        broken_before: Tables that fail rules that were judged before.

    Returns:
        Totals of the rules, and the tables that fail each.
    """
    tallies, broken = {}, dict(broken_before)
    for rule_id in rule_ids:
        info = CATALOGUE[rule_id]
        tally = tallies[rule_id] = Tally(rule_id, is_claimed=info.layer is None or view.claims(info.layer))
        if tally.is_claimed:
            bind_rules(info.layer)
            trusted = view.without({name for other in info.requires for name in broken.get(other, ())})
            bad = judge(tally, partial(RULES[rule_id], trusted), partial(_mismatches, view))
            broken[rule_id] = frozenset(check.table for check in bad if check.table is not None)
    return tallies, broken


def _mismatches(view: ReleaseView, check: Check) -> Iterator[Mismatch]:
    for row in check.bad.tolist():
        found = check.mismatch(row)
        if check.table is not None:
            found = found.within(_row_location(view, check.table, row))
        yield found


def _row_location(view: ReleaseView, name: str, row: int) -> Location:
    """Location of a row: by its key, or by its number where a part of the key is null."""
    path, number = view.file_of(name, row)
    if all(view.tables[name][part][row].is_valid for part in LAYER_TABLES[name].key):
        return {"file": path, "table": name, **key_of(name, view.rows(name), row)}
    return {"file": path, "table": name, "row": number}
