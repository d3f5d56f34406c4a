"""Audits that are not repeated: most tests change little of a dataset, and most of its shards and layers not at all.

The audit of a shard is a function of its files, of what the descriptor claims and of the rules that are asked for. That
of derived layers is one of the digests of their files, and of the shards whose rows they are held against.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.content_cache import kept

from branchdrive.engine.derived_rules import LayersResult, LayersTask, judge_part
from branchdrive.engine.report import Report
from branchdrive.engine.shard import ShardResult, ShardTask, audit_shard, spooled_name
from branchdrive.engine.spool import Spool
from branchdrive.engine.validate import validate
from branchdrive.formats.folder import Folder
from branchdrive.runtime.executor import in_process

__all__ = ["audit_once", "judge_once", "remember_audits", "remembering", "validate_once"]

_known: dict[str, bytes] = {}
"""Audits, each with what it put into its spool, pickled as between processes, by all that they depend on."""

_rows: dict[tuple[Path, str], str] = {}
"""Which audit gave the rows of a shard, by the folder of the spool and the name there."""


def audit_once(task: ShardTask) -> ShardResult:
    """`audit_shard`, which shards of the same bytes go through once; files that cannot be read go through it anyway."""
    place = (task.spool.folder, spooled_name(task.folder)) if task.spool is not None else None
    if place is not None:
        _rows.pop(place, None)
    if not isinstance(task.dataset, Folder):
        return audit_shard(task)
    try:
        files = {path: hashlib.sha256((task.dataset.root / path).read_bytes()).hexdigest() for path in task.files}
    except OSError:
        return audit_shard(task)
    if task.dataset.links is not None or any((task.dataset.root / path).is_symlink() for path in task.files):
        return audit_shard(task)
    claimed = task.descriptor and {**task.descriptor.model_dump(mode="json"), "layers": []}
    options = sorted(task.selected), task.is_hashed, task.spool is None, sorted(task.optional), task.media
    text = repr((task.folder, files, claimed, options, sorted(task.repeated_rollouts), sorted(task.scattered_groups)))
    key = hashlib.sha256(text.encode()).hexdigest()
    if place is not None:
        _rows[place] = key
    if key not in _known:
        _known[key] = pickle.dumps(kept(f"shard-{key[:32]}", lambda: _alone(task)))
    result: ShardResult
    result, spooled = pickle.loads(_known[key])
    for name, content in spooled.items():
        assert task.spool is not None
        (task.spool.folder / name).write_bytes(content)
    return result


def judge_once(task: LayersTask) -> LayersResult:
    """`judge_part`, which a process goes through once for equal layers beside equal rows."""
    rows = [_rows.get((task.spool.folder, shard)) for shard in task.raw.shards]
    if None in rows or not {*task.names} <= task.digests.keys():
        return judge_part(task)
    key = hashlib.sha256(pickle.dumps((replace(task, spool=Spool(Path())), rows))).hexdigest()
    if key not in _known:
        _known[key] = pickle.dumps(judge_part(task))
    result: LayersResult = pickle.loads(_known[key])
    return result


def _alone(task: ShardTask) -> tuple[ShardResult, dict[str, bytes]]:
    """Audit of a shard, and what it put into its spool."""
    with Spool.temporary() as spool:
        result = audit_shard(replace(task, spool=task.spool and spool))
        return result, {path.name: path.read_bytes() for path in spool.folder.iterdir()}


def remember_audits(patch: pytest.MonkeyPatch) -> None:
    """Validate and build in this process, where `audit_once` and `judge_once` are what audits."""
    patch.setattr("branchdrive.engine.reading.audit_shard", audit_once)
    patch.setattr("branchdrive.engine.derived.judge_part", judge_once)
    patch.setattr("branchdrive.runtime.executor.isolated", lambda jobs: in_process)


def remembering(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """Executor in this process whose audits are those of `audit_once`."""
    with pytest.MonkeyPatch.context() as patch:
        remember_audits(patch)
        yield from in_process(judge_once if function is judge_part else function, tasks)


def validate_once(root: Path | str, **options: Any) -> Report:
    """`validate` by `audit_once`; not for tests that change what audits do."""
    return validate(root, executor=remembering, **options)
