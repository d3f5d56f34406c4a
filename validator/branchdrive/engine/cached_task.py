"""A task whose result may be kept: what a worker does with it.

It looks into the cache, and digests the files for that; what is kept is of the bytes that were judged, and of no task
that failed, died, or met a file that cannot be read. A process of which the cache has not answered one request asks no
more in that run.

Source: spec/07-rules.md#report.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias

from branchdrive.contract.limits import spec_limits
from branchdrive.engine.cache_key import key_of, shard_key
from branchdrive.engine.derived_rules import LayersResult
from branchdrive.engine.shard import ShardResult, ShardTask, spooled_name
from branchdrive.engine.stored_result import from_bytes, to_bytes
from branchdrive.errors import DatasetError, PlatformError
from branchdrive.formats.entry import DamagedError
from branchdrive.formats.file_error import file_error_text
from branchdrive.formats.private_folder import PrivateFolder
from branchdrive.formats.private_prefix import PrivatePrefix
from branchdrive.formats.store import digest_of, size_of
from branchdrive.runtime.installation import own_version
from branchdrive.statistics.random_words import uniforms, words

__all__ = ["CachedTask", "Kept", "Outcome", "judge_once"]

Kept: TypeAlias = PrivateFolder | PrivatePrefix
"""Where results are kept."""

_STREAM = "cache/recheck/"
"""Streams of random words that say what is judged again: one for each entry, seeded with the day."""


@dataclass(frozen=True)
class CachedTask:
    """A task, and where its result may be found.

    Attributes:
        function: What gives the result.
        task: Of a shard, of derived layers, or another one.
        kept: Where results are kept.
        run: Name of the run.
        is_trusting: Whether versions of a bucket stand for bytes.
        recheck: Share of what is taken that is judged again.
        day: Seed of the draw of what is judged again.
        key: Digest of all that the result depends on beside files of a shard; ``None`` where that is not known.
    """

    function: Callable[[Any], Any]
    task: Any
    kept: Kept
    run: str
    is_trusting: bool
    recheck: float
    day: int
    key: str | None


@dataclass(frozen=True)
class Outcome:
    """A result with where it came from.

    Attributes:
        result: The result.
        key: Its key; ``None`` where it may not be kept.
        version: Version of the validator that gave it in an earlier run; ``None`` if this run did.
        is_by_version: Whether no file was read for it.
        is_damaged: Whether there was an entry that could not be read.
        is_rechecked: Whether there was one, and this run judged again.
        difference: How the two differ.
        fault: Why the cache could not be asked, or took nothing.
    """

    result: Any
    key: str | None = None
    version: str | None = None
    is_by_version: bool = False
    is_damaged: bool = False
    is_rechecked: bool = False
    difference: str | None = None
    fault: str | None = None


_faults: dict[str, str] = {}
"""Runs of which this process asks the cache no more, and why."""


def judge_once(once: CachedTask) -> Outcome:
    """Result of a task: from the cache, or from its function and then kept."""
    task = once.task
    if once.key is None or once.run in _faults:
        return Outcome(once.function(task), fault=None if once.key is None else _faults[once.run])
    found = _look(once)
    key, entry = found.key, found.entry
    if key is not None and entry is not None and not _is_drawn(once, key):
        for name, frame in entry["rows"].items():
            task.spool.put(name, frame)
        _keep_note(once, found)
        return Outcome(entry["result"], key, entry["version"], is_by_version=found.is_by_version)
    result = once.function(task)
    outcome = Outcome(result, is_damaged=found.is_damaged, fault=found.fault)
    if found.is_by_version and (lie := _lie(once, found, result)):
        return replace(outcome, difference=lie)
    if key is None or not _is_sound(result, found.digests):
        return outcome
    value = {"version": own_version(), "result": result, "rows": _rows(task, result)}
    if entry is None:
        fault = found.fault or _fault_of(once, lambda: once.kept.put(key, to_bytes(value)))
        _keep_note(once, found)
        return replace(outcome, key=key, fault=fault)
    parts = _differing(entry, value)
    where = f"{task.folder if isinstance(task, ShardTask) else 'derived layers'}: entry {key} of the cache {once.kept}"
    advice = "it differs from what judging again gives; remove it, and judge without a cache what rests on it"
    difference = f"{where} has other {', '.join(parts)}: {advice}" if parts else None
    return Outcome(result, key, entry["version"], is_rechecked=True, difference=difference)


@dataclass
class _Found:
    """What a cache has for a task.

    Attributes:
        key: Key of the result; ``None`` where it is not known.
        digests: SHA-256 of each file of a shard.
        note: Name of what says which digests the listed versions of these files have; ``None`` without trust in them.
        is_by_version: Whether it said so, and no file was read.
        entry: The entry under the key.
        is_damaged: Whether something is there that cannot be read.
        fault: Why the cache could not be asked.
    """

    key: str | None = None
    digests: dict[str, str] | None = None
    note: str | None = None
    is_by_version: bool = False
    entry: dict[str, Any] | None = None
    is_damaged: bool = False
    fault: str | None = None


def _look(once: CachedTask) -> _Found:
    """Look for the result of a task."""
    task, found = once.task, _Found(once.key)
    if isinstance(task, ShardTask) and once.key is not None:
        found.note = _note_name(task) if once.is_trusting else None
        if found.note is not None:
            found.digests = _got(once, found, found.note, lambda content: _noted(content, task))
            found.is_by_version = found.digests is not None
        if found.fault is None and found.digests is None:
            found.digests = _digests(task)
        found.key = None if found.digests is None else shard_key(once.key, found.digests)
    if found.key is not None:
        found.entry = _got(once, found, found.key, lambda content: _kept(content, task))
    return found


def _got(once: CachedTask, found: _Found, name: str, read: Callable[[bytes], dict[str, Any]]) -> dict[str, Any] | None:
    """What `read` makes of what is kept under a name; ``None``, and noted in `found`, where there is nothing sound."""
    content: list[bytes | None] = []
    try:
        found.fault = _fault_of(once, lambda: content.append(once.kept.get(name)))
        return read(content[0]) if content and content[0] is not None else None
    except (DamagedError, ValueError):
        found.is_damaged = True
        return None


def _fault_of(once: CachedTask, ask: Callable[[], None]) -> str | None:
    """Ask something of a cache; why it could not be asked, after which this process asks no more of it in this run."""
    try:
        ask()
    except (OSError, PlatformError) as error:
        text = file_error_text(error) if isinstance(error, OSError) else str(error)
        _faults[once.run] = text.partition(";")[0]
        return _faults[once.run]
    return None


def _note_name(task: ShardTask) -> str | None:
    """Name of what says which digests the listed versions of a shard's files have; ``None`` where there are none."""
    versions = [task.dataset.lasting_version(path) for path in task.files]
    return None if None in versions else key_of({"versions": versions})


