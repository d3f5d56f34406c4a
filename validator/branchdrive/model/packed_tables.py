"""Tables and documents of a model layer as they are read: tables packed by key when they are first asked for.

Source: spec/12-model.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS, table_path
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import Mismatch
from branchdrive.driving.target import Targets
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import read_layer_table
from branchdrive.model import arrays
from branchdrive.model.normalisation_document import Scalings, scalings_of
from branchdrive.model.objects import OBJECTS
from branchdrive.tables.arrow import from_arrow
from branchdrive.tables.frame import Frame, Values
from branchdrive.tables.stored import layer_frames

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["LAYER", "NORMALISATION_FILE", "PackedTables", "model_document", "not_expected"]

Array = NDArray[np.float64]

LAYER = "model"
NORMALISATION_FILE = "model/normalisation.json"


class PackedTables:
    """Tables of a model layer, each read and packed when it is first asked for, rows by group id in sorted order.

    In which partition a group is decides nothing but `assignment`, so layers that differ in that have one of these.
    """

    def __init__(self, folder: Store, descriptor: Descriptor) -> None:
        self.folder = folder
        self.descriptor = descriptor

    def stored(self, table: str) -> pa.Table:
        """Rows of a table as they are stored.

        Raises:
            UsageError: The layer has no such table.
            DatasetError: It cannot be read.
        """
        if table not in LAYERS[LAYER].tables:
            raise UsageError(f"no table {table!r} in the model layer, which has {list(LAYERS[LAYER].tables)}")
        return read_layer_table(self.folder, table)

    def frame(self, table: str) -> dict[str, Values]:
        """Rows of a table by column; errors as of `stored`."""
        return from_arrow(self.stored(table), table)

    def frames(self, table: str) -> Iterator[Frame]:
        """Rows of each file of a table, of which one is held at a time; errors as of `stored`."""
        return layer_frames(self.folder, table)

    @cached_property
    def assignment(self) -> dict[str, str]:
        """Partition of each group, in the order of group ids; a repeated group is a `DatasetError`."""
        frame = self.frame("contexts")
        assignment = dict(sorted(zip(frame["group_id"].tolist(), frame["partition"].tolist(), strict=True)))
        if len(assignment) != len(frame["group_id"]):
            raise DatasetError(f"{self.folder}: table `contexts` repeats a group; run `branchdrive-validate`")
        return assignment

    def _history(self, table: str) -> Array:
        return arrays.pack_history(self.frames(table), table, tuple(self.assignment))

    @cached_property
    def media_index(self) -> dict[str, Values]:
        """Rows of the media index."""
        return self.frame("media_index")

    @cached_property
    def state(self) -> Array:
        """Histories of states ``[groups, 16, features]``."""
        return self._history("state")

    @cached_property
    def controls(self) -> Array:
        """Histories of controls ``[groups, 80, 3]``."""
        return self._history("past_controls")

    @cached_property
    def expert(self) -> Array:
        """Commands of the expert, by group."""
        return self._history("expert")

    @cached_property
    def surroundings(self) -> arrays.Masked | None:
        """What is around the ego, with masks; ``None`` where nothing is recorded."""
        return arrays.pack_surroundings(self.frames("surroundings"), tuple(self.assignment))

    @cached_property
    def objects(self) -> arrays.PackedObjects:
        """What sensors tell of others; a layer without the table is a `DatasetError`."""
        return arrays.pack_objects(self.frame(OBJECTS), tuple(self.assignment))

    @cached_property
    def actions(self) -> NDArray[np.float32] | None:
        """Encodings ``[actions, width]`` in the order of the bank; a width that is not declared is a `DatasetError`."""
        encoded = arrays.pack_actions(self.frame("actions"), self.descriptor.action_bank.keys)
        declared = self.descriptor.action_encoding
        found, expected = None if encoded is None else encoded.shape[1], None if declared is None else declared.width
        if found != expected:
            raise DatasetError(
                f"{self.folder}: {table_path('actions')!r}: encodings have width {found}, and the descriptor "
                f"declares {expected}; run `branchdrive-validate`"
            )
        return encoded

    @cached_property
    def scalars(self) -> Targets:
        """Scalar targets of all groups and candidates, with masks."""
        return arrays.pack_scalars(self.frames("scalars"), tuple(self.assignment), self.descriptor.action_bank.keys)

    @cached_property
    def trajectories(self) -> Array:
        """Paths of all groups and candidates, metres."""
        return arrays.pack_trajectories(
            self.frames("trajectories"), tuple(self.assignment), self.descriptor.action_bank.keys
        ).values

    @cached_property
    def scalings(self) -> Scalings:
        """Scalings of the normalisation document."""
        return scalings_of(model_document(self.folder, NORMALISATION_FILE))


def model_document(folder: Store, path: str) -> dict[str, Any]:
    """A document of a layer that conforms to its schema.

    Raises:
        DatasetError: It cannot be read, is no JSON within the limits, or does not conform.
    """
    content = folder.read(path, spec_limits().max_document_bytes)
    try:
        document = parse_json(content)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{folder}: {path!r}: {error}; run `branchdrive-validate`") from error
    layer, _, name = path.partition("/")
    for wrong in schema_mismatches(document, LAYERS[layer].documents[name].schema):
        raise not_expected(folder, path, wrong)
    read: dict[str, Any] = document
    return read


def not_expected(root: object, path: str, wrong: Mismatch) -> DatasetError:
    """The error of a document of the dataset at `root` that does not say what is expected."""
    pointer = wrong.location["pointer"]
    return DatasetError(
        f"{root}: {path!r}: {pointer} is {wrong.found}, expected {wrong.expected}; run `branchdrive-validate`"
    )
