"""Replays against their nominals: discrepancies before the branch, and whether whole records are equal bit by bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES, TICK_TABLES
from branchdrive.driving.discrepancy import CORE
from branchdrive.quality import replay
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

__all__ = ["discrepancies", "equal_records"]

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


def discrepancies(view: ShardView, pairs: replay.Pairs) -> NDArray[np.float64]:
    """Core and extended variables of pairs with whole windows, ``[pairs, 7 + 5]``.

    The extended ones are NaN where no evidence is claimed.
    """
    values = replay.discrepancies(view, pairs)
    if "evidence" not in view:
        values[:, len(CORE) :] = np.nan
    return values


def equal_records(view: ShardView, pairs: replay.Pairs) -> dict[str, Mask]:
    """For every compared table of the shard: pairs ``[pairs]`` whose rows hold the same bits, rollout ids apart.

    Order of rows carries no meaning. Numbers are equal where their bits are: 0 and -0 are not, NaN and NaN are.
    """
    return {table: _equal_rows(view.stream(table), pairs) for table in TICK_TABLES if table in view}


def _equal_rows(stream: StreamView, pairs: replay.Pairs) -> Mask:
    lengths, wanted = (stream.stop[side] - stream.start[side] for side in pairs)
    equal = np.asarray(lengths == wanted)
    pair = np.repeat(np.arange(len(pairs.replay)), np.where(equal, lengths, 0))
    sides = [_rows(stream, side[equal], lengths[equal], pair) for side in pairs]
    for column in TABLES[stream.name].columns:
        if column.name != "rollout_id":
            equal[pair[stream.differs(column.name, *sides)]] = False
    return equal


def _rows(stream: StreamView, rollouts: Index, lengths: Index, pair: Index) -> Index:
    """Rows of `rollouts` one after the other, each sorted by tick and, if the table has them, by actor."""
    offset = np.arange(len(pair)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    rows = np.repeat(stream.start[rollouts], lengths) + offset
    if "actor_id" in stream:
        rows = rows[np.lexsort((stream["actor_id"][rows], stream.tick[rows], pair))]
    return np.asarray(rows)
