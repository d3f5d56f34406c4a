"""The writer of one branch group, usable from any process.

Source: spec/03-layout.md#keys.
"""

from __future__ import annotations

import re
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from branchdrive.contract.columns import PATTERNS, TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.errors import UsageError
from branchdrive.formats.descriptor_file import render_descriptor
from branchdrive.raw.rollout import ROLLOUTS, Rollout, canonical_key
from branchdrive.writer.buffer import check_names
from branchdrive.writer.media_buffer import MediaBuffer
from branchdrive.writer.rollout_writer import RolloutWriter
from branchdrive.writer.stage import Stage

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["GroupWriter"]

_FILLED_IN = ("group_id", "attempt", "num_ticks", "num_observations")
_NEEDED_TO_BEGIN = ("role", "action_key", "protocol_variant")


class GroupWriter:
    """Adds rollouts to one branch group and closes it.

    Several processes may write different groups of a dataset at once; a second writer of the same
    group waits for the first. The dataset must have been opened by a `DatasetWriter`, in this or
    another process. As a context manager it closes the group on a clean exit; an exception leaves
    the group open, so that the next writer goes on after its last finished rollout. A rollout that
    was open then is not in the dataset, and its attempt number is used again.

    Args:
        root: Folder of the dataset.
        descriptor: The dataset's descriptor.
        group_id: Identity of the group.
        index: The group's place in the dataset, from 0; it decides shard and order.

    Raises:
        UsageError: The id or the place cannot be used, the descriptor is not the dataset's, or no
            `DatasetWriter` has opened the dataset.
    """

    def __init__(self, root: str | Path, descriptor: Descriptor, group_id: str, index: int) -> None:
        if not re.fullmatch(PATTERNS["id"], group_id):
            raise UsageError(f"group id {group_id!r} does not match {PATTERNS['id']}; choose another one")
        if index < 0:
            raise UsageError(f"place of group `{group_id}` must be 0 or more, found {index}")
        stage = Stage(Path(root), descriptor)
        descriptor_path = stage.root / DESCRIPTOR_FILE
        if not descriptor_path.is_file() or descriptor_path.read_bytes() != render_descriptor(descriptor):
            raise UsageError(f"{root}: has another descriptor or none; open the dataset with `DatasetWriter` first")
        self._descriptor = descriptor
        self._maps = stage.load_maps()
        self._group, self._lock = stage.claim(group_id, index)
        self._open_rollout: RolloutWriter | None = None
        self._images: MediaBuffer | None = None
        try:
            self._rollouts = {i: self._group.rollout(i, descriptor) for i in self._group.rollout_ids}
        except BaseException:
            self.release()
            raise

    @property
    def group_id(self) -> str:
        """Identity of the group."""
        return self._group.group_id

    @property
    def index(self) -> int:
        """The group's place in the dataset."""
        return self._group.index

    @property
    def rollouts(self) -> tuple[Rollout, ...]:
        """The finished rollouts in the order of the dataset, those of earlier writers included."""
        return tuple(sorted(self._rollouts.values(), key=lambda r: canonical_key(r.record, self._descriptor)))

    def town_map(self, town: str) -> pa.Table | None:
        """Rows of the table ``map`` of a town, as the dataset was opened with them; ``None`` where it has none."""
        return self._maps.get(town)

    def find(
        self, role: str, action_key: str, attempt: int = 1, *, protocol_variant: str | None = None
    ) -> Rollout | None:
        """The finished rollout with this role, action key and attempt number, of any variant by default."""
        for rollout in self.rollouts:
            record = rollout.record
            if (record["role"], record["action_key"], record["attempt"]) != (role, action_key, attempt):
                continue
            if protocol_variant in (None, record["protocol_variant"]):
                return rollout
        return None

    def begin_rollout(self, **fields: object) -> RolloutWriter:
        """Begin the next attempt; one rollout of a group is open at a time.

        Args:
            **fields: Columns of the rollouts table, at least ``role``, ``action_key`` and
                ``protocol_variant``. ``group_id``, ``attempt`` and the row counts are filled in,
                ``rollout_id`` too unless it is given.

        Raises:
            ContractError: A field is unknown, missing or filled in by the writer.
            UsageError: Another rollout is open, the rollout id is taken, or the group is closed.
        """
        self._check_open()
        if self._open_rollout is not None:
            open_id = self._open_rollout.rollout_id
            raise UsageError(f"rollout `{open_id}` is open; finish or abandon it before the next one")
        allowed = {column.name for column in TABLES[ROLLOUTS].columns}.difference(_FILLED_IN)
        check_names(fields.keys(), allowed, _NEEDED_TO_BEGIN, f"rollout of group `{self.group_id}`")
        attempt = self._next_attempt(fields)
        part = fields["role"] if fields["role"] == "nominal_replay" else fields["action_key"]
        rollout_id = str(fields.get("rollout_id", f"{self.group_id}.{part}.{fields['protocol_variant']}.a{attempt}"))
        if not re.fullmatch(PATTERNS["id"], rollout_id):
            raise UsageError(f"rollout id {rollout_id!r} does not match {PATTERNS['id']}; pass another `rollout_id`")
        if rollout_id in self._rollouts:
            raise UsageError(f"rollout id `{rollout_id}` is taken in this group; pass another `rollout_id`")
        identified = {**fields, "group_id": self.group_id, "rollout_id": rollout_id, "attempt": attempt}
        self._images = self._group.media_buffer(rollout_id, self._descriptor)
        self._open_rollout = RolloutWriter(self._descriptor, identified, self._end_rollout, self._images)
        return self._open_rollout

    def _next_attempt(self, fields: dict[str, object]) -> int:
        records = [rollout.record for rollout in self._rollouts.values()]
        same = [r["attempt"] for r in records if all(r[name] == fields[name] for name in _NEEDED_TO_BEGIN)]
        return max(same, default=0) + 1

    def _end_rollout(self, rollout: Rollout | None) -> None:
        self._check_open()
        if rollout is not None:
            self._group.add(rollout, self._images)
            self._rollouts[rollout.rollout_id] = rollout
        self._close_rollout()

    def _close_rollout(self) -> None:
        if self._images is not None:
            self._images.close()
        self._open_rollout = self._images = None

    def _check_open(self) -> None:
        if not self._lock.is_held:
            raise UsageError(f"the writer of group `{self.group_id}` is closed; make another one for further attempts")

    def close(self) -> None:
        """Close the group: its collection is over and its shard may be written.

        A group without rollouts leaves no trace in the dataset.

        Raises:
            UsageError: A rollout is open, or the writer is closed.
        """
        self._check_open()
        if self._open_rollout is not None:
            open_id = self._open_rollout.rollout_id
            raise UsageError(f"rollout `{open_id}` is open; finish or abandon it before closing the group")
        self._group.close()
        self._lock.release()

    def release(self) -> None:
        """Let go of the group without closing it; an open rollout is lost, finished ones are kept."""
        self._close_rollout()
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._lock.is_held:
                self.close()
        finally:
            self.release()

    def __repr__(self) -> str:
        state = "open" if self._lock.is_held else "closed"
        return f"GroupWriter({self.group_id!r}, index {self.index}, {len(self._rollouts)} rollouts, {state})"
