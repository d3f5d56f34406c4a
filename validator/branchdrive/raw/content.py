"""Content of a raw shard: one digest for each attempt, over its rows in all tables but the media index and the map.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

from collections.abc import Iterable

from branchdrive.contract.columns import TABLES
from branchdrive.contract.identity import layer_content
from branchdrive.files.shard_facts import ShardFacts
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.content import attempt_digests, rows_digests, stream_digests

__all__ = ["attempt_content", "raw_content", "table_content"]

_MEDIA_INDEX = "frames"


def table_content(view: ShardView) -> dict[str, list[bytes]]:
    """Digest of the rows of every attempt, in the order of the rollouts table, by table."""
    streams = [name for name in _streams(view) if name != _MEDIA_INDEX]
    return {"rollouts": rows_digests(view.rollouts), **{name: stream_digests(view.stream(name)) for name in streams}}


def _streams(view: ShardView) -> list[str]:
    """Tables whose rows belong to attempts, without that of the attempts themselves."""
    return [name for name in view.table_names[1:] if TABLES[name].is_of_rollouts]


def attempt_content(view: ShardView) -> dict[str, str] | None:
    """Digest of every attempt by identity; ``None`` where identities repeat or lack, or a row belongs to no attempt."""
    ids = view.rollout_ids
    if not all(ids) or len(set(ids)) < len(ids):
        return None
    if any((view.stream(name).rollout < 0).any() for name in _streams(view)):
        return None
    return dict(zip(ids, attempt_digests([*table_content(view).values()]), strict=True))


def raw_content(shards: Iterable[ShardFacts]) -> str | None:
    """Digest of the content of the raw layer.

    ``None`` where that of a shard is not known, attempts repeat, or a town has different maps.
    """
    attempts: dict[str, str] = {}
    maps: dict[str, str] = {}
    num_attempts = 0
    for shard in shards:
        if shard.attempts is None:
            return None
        attempts |= shard.attempts
        num_attempts += len(shard.attempts)
        for town, digest in shard.maps.items():
            if maps.setdefault(f"map {town}", digest) != digest:
                return None
    return layer_content(attempts | maps) if len(attempts) == num_attempts else None