def _noted(content: bytes, task: ShardTask) -> dict[str, str]:
    """Digests of a shard's files.

    Raises:
        ValueError: It holds none.
    """
    digests = json.loads(content)
    if not isinstance(digests, dict) or digests.keys() != {*task.files}:
        raise ValueError("no digests of these files")
    return {path: str(digest) for path, digest in digests.items()}


def _keep_note(once: CachedTask, found: _Found) -> None:
    """Keep which digests the listed versions have, of files that this run has read in them."""
    note = found.note
    if note is not None and not found.is_by_version and once.run not in _faults:
        content = json.dumps(found.digests, sort_keys=True).encode()
        _fault_of(once, lambda: once.kept.put(note, content))


def _lie(once: CachedTask, found: _Found, result: Any) -> str | None:
    """What is wrong where files have other digests than their versions had; a file that cannot be read has none."""
    others = [path for path, digest in (found.digests or {}).items() if result.digests.get(path, digest) != digest]
    if not others:
        return None
    return (
        f"{others[0]}: the store gives other bytes for one version than an earlier run read, by entry {found.note} of "
        f"the cache {once.kept}; remove it, and validate without `trust_versions`"
    )


def _kept(content: bytes, task: Any) -> dict[str, Any]:
    """What an entry holds.

    Raises:
        ValueError: It is no result of such a task.
    """
    value = from_bytes(content)
    kind = ShardResult if isinstance(task, ShardTask) else LayersResult
    if not isinstance(value, dict) or value.keys() != {"version", "result", "rows"}:
        raise ValueError("no entry of a cache")
    if not (isinstance(value["version"], str) and isinstance(value["rows"], dict) and type(value["result"]) is kind):
        raise ValueError(f"no entry with a {kind.__name__}")
    return value


def _digests(task: ShardTask) -> dict[str, str] | None:
    """Digest of each file of a shard; ``None`` where one cannot be read or is too large."""
    found = {}
    for path in task.files:
        limits = spec_limits()
        max_bytes = limits.max_table_bytes if path.endswith(".parquet") else limits.max_media_bytes
        try:
            with task.dataset.open(path) as stream:
                if size_of(stream) > max_bytes:
                    return None
                found[path] = digest_of(stream)
        except (DatasetError, OSError):
            return None
    return found


def _is_drawn(once: CachedTask, key: str) -> bool:
    """Whether a result that could be taken is judged again, today."""
    return bool(uniforms(words(once.day, f"{_STREAM}{key}", 1, 1))[0, 0] < once.recheck)


def _is_sound(result: Any, digests: Mapping[str, str] | None) -> bool:
    """Whether a result may be kept: nothing failed, all could be read, and the files were what they were before."""
    if isinstance(result, LayersResult):
        return not any(tally.errors or tally.is_exceeded for tally in result.tallies.values())
    if not isinstance(result, ShardResult) or result.is_failed or result.digests != digests:
        return False
    return not (result.unreadable or result.undecodable or result.over_limit)


def _rows(task: Any, result: Any) -> dict[str, Any]:
    """What a task put into its spool, by the name there."""
    if task.spool is None:
        return {}
    is_shard = isinstance(task, ShardTask)
    names = [f"{spooled_name(task.folder)}.{frame}" for frame in result.frames] if is_shard else result.pieces
    return {name: task.spool.get(name) for name in names}


def _differing(kept: Mapping[str, Any], value: Mapping[str, Any]) -> list[str]:
    """Parts of a result that are others than in an entry; none where all are equal, to the last bit."""
    one, other = kept["result"], value["result"]
    names = [part.name for part in fields(one)]
    found = [name for name in names if to_bytes(getattr(one, name)) != to_bytes(getattr(other, name))]
    return found + ["rows for derived layers"] * (to_bytes(kept["rows"]) != to_bytes(value["rows"]))
