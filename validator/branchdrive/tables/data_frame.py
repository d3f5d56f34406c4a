"""Arrow tables as data frames of the libraries that people analyse with; neither is needed by anything else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from branchdrive.runtime.environment import extra

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["to_pandas", "to_polars"]


def to_pandas(table: pa.Table) -> Any:
    """A `pandas.DataFrame` of the table; what may be null keeps its type, as pandas' nullable ones.

    Raises:
        PlatformError: pandas is not installed.
    """
    with extra("frames", of="a data frame of pandas"):
        import pandas as pd
    import pyarrow as pa

    nullable = {
        pa.bool_(): pd.BooleanDtype(), pa.int32(): pd.Int32Dtype(), pa.int64(): pd.Int64Dtype(),
    }  # fmt: skip
    may_be_null = {field.type for field in table.schema if table.column(field.name).null_count}
    return table.to_pandas(types_mapper=lambda kind: nullable.get(kind) if kind in may_be_null else None)


def to_polars(table: pa.Table) -> Any:
    """A `polars.DataFrame` of the table.

    Raises:
        PlatformError: polars is not installed.
    """
    with extra("frames", of="a data frame of polars"):
        import polars as pl
    return pl.from_arrow(table)
