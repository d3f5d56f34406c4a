"""Images of nominal rollouts before their branch.

Source: paper, "Release Structure" (modality paths); spec/12-model.md#media.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.model.inputs import empty_columns
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.frame import Values

__all__ = ["media_columns"]


def media_columns(view: ShardView, nominals: NDArray[np.int64]) -> dict[str, Values]:
    """Rows of the media index of `nominals` at the 16 observations up to the branch; none without media."""
    declared = [column for column in LAYER_TABLES["media_index"].columns if column.name != "partition"]
    if "frames" not in view:
        return empty_columns(declared)
    frames = view.stream("frames")
    owner = frames.rollout
    offset = np.where(owner >= 0, frames.tick - view.branch_tick[owner], 1)
    rows = np.flatnonzero(np.isin(owner, nominals) & np.isin(offset, HISTORY_OFFSETS))
    return {
        "group_id": view.rollouts["group_id"][owner[rows]],
        "offset_ticks": offset[rows].astype(np.int32),
        "shard": np.full(len(rows), view.file_prefix, object),
        **{
            column.name: frames[column.name][rows]
            for column in declared
            if column.name not in ("group_id", "offset_ticks", "shard")
        },
    }
