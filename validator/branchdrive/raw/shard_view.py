"""Columnar view of one shard: what rules on raw rows read.

Order of rows and files carries no meaning, so every stream is seen sorted by (rollout, tick); what
several rules need (windows, active rows, expected commands) is computed once and cached here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.mismatch import PreconditionError
from branchdrive.tables.view import StreamView, TableView

if TYPE_CHECKING:
    import pyarrow as pa

    from branchdrive.raw.media.images import Images

__all__ = ["ShardView"]

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

T = TypeVar("T")


@dataclass(frozen=True)
class _Lacking:
    """Why there is no result."""

    reason: str


class ShardView:
    """One shard's tables with identities resolved.

    Attributes:
        descriptor: The dataset's descriptor.
        file_prefix: Folder of the shard relative to the root, ``""`` in memory.
        rollouts: The rollouts table, one row per attempt.
        images: What bytes and pixels of its images say, in the order of the stored index; ``None`` if not read.
    """

    def __init__(self, tables: Mapping[str, pa.Table], descriptor: Descriptor, *, file_prefix: str = "") -> None:
        self.descriptor = descriptor
        self.file_prefix = file_prefix
        self.images: Images | None = None
        self._num_rows = {name: table.num_rows for name, table in tables.items()}
        self._unread = dict(tables)  # each goes as its view comes, which holds it as it is needed
        self.rollouts = TableView("rollouts", self._unread.pop("rollouts"))
        self.num_rollouts = len(self.rollouts)
        self._streams: dict[str, StreamView] = {}
        self._computed: dict[Callable[[ShardView], Any], Any] = {}

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name}={num_rows}" for name, num_rows in self._num_rows.items())
        return f"ShardView({self.file_prefix!r}, {sizes})"

    @cached_property
    def rollout_ids(self) -> list[str]:
        """Identity of each attempt."""
        return list(self.rollouts["rollout_id"])

    @cached_property
    def _rollout_index(self) -> dict[str, int]:
        return {rollout_id: i for i, rollout_id in reversed(list(enumerate(self.rollout_ids))) if rollout_id}

    def find_rollout(self, rollout_id: str) -> int | None:
        """The first attempt of an identity; ``None`` where there is none."""
        return self._rollout_index.get(rollout_id)

    def __contains__(self, table: str) -> bool:
        return table in self._num_rows

    def __getitem__(self, table: str) -> TableView:
        """View of a table: `rollouts`, the map, or a stream of rows of rollouts."""
        if table == "rollouts":
            return self.rollouts
        return self.stream(table) if TABLES[table].is_of_rollouts else self.map

    def stream(self, table: str) -> StreamView:
        """View of a stream table, built on first use."""
        if table not in self._streams:
            rows = self._unread.pop(table)
            self._streams[table] = StreamView(table, rows, self._rollout_index, self.num_rollouts)
        return self._streams[table]

    def cached(self, compute: Callable[[ShardView], T]) -> T:
        """Result of `compute` on this view, computed on first use: what several rules need.

        Raises:
            PreconditionError: It has none, which is found out once as well.
        """
        if compute not in self._computed:
            try:
                self._computed[compute] = compute(self)
            except PreconditionError as reason:
                self._computed[compute] = _Lacking(str(reason))
        result: T | _Lacking = self._computed[compute]
        if isinstance(result, _Lacking):
            raise PreconditionError(result.reason)
        return result

    @property
    def table_names(self) -> tuple[str, ...]:
        """Tables of this shard, rollouts first."""
        return tuple(name for name in TABLES if name in self._num_rows)

    @cached_property
    def map(self) -> TableView:
        """Elements of the maps of the shard's towns."""
        return TableView("map", self._unread.pop("map"))

    @property
    def controls(self) -> StreamView:
        """Control audit."""
        return self.stream("controls")

    @property
    def observations(self) -> StreamView:
        """Ego and route state."""
        return self.stream("observations")

    def role(self, name: str) -> Mask:
        """Attempts with the role `name`."""
        return self.rollouts.equals("role", name)

    @cached_property
    def complete(self) -> Mask:
        """Attempts with status complete."""
        return self.rollouts.equals("status", "complete")

    @cached_property
    def branched(self) -> Mask:
        """Attempts with a branch tick."""
        return self.rollouts.valid("branch_tick")

    @cached_property
    def branch_tick(self) -> Index:
        """``t_b`` of each attempt; meaningless where not `branched`."""
        return self.rollouts["branch_tick"].astype(np.int64)

    @cached_property
    def group_ids(self) -> list[str]:
        """Branch groups of the shard, sorted."""
        return sorted(set(self.rollouts["group_id"]))

    @cached_property
    def group(self) -> Index:
        """Group of each attempt, index into `group_ids`."""
        position = {group_id: i for i, group_id in enumerate(self.group_ids)}
        return np.array([position[group_id] for group_id in self.rollouts["group_id"]], np.int64)

    @cached_property
    def policy(self) -> Index:
        """Policy of each attempt, index into the bank; -1 if the bank lacks its action key."""
        position = {key: i for i, key in enumerate(self.descriptor.action_bank.keys)}
        return np.array([position.get(key, -1) for key in self.rollouts["action_key"]], np.int64)

    @cached_property
    def nominal(self) -> Index:
        """The nominal rollout that each attempt names; itself for a nominal, -1 where unresolved."""
        named = [self._rollout_index.get(rollout_id, -1) for rollout_id in self.rollouts["nominal_rollout_id"]]
        own = np.arange(self.num_rollouts)
        return np.where(self.role("nominal"), own, np.array(named, np.int64)) if named else own

    @cached_property
    def active_rows(self) -> Index:
        """Control rows of known rollouts at which the policy is active."""
        return np.flatnonzero(self.controls["active"] & (self.controls.rollout >= 0))
