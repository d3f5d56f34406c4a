"""Names in a rollouts table of unknown origin, before they are shown to a reader."""

from __future__ import annotations

from collections.abc import Collection

import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.errors import UsageError
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.raw.shard import Shard
from branchdrive_reference.study.label import MAX_TEXT_CHARACTERS, label

__all__ = ["check_names"]


def check_names(shard: Shard, table: pa.Table, columns: Collection[str]) -> None:
    """Refuse names that are longer than the format allows any text to be.

    Args:
        shard: Where the table lies, for the message.
        table: The decoded rollouts table, text as dictionaries.
        columns: Text columns whose values a reader is shown.

    Raises:
        UsageError: With the column and the beginning of the name.
    """
    for column in columns:
        names = pc.unique(table.column(column).combine_chunks()).dictionary.drop_null()
        longest = max(pc.utf8_length(names).to_pylist(), default=0)
        if longest > MAX_TEXT_CHARACTERS:
            name = next(name for name in names.to_pylist() if len(name) == longest)
            raise UsageError(
                f"{shard.path(ROLLOUTS)!r}: `{column}` holds a text of {longest:,} characters, '{label(name)}', and "
                f"may hold {MAX_TEXT_CHARACTERS:,}; run `branchdrive-validate`"
            )
