"""The rollouts table of a shard of unknown origin, before its text is unpacked."""

from __future__ import annotations

from collections.abc import Collection

import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.contract.limits import spec_limits
from branchdrive.dataset.rollout import ROLLOUTS
from branchdrive.dataset.shard import Shard
from branchdrive.errors import UsageError
from branchdrive_reference.study.label import MAX_TEXT_CHARACTERS, label

__all__ = ["check_names", "read_rollouts"]


def read_rollouts(shard: Shard) -> pa.Table:
    """The table with text as dictionaries, which hold a text once however many rows have it.

    Raises:
        UsageError: Written out for every row, the text would not fit the limit for a decoded table.
        DatasetError: The table cannot be read.
    """
    table = shard.decode(ROLLOUTS)
    num_bytes = sum(_unpacked_bytes(piece) for column in table.columns for piece in column.chunks)
    limit = spec_limits().max_table_decoded_bytes
    if num_bytes > limit:
        raise UsageError(
            f"{shard.path(ROLLOUTS)!r}: its text is {num_bytes:,} bytes long and may be {limit:,}; "
            "run `branchdrive-validate`"
        )
    return table


def _unpacked_bytes(piece: pa.Array) -> int:
    """Bytes of the text of a column's piece, written out for every row; 0 for numbers."""
    if not pa.types.is_dictionary(piece.type):
        return 0
    lengths = pc.binary_length(piece.dictionary).cast(pa.int64())
    return int(pc.sum(lengths.take(piece.indices)).as_py() or 0)


def check_names(shard: Shard, table: pa.Table, columns: Collection[str]) -> None:
    """Refuse names that are longer than the format allows any text to be.

    Args:
        shard: Where the table lies, for the message.
        table: What `read_rollouts` returned.
        columns: Text columns whose values a reader is shown.

    Raises:
        UsageError: With the column and the beginning of the name.
    """
    for column in columns:
        names = pc.unique(table.column(column).combine_chunks()).dictionary.drop_null()
        longest = max(pc.utf8_length(names).to_pylist(), default=0)
        if longest > MAX_TEXT_CHARACTERS:
            shown = next(name for name in names.to_pylist() if len(name) == longest)
            raise UsageError(
                f"{shard.path(ROLLOUTS)!r}: `{column}` holds a text of {longest:,} characters, '{label(shown)}', and "
                f"may hold {MAX_TEXT_CHARACTERS:,}; run `branchdrive-validate`"
            )
