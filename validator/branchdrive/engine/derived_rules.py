"""Rules on the derived layers: on the layers as a whole, or on the rows of one part.

Rules of the scope `layer_rows` compare stored rows with what raw rows of the same groups give, so they are judged
part by part, on the files of the part and on the shards that it is of; totals add up. Rules of the scope `layers` are
judged on the whole, many of them by pieces that the tasks of parts give. Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import paths_by_table
from branchdrive.contract.mismatch import Check, Location, Mismatch
from branchdrive.contract.rule import CATALOGUE, PIECES, RULES
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
        pieces_for: Rules on the whole that get pieces from this part.
        parts: Parts that gave pieces; none where rows of a part are not those of its groups.
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
    pieces_for: tuple[str, ...] = ()
    parts: tuple[int, ...] = ()


@dataclass
class LayersResult:
    """What became of the rules.

    Attributes:
        tallies: Their totals.
        population: The population, if its rule is among them and passes.
        pieces: Names of the pieces that were put into the spool.
    """

    tallies: dict[str, Tally] = field(default_factory=dict)
    population: dict[str, Any] | None = None
    pieces: list[str] = field(default_factory=list)


def judge_part(task: LayersTask) -> LayersResult:
    """Judge the rules of a task, and put the pieces that rules on the whole take of this part into the spool."""
    view = view_of(task)
    with memory_limit(task.max_bytes):
        tallies, _ = judge_layers(view, task.rules, task.broken)
        pieces = _put_pieces(task, view)
    from branchdrive.quality.rules.qualification import POPULATION

    holds = POPULATION_RULE in tallies and tallies[POPULATION_RULE].status == "pass"
    return LayersResult(tallies, view.document(POPULATION) if holds else None, pieces)


@np.errstate(all="ignore")
def _put_pieces(task: LayersTask, view: ReleaseView) -> list[str]:
    """Names of the pieces that this part has; who needs another one takes all rows, and says what is wrong of them."""
    names: list[str] = []
    for rule_id in task.pieces_for:
        info = CATALOGUE[rule_id]
        if info.layer is None or not view.claims(info.layer):
            continue
        bind_rules(info.layer)
        for piece in PIECES[rule_id]:
            name = _piece_name(task.part, piece)
            if name not in names:
                for value in _piece_if_any(piece, _trusted(view, rule_id, task.broken)):
                    task.spool.put(name, value)
                    names.append(name)
    return names


def _piece_if_any(piece: Callable[[ReleaseView], Any], view: ReleaseView) -> list[Any]:
    try:
        return [piece(view)]
    except MemoryError:
        raise
    except Exception:  # the rule takes all rows then, which fail in the same way, and is told of
        return []


def _piece_name(part: int | None, piece: Callable[[ReleaseView], Any]) -> str:
    return f"part-{part}.{piece.__module__}.{piece.__qualname__}"


def _trusted(view: ReleaseView, rule_id: str, broken: Mapping[str, frozenset[str]]) -> ReleaseView:
    """The view without the tables that fail what the rule requires."""
    return view.without({name for other in CATALOGUE[rule_id].requires for name in broken.get(other, ())})


def _given_pieces(task: LayersTask, piece: Callable[[ReleaseView], Any]) -> list[Any] | None:
    names = [_piece_name(part, piece) for part in task.parts]
    return [task.spool.get(name) for name in names] if names and all(map(task.spool.has, names)) else None


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
        pieces_of=partial(_given_pieces, task),
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
    shards = [SpooledFrames(task.spool, [shard], raw.names) for shard in raw.shards]
    return RawLayer(rows, shards=shards, digest=raw.digest, descriptor=raw.descriptor)


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
            bad = judge(tally, partial(RULES[rule_id], _trusted(view, rule_id, broken)), partial(_mismatches, view))
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
