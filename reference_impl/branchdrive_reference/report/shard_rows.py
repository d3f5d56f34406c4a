"""Rows of a shard that may be damaged, found by rollout: whatever can be read is there, the rest is said.

The reader of datasets refuses a shard for one table that cannot be read; a report shows the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from branchdrive.contract.descriptor import Descriptor
from branchdrive.errors import DatasetError
from branchdrive.raw.rollout import MAP, ROLLOUTS
from branchdrive.raw.shard import Shard
from branchdrive_reference.study.label import sentence

__all__ = ["ShardRows", "TickRows"]

Array = NDArray[np.float64]

_PLAYED = ("controls", "observations", "actors", "evidence")
"""Streams that a player shows beside images."""

_ROUTE = ("route_x_m", "route_y_m")


class TickRows:
    """A stream of a shard, sorted by rollout and tick."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table
        ids = table.column("rollout_id").combine_chunks()
        codes = ids.indices.fill_null(-1).to_numpy(zero_copy_only=False).astype(np.int64)
        tick = table.column("tick").fill_null(0).to_numpy(zero_copy_only=False)
        by_actor = [self._whole("actor_id")] if "actor_id" in table.column_names else []
        self._order = np.lexsort([*by_actor, tick, codes])
        names = ids.dictionary.to_pylist()
        starts = np.searchsorted(codes[self._order], np.arange(len(names) + 1))
        self._spans = {name: slice(int(starts[i]), int(starts[i + 1])) for i, name in enumerate(names)}
        self._columns: dict[str, NDArray[Any]] = {}

    def span(self, rollout_id: str) -> slice:
        """Rows of a rollout."""
        return self._spans.get(rollout_id, slice(0, 0))

    def numbers(self, column: str, rows: slice) -> Array:
        """Numbers of a column; NaN where one is null."""
        if column not in self._columns:
            values = self._table.column(column).cast(pa.float64()).to_numpy(zero_copy_only=False)
            self._columns[column] = np.asarray(values, np.float64)[self._order]
        return self._columns[column][rows]

    def text(self, column: str, row: int) -> str:
        """Text of a column in one row; empty where it is null."""
        value = self._table.column(column)[int(self._order[row])].as_py()
        return "" if value is None else str(value)

    def _whole(self, column: str) -> NDArray[Any]:
        return np.asarray(self._table.column(column).fill_null(-1).to_numpy(zero_copy_only=False))


class ShardRows:
    """What can be read of a shard.

    Attributes:
        shard: The shard.
        tables: Tables that can be read, as stored.
        streams: Those of them that a player shows.
        unread: Why others cannot, a sentence each.
    """

    def __init__(self, shard: Shard, descriptor: Descriptor) -> None:
        self.shard = shard
        self.tables: dict[str, pa.Table] = {}
        self.unread: list[str] = []
        for name in descriptor.tables:
            try:
                self.tables[name] = shard.decode(name)
            except DatasetError as error:
                self.unread.append(sentence(error))
        self.streams = {name: TickRows(self.tables[name]) for name in _PLAYED if name in self.tables}

    @property
    def is_whole(self) -> bool:
        """Whether every table can be read."""
        return not self.unread

    @property
    def map(self) -> pa.Table | None:
        """Rows of the map; ``None`` where there are none."""
        return self.tables.get(MAP)

    def records(self) -> list[dict[str, Any]]:
        """Rows of the rollouts table without their routes; none where it cannot be read."""
        if ROLLOUTS not in self.tables:
            return []
        rows: list[dict[str, Any]] = self.tables[ROLLOUTS].drop_columns(list(_ROUTE)).to_pylist()
        return rows

    def route(self, row: int) -> tuple[Array, Array]:
        """Vertices of the route of an attempt, as far as both coordinates go."""
        x, y = (self.tables[ROLLOUTS].column(name)[row].as_py() or [] for name in _ROUTE)
        num = min(len(x), len(y))
        return np.array(x[:num], np.float64), np.array(y[:num], np.float64)
