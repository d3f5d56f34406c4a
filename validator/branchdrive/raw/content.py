"""Content of a raw shard: a digest for each branch group, over its rows in all tables but the media index and the map.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES, declared_table
from branchdrive.contract.identity import layer_content
from branchdrive.files.shard_facts import ShardFacts, repeated_rollouts, scattered_groups
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.content import block_digests, sortable

__all__ = ["group_content", "is_identified", "raw_content", "table_content"]

_MEDIA_INDEX = "frames"

Index = NDArray[np.int64]


def is_identified(view: ShardView) -> bool:
    """Whether every attempt has an identity of its own and a group, and every row an attempt."""
    ids = view.rollout_ids
    if not all(ids) or len(set(ids)) < len(ids) or not all(view.group_ids):
        return False
    return not any(view.stream(name).num_unknown for name in _tables(view)[1:])


def group_content(view: ShardView) -> NDArray[np.uint8] | None:
    """SHA-256 of every branch group ``[groups, 32]``; ``None`` where something is not `is_identified`."""
    if not is_identified(view):
        return None
    by_table = table_content(view, view.group).values()
    digests = (hashlib.sha256(b"".join(parts)).digest() for parts in zip(*by_table, strict=True))
    return np.frombuffer(b"".join(digests), np.uint8).reshape(len(view.group_ids), hashlib.sha256().digest_size)


def table_content(view: ShardView, block: Index) -> dict[str, list[bytes]]:
    """Digests of the rows of blocks of attempts, by table in declared order.

    Args:
        view: The shard, in which everything `is_identified`.
        block: Block of each attempt, counted from 0 without a gap ``[rollouts]``.
    """
    own = np.arange(view.num_rollouts)
    rank = np.empty_like(own)
    rank[np.lexsort((sortable(view.rollouts, "rollout_id"), block))] = own
    is_ranked = np.array_equal(rank, own)
    found = {"rollouts": block_digests(view.rollouts, [rank], _ends(np.bincount(block)))}
    for name in _tables(view)[1:]:
        stream = view.stream(name)
        num_rows = np.bincount(block, stream.stop - stream.start).astype(np.int64)
        key = []
        if not (is_ranked and stream.ascends):
            further = [stream[column] for column in declared_table(name).key[2:]]
            key = [rank[stream.rollout], stream["tick"], *further]
        found[name] = block_digests(stream, key, _ends(num_rows))
    return found


def _ends(num_rows: Index) -> Index:
    """Where blocks of so many rows begin and end ``[blocks + 1]``."""
    return np.concatenate(([0], np.cumsum(num_rows)))


def _tables(view: ShardView) -> list[str]:
    """Tables whose rows belong to attempts, rollouts first, without the media index."""
    return [name for name in view.table_names if TABLES[name].is_of_rollouts and name != _MEDIA_INDEX]


def raw_content(shards: Sequence[ShardFacts]) -> str | None:
    """Digest of the content of the raw layer.

    ``None`` where that of a shard is not known, attempts repeat, a group lies in several shards, or a town has
    different maps.
    """
    if repeated_rollouts(shards) or scattered_groups(shards):
        return None
    parts: dict[str, str] = {}
    for shard in shards:
        if shard.groups is None:
            return None
        digests = (digest.tobytes().hex() for digest in shard.groups)
        parts |= {f"group {name}": digest for name, digest in zip(shard.group_ids, digests, strict=True)}
        for town, digest in shard.maps.items():
            if parts.setdefault(f"map {town}", digest) != digest:
                return None
    return layer_content(parts)
