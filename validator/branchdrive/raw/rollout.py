"""A finished rollout: its row of the rollouts table and its rows of every stream.

Source: spec/05-raw-streams.md#tables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.contract.columns import TABLES, Column, Table
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.text import listed, nearest, quote
from branchdrive.contract.timing import TICK_S
from branchdrive.errors import UnknownNameError, UsageError
from branchdrive.raw.media.camera_frames import CameraFrames
from branchdrive.raw.media.media_folder import FRAMES, MediaFolder

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["MAP", "ROLLOUTS", "Rollout", "RolloutTables", "canonical_key", "key_columns"]

ROLLOUTS = "rollouts"
"""Name of the table that a rollout has exactly one row in."""

MAP = "map"
"""Name of the table that holds the maps of towns, and no rows of rollouts."""

_ROLE_ORDER = ("nominal", "intervention", "nominal_replay", "drive")


_FILLERS: Mapping[str, object] = {
    "string": "", "bool": False, "int32": 0, "int64": 0, "float32": np.nan, "float64": np.nan,
}  # fmt: skip
"""What stands under the mask of a null, by column type."""


class RolloutTables(Mapping[str, "pa.Table"]):
    """Rows of one rollout in every stream table, by table name, with the declared Arrow schemas."""

    def __init__(self, tables: Mapping[str, pa.Table]) -> None:
        self._tables = dict(tables)

    def __getitem__(self, name: str) -> pa.Table:
        if name not in self._tables:
            raise UnknownNameError(f"no table {quote(name)} in this rollout; {nearest(name, self._tables)}")
        return self._tables[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)

    def column(self, table: str, name: str) -> np.ndarray[Any, Any]:
        """One column as numpy, shape ``[rows]``; its form follows from the declaration and from what the world offers.

        Returns:
            A plain array where the column is never null, or recorded throughout; where it may be null a
            `numpy.ma.MaskedArray`, masked exactly at the nulls, with NaN below the mask of a real number,
            so that what loses the mask is no value. Text has dtype ``object``.

        Raises:
            UnknownNameError: The rollout has no such table, or the table no such column.
        """
        rows = self[table]
        if name not in rows.column_names:
            raise UnknownNameError(f"no column {quote(name)} in {quote(table)}; {nearest(name, rows.column_names)}")
        return column_values(rows.column(name), TABLES[table][name])

    def __repr__(self) -> str:
        shapes = ", ".join(f"{name} [{table.num_rows}, {table.num_columns}]" for name, table in self.items())
        return f"RolloutTables({shapes})"


@dataclass(frozen=True, repr=False)
class Rollout:
    """One physical attempt, as a dataset holds it.

    Attributes:
        record: The row of the rollouts table, by column name; null is ``None``.
        tables: The rows of the streams, sorted by tick.
        media: Where its images are; ``None`` without a media stream.
    """

    record: dict[str, Any]
    tables: RolloutTables
    media: MediaFolder | None = field(default=None, compare=False)

    @property
    def rollout_id(self) -> str:
        """Identity of the attempt."""
        return str(self.record["rollout_id"])

    @property
    def branch_tick(self) -> int | None:
        """Tick at which the intervention begins; ``None`` for a rollout without a branch."""
        tick = self.record["branch_tick"]
        return None if tick is None else int(tick)

    @property
    def t_s(self) -> np.ndarray[Any, Any]:
        """Seconds since the attempt began, of each row of its observations, float64 ``[observations]``."""
        return self.column("observations", "tick") * TICK_S

    @property
    def branch_s(self) -> float | None:
        """Seconds from the beginning to the branch, so that ``t_s - branch_s`` is 0 there; ``None`` without one."""
        return None if self.branch_tick is None else self.branch_tick * TICK_S

    @property
    def actors(self) -> dict[int, pa.Table]:
        """Rows of the actors around the ego by tick, one table for each observation, which may have none.

        Raises:
            UnknownNameError: The dataset does not claim the stream of actors.
        """
        rows = self.tables["actors"]
        ticks, wanted = rows.column("tick").to_numpy(), np.unique(self.column("observations", "tick"))
        first, after = (np.searchsorted(ticks, wanted, side=side) for side in ("left", "right"))
        return {int(tick): rows.slice(i, k - i) for tick, i, k in zip(wanted, first, after, strict=True)}

    def column(self, table: str, name: str) -> np.ndarray[Any, Any]:
        """One column of a stream as numpy, see `RolloutTables.column`."""
        return self.tables.column(table, name)

    def frames(self, camera: str, offsets: Sequence[int] | None = None) -> CameraFrames:
        """Images of a camera, lazily: each is read, and checked against its checksum, when it is asked for.

        Args:
            camera: A camera of the descriptor.
            offsets: Ticks relative to the branch, such as `HISTORY_OFFSETS`; all images by default.

        Raises:
            UsageError: The dataset has no such camera, or no media; or the rollout has no branch, or lacks an image.
        """
        cameras = {} if self.media is None else self.media.cameras
        if self.media is None or camera not in cameras:
            raise UsageError(f"no camera {camera!r} in this dataset; it has {listed(sorted(cameras)) or 'no media'}")
        frames = CameraFrames.of_rows(camera, self.tables[FRAMES], self.media)
        if offsets is None:
            return frames
        if self.branch_tick is None:
            raise UsageError(f"rollout `{self.rollout_id}` has no branch tick and so no windows")
        return frames.at(np.asarray(offsets) + self.branch_tick)

    def __repr__(self) -> str:
        role, key = self.record["role"], self.record["action_key"]
        head = f"{self.rollout_id!r}, {role} {key!r}, attempt {self.record['attempt']}, {self.record['status']}"
        return f"Rollout({head}, {self.tables!r})"


def column_values(values: pa.ChunkedArray, column: Column) -> np.ndarray[Any, Any]:
    """Values of a declared column as numpy, masked where they are null if the column may be null."""
    import pyarrow as pa

    array = values.combine_chunks() if isinstance(values, pa.ChunkedArray) else values
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    filled = array.fill_null(_FILLERS[column.type]) if array.null_count else array
    plain: np.ndarray[Any, Any] = filled.to_numpy(zero_copy_only=False)
    is_recorded = column.is_required(()) and not array.null_count
    if is_recorded or not column.nullable:
        return plain
    masked: np.ndarray[Any, Any] = np.ma.MaskedArray(plain, mask=array.is_null().to_numpy(zero_copy_only=False))
    return masked


def key_columns(table: pa.Table, declared: Table) -> list[np.ndarray[Any, Any]]:
    """Key of a stream's rows inside their rollout, as `numpy.lexsort` wants it: the first column last."""
    return [table.column(name).to_numpy() for name in reversed(declared.key) if name != "rollout_id"]


def canonical_key(record: Mapping[str, Any], descriptor: Descriptor) -> tuple[int, int, str, str, int, str]:
    """Sort key of a rollout inside its group: the order in which readers and writers of a group list its rollouts.

    Nominal, then interventions in the order of the action bank, then nominal replays, then drives; attempts of
    the same protocol by number. It does not depend on the order in which rollouts were executed.
    """
    keys = descriptor.action_bank.keys
    action_key = record["action_key"]
    return (
        _ROLE_ORDER.index(record["role"]) if record["role"] in _ROLE_ORDER else len(_ROLE_ORDER),
        keys.index(action_key) if action_key in keys else len(keys),
        action_key,
        record["protocol_variant"],
        record["attempt"],
        record["rollout_id"],
    )
