"""Views of the valid dataset with other values in some columns."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from tests.synthetic import Tables, base_tables, descriptor

from branchdrive.contract.descriptor import Descriptor
from branchdrive.raw.shard_view import ShardView

TABLES = next(iter(base_tables().values()))
WHEELBASE_M = 2.5


def view_of(tables: Tables, *, has_axles: bool = False) -> ShardView:
    """View of a shard, whose vehicle has a declared wheelbase or none."""
    vehicle = {"vehicle": {"wheelbase_m": WHEELBASE_M}} if has_axles else {}
    return ShardView(tables, Descriptor.model_validate({**descriptor(), **vehicle}))


def changed(table: str, **columns: np.ndarray) -> Tables:
    """Tables of a shard of the valid dataset with other columns in one of them."""
    rows = TABLES[table]
    for name, values in columns.items():
        place = rows.schema.get_field_index(name)
        rows = rows.set_column(place, rows.schema.field(place), pa.array(values, rows.schema.field(place).type))
    return {**TABLES, table: rows}
