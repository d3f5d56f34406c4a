"""The second step of a validation: rules on the derived layers, as a map over parts and a few tasks on the whole.

Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import LAYERS, part_of, paths_by_table, table_file
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.rule import CATALOGUE, rules_of
from branchdrive.contract.text import counted
from branchdrive.engine.derived_files import STRUCTURE_RULES, LayerFiles, LayerFilesTask
from branchdrive.engine.derived_rules import POPULATION_RULE, LayersResult, LayersTask, RawRows, judge_part
from branchdrive.engine.reading import Reading
from branchdrive.engine.shard import ShardResult, spooled_name
from branchdrive.engine.tally import Tally
from branchdrive.raw.content import raw_content
from branchdrive.runtime.executor import Died, Executor, Failed

__all__ = ["MAX_GROUPS_AT_ONCE", "Derived", "judge_derived", "layers_tasks"]

_FAILED = "the derived layers could not be judged"

MAX_GROUPS_AT_ONCE = 32
"""Groups of the raw layer up to which its derived layers are judged in one task."""

_LONG = ("BD-LKG", "BD-BMK")
"""Areas whose rules take long enough for a task of their own."""


@dataclass
class Derived:
    """What became of the derived layers.

    Attributes:
        tallies: Totals of the selected rules on them; empty where no layer is claimed.
        digests: SHA-256 of their files, by path.
        unreadable: Why files could not be read, by path.
        population: The stored population by partition; ``None`` without one that recomputes.
        content: Digest of what each table and document says, by path.
    """

    tallies: dict[str, Tally] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    population: dict[str, Any] | None = None
    content: dict[str, str] = field(default_factory=dict)


def judge_derived(
    reading: Reading, selected: frozenset[str], executor: Executor, max_bytes: int | None = None
) -> Derived:
    """Judge the selected rules on the derived layers.

    A process that dies of a task is no verdict on data: what it was to judge is inconclusive.

    Args:
        reading: What was read; failures of the tool are added to it.
        selected: Rules to run.
        executor: How tasks are run.
        max_bytes: Private memory of a process that judges the whole dataset; that of the specification by default.
    """
    if not reading.tasks:
        return Derived()
    files = reading.layers
    rules = [rule_id for rule_id in rules_of("layers", "layer_rows") if rule_id in selected]
    if files is None:
        return Derived({rule_id: Tally(rule_id, unjudged=_FAILED) for rule_id in rules})
    tallies = {rule_id: files.tallies.get(rule_id, Tally(rule_id)) for rule_id in rules}
    population = None
    if files.unjudged is not None:
        for tally in tallies.values():
            tally.add(Tally(tally.rule_id, unjudged=files.unjudged, is_exceeded=files.is_exceeded))
    else:
        for tasks in layers_tasks(reading, files, selected, max_bytes):
            outcomes = dict(executor(judge_part, tasks)) if tasks else {}
            for index, task in enumerate(tasks):
                outcome = outcomes[index]
                if not isinstance(outcome, LayersResult):
                    outcome = _unjudged(task, outcome, reading)
                for rule_id in outcome.tallies.keys() & tallies.keys():
                    tallies[rule_id].add(outcome.tallies[rule_id])
                population = population or outcome.population
    return Derived(tallies, files.digests, files.unreadable, population, files.content)


def _unjudged(task: LayersTask, outcome: Died | Failed, reading: Reading) -> LayersResult:
    """Tallies of a task that failed, or that took more memory than there is, with what it held."""
    if isinstance(outcome, Failed):
        reading.errors.append(f"derived layers: {outcome.message}")
        return LayersResult({rule_id: Tally(rule_id, unjudged=_FAILED) for rule_id in task.rules})
    groups = sum(num_rows for path, num_rows in task.num_rows.items() if _table_of(path) == "group_quality")
    needed = (
        f"judging {counted(groups, 'group')} with {counted(sum(task.num_rows.values()), 'row')} of derived tables took "
        f"more than {task.max_bytes / 2**30:.1f} GiB of memory"
    )
    is_whole = task.names == reading.tasks[0].names
    advice = "; allow more with `--dataset-memory`" if is_whole else ""
    return LayersResult({rule_id: Tally(rule_id, unjudged=needed + advice, is_exceeded=True) for rule_id in task.rules})


def layers_tasks(
    reading: Reading, files: LayerFiles, selected: frozenset[str], max_bytes: int | None = None
) -> Iterator[list[LayersTask]]:
    """Tasks of each part, and then tasks on the whole, the longest first, which may take pieces of the parts.

    A raw layer of a few groups of one part is one task: what starting more of them takes would be most of their time.
    Where there is one part, tasks on the whole wait for nothing.
    """
    wanted = selected | {POPULATION_RULE}
    whole = [r for r in rules_of("layers", "layer_rows") if r in wanted and r not in STRUCTURE_RULES]
    rows = [rule_id for rule_id in whole if CATALOGUE[rule_id].scope == "layer_rows"]
    others, shards = reading.tasks[0], reading.shards
    shards_of: dict[int, list[ShardResult]] = {}
    for shard in shards:
        shards_of.setdefault(part_of(shard.folder), []).append(shard)
    files_of = {task.part: task.files for task in reading.tasks[1:]}
    parts = sorted({*shards_of, *(part for part in files_of if part is not None)})
    raw = _raw_rows(reading.source.descriptor, shards)
    every = LayersTask(
        rules=(),
        part=parts[0] if len(parts) == 1 else None,
        raw=raw,
        spool=others.spool,
        descriptor=others.descriptor,
        tables=_whole_tables(files, others),
        num_rows=files.num_rows,
        names=others.names,
        digests=files.digests,
        sizes=files.sizes,
        broken=files.broken,
        content=files.content,
        max_bytes=max_bytes or spec_limits().max_dataset_worker_bytes,
    )
    if len(parts) <= 1 and shards and sum(len(shard.group_ids) for shard in shards) <= MAX_GROUPS_AT_ONCE:
        yield [replace(every, rules=tuple(whole))]
        return
    is_divided = bool(raw.shards) or len(parts) > 1
    if is_divided:
        whole = [rule_id for rule_id in whole if rule_id not in rows]
    areas = [[rule_id for rule_id in whole if rule_id.startswith(area)] for area in _LONG]
    areas.append([rule_id for rule_id in whole if not rule_id.startswith(_LONG)])
    gives_pieces = len(parts) > 1 and _are_in_place(files)
    on_whole = [
        replace(every, rules=tuple(rules), parts=tuple(parts) if gives_pieces else ()) for rules in areas if rules
    ]
    of_parts = [
        _task_of_part(
            every, part, (*others.files, *files_of.get(part, ())), files, _of_part(raw, shards_of.get(part, ()))
        )
        for part in (parts if is_divided else ())
    ]
    of_parts = [replace(task, rules=tuple(rows), pieces_for=tuple(whole) if gives_pieces else ()) for task in of_parts]
    of_parts = [task for task in of_parts if task.rules or task.pieces_for]
    if gives_pieces:
        yield of_parts
        yield on_whole
    else:
        yield [*on_whole, *of_parts]


def _task_of_part(every: LayersTask, part: int, names: tuple[str, ...], files: LayerFiles, raw: RawRows) -> LayersTask:
    """The task of a part, of its files and those of no part."""
    return replace(
        every,
        part=part,
        raw=raw,
        num_rows={path: files.num_rows[path] for path in names if path in files.num_rows},
        names=names,
        digests={path: files.digests[path] for path in names if path in files.digests},
        content={path: files.content[path] for path in names if path in files.content},
        max_bytes=spec_limits().max_worker_bytes,
    )


def _are_in_place(files: LayerFiles) -> bool:
    """Whether rows of each group lie in one part: what a part gives is of its groups then, and of no others."""
    return not files.foreign and not files.broken.get("BD-LYR-010")


def _whole_tables(files: LayerFiles, task: LayerFilesTask) -> tuple[str, ...]:
    """Tables that have all their files, each of which decodes with the declared columns."""
    missing = {_table_of(path) for name in task.descriptor.derived_layers for path in LAYERS[name].missing(task.names)}
    paths = paths_by_table(task.names)
    whole = {name for name, own in paths.items() if name not in missing and files.num_rows.keys() >= {*own}}
    return tuple(name for name in LAYER_TABLES if name in whole)


def _table_of(path: str) -> str | None:
    file = table_file(path)
    return file.table if file else None


def _of_part(raw: RawRows, shards: Sequence[ShardResult]) -> RawRows:
    if not raw.shards:
        return raw
    own = tuple(spooled_name(shard.folder) for shard in shards)
    return replace(raw, shards=own or raw.shards[:1], is_own=bool(own))


def _raw_rows(descriptor: Descriptor | None, shards: Sequence[ShardResult]) -> RawRows:
    if not shards:
        return RawRows(reason="the raw layer is not available; give its dataset with --raw")
    digest = raw_content(shards)
    reason = next((shard.no_frames for shard in shards if not shard.frames), "")
    if not reason and descriptor is None:
        reason = "the descriptor beside the raw layer is unusable"
    if reason:
        return RawRows(reason=reason, digest=digest, descriptor=descriptor)
    names = tuple(spooled_name(shard.folder) for shard in shards)
    return RawRows(names, shards[0].frames, digest=digest, descriptor=descriptor)
