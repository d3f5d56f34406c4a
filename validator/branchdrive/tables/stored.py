"""Rows of stored tables of derived layers as frames, one file at a time.

Source: spec/10-layers.md#tables.
"""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.formats.store import Store
from branchdrive.formats.table_file import absent_table, layer_table_paths, read_table
from branchdrive.tables.arrow import StoredFrame
from branchdrive.tables.frame import Frame

__all__ = ["layer_frames"]


def layer_frames(dataset: Store, name: str) -> Iterator[Frame]:
    """Rows of each file of the table `name` of a derived layer, whose columns are read when they are asked for.

    Who takes one after the other holds those of one file or two, however many the table has.

    Raises:
        DatasetError: It cannot be read, or it is optional and not there.
    """
    paths = layer_table_paths(dataset, name)
    if not paths:
        raise absent_table(dataset, name)
    for path in paths:
        yield StoredFrame(read_table(dataset, path, name), name)
