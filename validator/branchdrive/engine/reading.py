"""The first step of a validation: every file is read once, by workers; shards are judged, layers are spooled.

Shards that repeat an identity of an attempt, or hold a part of a group, are read once more when all identities are
known, so that these attempts are left out of their rules and cost their groups. What was read last counts.
Source: spec/07-rules.md#trust.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import paths_by_table, table_paths
from branchdrive.contract.media import MediaMode
from branchdrive.engine.derived_files import (
    LayerFiles,
    LayerFilesTask,
    killed,
    layer_files_tasks,
    needs_raw,
    read_layers,
)
from branchdrive.engine.derived_places import GroupsTask, empty_parts, find_groups, misplaced
from branchdrive.engine.shard import ShardResult, ShardTask, audit_shard
from branchdrive.engine.spool import Spool
from branchdrive.files.shard_facts import repeated_rollouts, scattered_groups
from branchdrive.files.survey import Survey
from branchdrive.runtime.executor import Executor, Failed

__all__ = ["Progress", "Reading", "read_dataset"]

Progress = Callable[[int, int], None]
"""Called with the number of finished shards and the number of shards."""


@dataclass
class Reading:
    """What was read of a dataset.

    Attributes:
        source: The dataset with the shards, and what they say.
        tasks: What reads the derived layers; none where there are none, or they are not asked for.
        shards: Results of all shards, in order of their folders.
        layers: The derived layers; ``None`` where there are none, or reading them failed.
        errors: Failures of the tool.
    """

    source: Survey
    tasks: tuple[LayerFilesTask, ...]
    shards: list[ShardResult] = field(default_factory=list)
    layers: LayerFiles | None = None
    errors: list[str] = field(default_factory=list)


def read_dataset(
    survey: Survey,
    selected: frozenset[str],
    executor: Executor,
    progress: Progress | None = None,
    *,
    spool: Spool | None = None,
    release: Survey | None = None,
    optional: Collection[str] = (),
    media: MediaMode = "full",
) -> Reading:
    """Read and judge all shards, and read the derived layers beside them.

    Args:
        survey: The dataset with the shards.
        selected: Rules to run on rows.
        executor: How shards are run.
        progress: Called after every shard.
        spool: Where layers are put, and rows of shards for them; ``None`` where they are not needed.
        release: The dataset with the derived layers, this one or another; shards put rows where its rules take them.
        optional: Optional tables that shards put rows for where there is no `release`, whose own count.
        media: How many images are decoded.
    """
    reading = Reading(survey, () if release is None else layer_files_tasks(release, spool))
    rows = spool if release is None or needs_raw(release, selected) else None
    there = optional if release is None else paths_by_table(release.release_files)
    wanted = frozenset(name for name in there if rows and LAYER_TABLES[name].optional)
    shards: list[ShardTask] = []
    for folder, files in survey.shard_folders.items():
        paths = tuple(entry.path for entry in files)
        shards.append(
            ShardTask(
                survey.folder.only(paths),
                folder,
                paths,
                survey.descriptor,
                selected,
                survey.is_hashed,
                spool=rows,
                optional=wanted,
                media=media,
            )
        )
    if progress:
        progress(0, len(shards))
    results, parts = _run([*reading.tasks, *shards], executor, reading, progress)
    if reading.tasks and None not in parts:
        reading.layers = _joined([part for part in parts if part], reading, executor)
    results |= _run(_with_repeats(shards, list(results.values())), executor, reading)[0]
    reading.shards = [results[task.folder] for task in shards]
    reading.source = survey.with_shards(tuple(reading.shards))
    return reading


def _with_repeats(tasks: Sequence[ShardTask], results: Sequence[ShardResult]) -> list[ShardTask]:
    """Tasks of the shards with identities that the dataset repeats, which know them now."""
    rollouts, groups = repeated_rollouts(results).keys(), scattered_groups(results).keys()
    of_folder = {result.folder: result for result in results}
    again = [
        replace(
            task,
            repeated_rollouts=frozenset(rollouts & set(of_folder[task.folder].rollout_ids)),
            scattered_groups=frozenset(groups & set(of_folder[task.folder].group_ids)),
        )
        for task in tasks
    ]
    return [task for task in again if task.repeated_rollouts or task.scattered_groups]


def _run(
    tasks: Sequence[ShardTask | LayerFilesTask], executor: Executor, reading: Reading, progress: Progress | None = None
) -> tuple[dict[str, ShardResult], list[LayerFiles | None]]:
    """Results of shards by folder, and of files of layers in order, ``None`` for a failure, which `reading` notes."""
    results: dict[str, ShardResult] = {}
    parts: dict[int, LayerFiles | None] = {}
    num_shards = sum(isinstance(task, ShardTask) for task in tasks)
    for index, outcome in executor(_read, tasks):
        task = tasks[index]
        if isinstance(task, LayerFilesTask):
            parts[index] = outcome if isinstance(outcome, LayerFiles) else None
            if isinstance(outcome, Failed):
                reading.errors.append(f"derived layers: {outcome.message}")
            elif not isinstance(outcome, LayerFiles):
                parts[index] = _files_alone(task, executor, reading.errors)
            continue
        if isinstance(outcome, ShardResult):
            results[task.folder] = outcome
        elif isinstance(outcome, Failed):
            reading.errors.append(f"{task.folder}: {outcome.message}")
            results[task.folder] = _unjudged(task)
        else:
            results[task.folder] = _post_mortem(task, executor, reading.errors)
        if progress:
            progress(len(results), num_shards)
    return results, [parts[index] for index in sorted(parts)]


def _read(task: ShardTask | LayerFilesTask) -> ShardResult | LayerFiles:
    return audit_shard(task) if isinstance(task, ShardTask) else read_layers(task)


def _files_alone(task: LayerFilesTask, executor: Executor, errors: list[str]) -> LayerFiles | None:
    """Find out whether one file or all of them together killed the worker: read the files one by one."""
    result, is_failed, culprits = LayerFiles(), False, []
    for path in task.files:
        for _, outcome in executor(read_layers, [replace(task, files=(path,), names=())]):
            if isinstance(outcome, LayerFiles):
                result.add(outcome)
            elif isinstance(outcome, Failed):
                errors.append(f"{path}: {outcome.message}")
                is_failed = True
            else:
                culprits.append(path)
    result.add(killed(task, culprits))
    return None if is_failed else result


def _joined(parts: Sequence[LayerFiles], reading: Reading, executor: Executor) -> LayerFiles:
    """What became of all files of the layers, with what shows only where all are known."""
    layers = LayerFiles()
    for part in parts:
        layers.add(part)
    homes: dict[str, int] = {}
    if layers.foreign:
        groups = frozenset(group for rows in layers.foreign.values() for group in rows)
        task = GroupsTask(reading.tasks[0].spool, table_paths("records", layers.num_rows), groups)
        for _, outcome in executor(find_groups, [task]):
            if isinstance(outcome, dict):
                homes = outcome
            elif isinstance(outcome, Failed):
                reading.errors.append(f"derived layers: {outcome.message}")
            else:
                layers.unjudged = f"finding {len(groups)} groups among the records took more memory than there is"
    layers.note_places([*misplaced(layers.foreign, homes), *empty_parts(layers.num_rows)])
    return layers


def _post_mortem(task: ShardTask, executor: Executor, errors: list[str]) -> ShardResult:
    """Find out whether a shard's bytes or a rule killed the worker: decode the files one by one, without rules."""
    result = _unjudged(task)
    for path in task.files:
        part = ShardTask(task.dataset, task.folder, (path,), None, frozenset(), task.is_hashed)
        for _, outcome in executor(_read, [part]):
            if isinstance(outcome, Failed):
                errors.append(f"{path}: {outcome.message}")
            elif not isinstance(outcome, ShardResult):
                result.over_limit[path] = "killed the process that decoded it within the memory limit, twice"
            else:
                result.digests.update(outcome.digests)
                result.unreadable.update(outcome.unreadable)
                result.stored_code.update(outcome.stored_code)
                result.undecodable.update(outcome.undecodable)
                result.over_limit.update(outcome.over_limit)
                result.present += outcome.present
                result.num_tables += outcome.num_tables
    if not result.over_limit and not result.undecodable:
        errors.append(f"{task.folder}: the worker died twice although every file decodes on its own")
    return result


def _unjudged(task: ShardTask) -> ShardResult:
    result = ShardResult(task.folder)
    result.leave_out(f"{task.folder} could not be judged", task.selected)
    return result
