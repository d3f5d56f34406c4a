"""What the stages of a build work on, and how they work: a map over the parts of the raw layer, and small reductions.

Rows of a part are read, computed with and written by the task of that part; what comes back is a few numbers a group.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.layer import LAYERS
from branchdrive.release.built_layers import BuiltLayers, StoredFile, TableStore
from branchdrive.release.scan import RawScan
from branchdrive.runtime.executor import Executor, in_process, results_of
from branchdrive.tables.frame import Frame, num_rows, take

__all__ = ["MAX_GROUPS_HERE", "StageWork", "in_parts"]

MAX_GROUPS_HERE = 256
"""Groups of one part up to which a build starts no processes of its own; they take some 50 MB."""

Result = TypeVar("Result")


@dataclass(frozen=True)
class StageWork:
    """What a stage works on.

    Attributes:
        scan: The raw layer.
        layers: The layers before it, to which it adds its own.
        store: Where it writes tables.
        executor: How tasks are run.
    """

    scan: RawScan
    layers: BuiltLayers
    store: TableStore
    executor: Executor

    def put_tables(self, layer: str, parts: Iterable[Mapping[str, StoredFile]]) -> None:
        """Put the tables of a layer, of which parts have these files by path, in the place of what they were."""
        names = LAYERS[layer].tables
        files = {path: file for part in parts for path, file in part.items()}
        self.layers.put_tables(names, self.store.completed(names, files))

    def run(self, function: Callable[[Any], Result], tasks: Sequence[Any]) -> list[Result]:
        """Results of tasks, in order.

        Tasks of a raw layer of one part with few groups are carried out in this process: what starting others takes
        would be most of the time.

        Raises:
            ToolError: A task failed, or took more memory than there is.
        """
        is_small = len(self.scan.parts) == 1 and self.scan.num_groups <= MAX_GROUPS_HERE
        executor = in_process if is_small else self.executor
        return results_of(executor, function, tasks, f"{self.scan.dataset}: `{function.__name__}` of the tool")


def in_parts(frame: Frame, numbers: NDArray[np.int64], count: int) -> list[Frame]:
    """Rows of a frame by the place of their part, in their order.

    Args:
        frame: Rows.
        numbers: Place of the part of each row, ascending.
        count: Number of the parts.
    """
    if len(numbers) != num_rows(frame):
        raise ValueError(f"{len(numbers)} numbers of parts of {num_rows(frame)} rows")
    bounds = np.searchsorted(numbers, np.arange(count + 1))
    return [take(frame, slice(*pair)) for pair in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)]
