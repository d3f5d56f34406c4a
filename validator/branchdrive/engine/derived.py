"""The second step of a validation: rules on the derived layers, as a map over shards and a few tasks on the whole.

Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.rule import CATALOGUE, rules_of
from branchdrive.engine.derived_files import STRUCTURE_RULES, LayerFiles
from branchdrive.engine.derived_rules import POPULATION_RULE, LayersResult, LayersTask, RawRows, judge_part
from branchdrive.engine.finding import Finding
from branchdrive.engine.reading import Reading
from branchdrive.engine.shard import ShardResult, spooled_name
from branchdrive.engine.tally import Tally
from branchdrive.raw.content import raw_content
from branchdrive.runtime.executor import Executor, Failed

__all__ = ["MAX_GROUPS_AT_ONCE", "Derived", "judge_derived", "layers_tasks"]

_DECODING = "BD-LYR-002"
"""The rule that tables of derived layers decode within the limits."""

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


def judge_derived(reading: Reading, selected: frozenset[str], executor: Executor) -> Derived:
    """Judge the selected rules on the derived layers.

    Args:
        reading: What was read; failures of the tool are added to it.
        selected: Rules to run.
        executor: How tasks are run.
    """
    if reading.task is None:
        return Derived()
    files = reading.layers
    rules = [rule_id for rule_id in rules_of("layers", "layer_rows") if rule_id in selected]
    if files is None:
        return Derived(_unjudged(rules, is_killed=not reading.errors))
    tallies, population = dict(files.tallies), None
    for _, outcome in executor(judge_part, list(layers_tasks(reading, files, selected))):
        if isinstance(outcome, LayersResult):
            for rule_id, tally in outcome.tallies.items():
                if rule_id in tallies:
                    tallies[rule_id].add(tally)
                else:
                    tallies[rule_id] = tally
            population = population or outcome.population
        else:
            if isinstance(outcome, Failed):
                reading.errors.append(f"derived layers: {outcome.message}")
            return Derived(
                _unjudged(rules, is_killed=not isinstance(outcome, Failed)),
                files.digests,
                files.unreadable,
                content=files.content,
            )
    judged = {rule_id: tallies[rule_id] for rule_id in rules if rule_id in tallies}
    return Derived(judged, files.digests, files.unreadable, population, files.content)


def _unjudged(rules: Sequence[str], *, is_killed: bool) -> dict[str, Tally]:
    """Tallies where a process failed; one that was killed twice within the memory limit met files that need more."""
    unjudged = {rule_id: Tally(rule_id, unjudged="the derived layers could not be judged") for rule_id in rules}
    if is_killed and _DECODING in unjudged:
        killed_by = Mismatch({}, "tables that decode within the memory limit", "a process that died of them, twice")
        killed = unjudged[_DECODING] = Tally(_DECODING, examined=1, total=1, num_findings=1)
        killed.keep([Finding.of(_DECODING, killed_by)])
    return unjudged


def layers_tasks(reading: Reading, files: LayerFiles, selected: frozenset[str]) -> Iterator[LayersTask]:
    """Tasks on the whole, the longest first, and then one for each shard and one for the rows of no shard.

    A raw layer of a few groups is one task: what starting more of them takes would be most of their time.
    """
    wanted = selected | {POPULATION_RULE}
    whole = [r for r in rules_of("layers", "layer_rows") if r in wanted and r not in STRUCTURE_RULES]
    rows = [rule_id for rule_id in whole if CATALOGUE[rule_id].scope == "layer_rows"]
    shards, task = reading.shards, reading.task
    if task is None:
        return
    raw = _raw_rows(reading.source.descriptor, shards)
    every = LayersTask(
        rules=(),
        part="all",
        identities=frozenset(),
        raw=raw,
        spool=task.spool,
        descriptor=task.descriptor,
        tables=files.tables,
        documents=files.documents,
        names=task.names,
        digests=files.digests,
        sizes=files.sizes,
        broken=files.broken,
        content=files.content,
    )
    if shards and sum(len(shard.group_ids) for shard in shards) <= MAX_GROUPS_AT_ONCE:
        yield replace(every, rules=tuple(whole))
        return
    if raw.shards:
        whole = [rule_id for rule_id in whole if rule_id not in rows]
    for area in _LONG:
        yield replace(every, rules=tuple(r for r in whole if r.startswith(area)))
    yield replace(every, rules=tuple(r for r in whole if not r.startswith(_LONG)))
    if not (raw.shards and rows):
        return
    for shard in shards:
        own = replace(raw, shards=(spooled_name(shard.folder),))
        identities = frozenset((*shard.rollout_ids, *shard.group_ids))
        yield replace(every, rules=tuple(rows), part="shard", identities=identities, raw=own)
    of_all_shards = frozenset(identity for shard in shards for identity in (*shard.rollout_ids, *shard.group_ids))
    yield replace(every, rules=tuple(rows), part="no_shard", identities=of_all_shards)


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
