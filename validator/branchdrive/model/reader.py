"""The model layer of a release as arrays: read lazily and by key, under typed input contracts.

A table is read when it is first asked for, within the spec limits, and packed by key; the rows of every array are
in the order of `ModelLayer.groups`. The reader does not judge the release: `branchdrive-validate` does. It refuses
what it cannot pack without a guess.

Source: paper, "Model Inputs and Targets" and "Release Structure"; spec/12-model.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.text import nearest, quote
from branchdrive.driving.feature import InputContract
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import PROFILES, fit_scale, utility
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import folder_of
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import conform, read_layer_table
from branchdrive.model import arrays
from branchdrive.model.contract import MixedInputs, ModelTargets, ObjectsInputs, PrivilegedInputs, SensorInputs
from branchdrive.model.features import admit_column, feature_mismatches, recorded_features
from branchdrive.model.images import ImageHistory
from branchdrive.model.normalisation_document import Scalings
from branchdrive.model.objects import OBJECTS
from branchdrive.model.packed_tables import LAYER, PackedTables, model_document, not_expected
from branchdrive.quality.partition import PARTITIONS
from branchdrive.quality.variants import EXTENDED, declared_of, members
from branchdrive.tables.arrow import from_arrow

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["ModelLayer", "open_model"]

Array = NDArray[np.float64]

FEATURES_FILE = "model/features.json"
VARIANTS_FILE = "quality/variants.json"


def open_model(root: Place, *, follow_links: bool = False, allow: Sequence[str | Path] = ()) -> ModelLayer:
    """Open the model layer of the dataset or detached release at `root`.

    Args:
        root: The dataset folder; or a bucket, an archive, or a place that is open, see `open_store`.
        follow_links: Whether links are followed: those that stay in the dataset, and those into `allow`.
        allow: Folders that links may lead into, such as the folder of blobs of a download cache.

    Raises:
        DatasetError: There is no dataset or it has no model layer, or its features are not those of its descriptor.
        UsageError: As `open_store`.
        PlatformError: As `open_store`.
    """
    folder = open_store(root, follow_links=follow_links, allow=allow)
    if not folder.is_there:
        raise DatasetError(f"{str(root)!r} is not a folder; pass the folder that holds `branchdrive.json`")
    descriptor = read_descriptor(folder)
    if LAYER not in descriptor.layers:
        raise DatasetError(
            f"{root}: has the layers {list(descriptor.layers)} and no model layer; run `branchdrive build`"
        )
    for wrong in feature_mismatches(model_document(folder, FEATURES_FILE), descriptor):
        raise not_expected(root, FEATURES_FILE, wrong)
    return ModelLayer(folder, descriptor)


class ModelLayer:
    """The model layer of a release; made by `open_model`.

    Every array has one row for each group of `groups` with the same `partition` and `variant`, in that order. A
    feature that the dataset does not record (`features.json` says which) is NaN in its units and 0 where normalised.

    Attributes:
        folder: Where the dataset or detached release is.
        descriptor: What the dataset is.
    """

    def __init__(self, folder: Store, descriptor: Descriptor) -> None:
        self.folder = folder
        self.descriptor = descriptor
        self._packed = PackedTables(folder, descriptor)

    def with_assignment(self, assignment: Mapping[str, str]) -> ModelLayer:
        """The same layer with groups in other partitions; what one of them has read, the other does not read again.

        Args:
            assignment: Partition, of any name, of the groups that change theirs.
        """
        return _ReassignedLayer(self, assignment)

    @property
    def root(self) -> Path:
        """Folder of the dataset or detached release.

        Raises:
            UsageError: It is in no folder.
        """
        return folder_of(self.folder, "this").root

    @property
    def candidate_order(self) -> tuple[str, ...]:
        """Action keys in the order of the candidate axis."""
        return self.descriptor.action_bank.keys

    def groups(self, partition: str | None = None, variant: str | None = None) -> tuple[str, ...]:
        """Sorted ids of the groups: of the frozen population, or of a declared variant of it.

        Raises:
            UsageError: The partition is unknown or has no group, there is no such variant, or the variant has groups
                that are not in the frozen population, of which the layer has no rows.
        """
        return tuple(self._group_ids[row] for row in self._rows(partition, variant))

    def sensor_inputs(
        self, partition: str | None = None, *, variant: str | None = None, normalised: bool = False
    ) -> SensorInputs:
        """What the ego vehicle can know on the road.

        Args:
            partition: ``train``, ``val``, ``test`` or ``calibration``; all groups by default.
            variant: A declared variant; the frozen population by default.
            normalised: Scale by the statistics of the training groups.

        Raises:
            UsageError: As `groups`.
            DatasetError: A file cannot be read, or its rows cannot be packed.
        """
        rows = self._rows(partition, variant)
        return SensorInputs(**self._histories(rows, normalised=normalised))

    def objects_inputs(
        self, partition: str | None = None, *, variant: str | None = None, normalised: bool = False
    ) -> ObjectsInputs:
        """And what sensors of the vehicle tell of others; see `sensor_inputs`.

        Raises:
            UsageError: As `groups`.
            DatasetError: As `sensor_inputs`, or the release has no objects.
        """
        rows, objects = self._rows(partition, variant), self._packed.objects
        return ObjectsInputs(
            **self._histories(rows, normalised=normalised),
            objects=objects.values[rows],
            objects_available=objects.available[rows],
        )

    def mixed_inputs(
        self, partition: str | None = None, *, variant: str | None = None, normalised: bool = False
    ) -> MixedInputs:
        """And what the privileged expert computes; see `sensor_inputs`."""
        rows = self._rows(partition, variant)
        return MixedInputs(**self._histories(rows, normalised=normalised), expert=self._expert_rows(rows, normalised))

    def privileged_inputs(
        self, partition: str | None = None, *, variant: str | None = None, normalised: bool = False
    ) -> PrivilegedInputs:
        """And privileged evidence around the vehicle; see `sensor_inputs`.

        Raises:
            UsageError: As `groups`, or the dataset has no evidence.
        """
        rows, surroundings = self._rows(partition, variant), self._packed.surroundings
        if surroundings is None:
            raise UsageError(f"{self.folder}: has no evidence of surroundings; use the contract 'mixed' or 'sensor'")
        return PrivilegedInputs(
            **self._histories(rows, normalised=normalised),
            expert=self._expert_rows(rows, normalised),
            surroundings=surroundings.values[rows],
            surroundings_available=surroundings.available[rows],
        )

    def targets(
        self, partition: str | None = None, *, variant: str | None = None, normalised: bool = False
    ) -> ModelTargets:
        """What happened to every candidate, candidates in `candidate_order`.

        Normalised, a scalar target without any training value to fit on is available nowhere.
        See `sensor_inputs` for arguments and errors.
        """
        rows, packed = self._rows(partition, variant), self._packed
        scalars, available = packed.scalars.values[rows], packed.scalars.available[rows]
        trajectories = packed.trajectories[rows]
        if normalised:
            scaling = self.scalings()
            scalars, trajectories = scaling.scalars.apply(scalars), scaling.trajectories.apply(trajectories)
            available = available & np.isfinite(scaling.scalars.offset)
        return ModelTargets(scalars, available, trajectories)

    def outcomes(self, partition: str | None = None, *, variant: str | None = None) -> pa.Table:
        """What happened to every candidate, and how desirable that is by each profile: one row for each.

        The six targets are null where they are not available. A column ``utility_<profile>`` for each of
        `branchdrive.driving.utility.PROFILES` weighs them by their spread in training and is null where one that it
        weighs is not available; it is a preference, and no judgement of safety.
        See `sensor_inputs` for arguments and errors.
        """
        import pyarrow as pa

        groups, found = self.groups(partition, variant), self.targets(partition, variant=variant)
        targets, num = Targets(found.scalars, found.scalars_available), len(self.candidate_order)
        train = self.targets("train")
        scale = fit_scale(Targets(train.scalars, train.scalars_available))
        columns: dict[str, Any] = {
            "group_id": pa.array([group for group in groups for _ in range(num)], pa.string()),
            "action_key": pa.array([*self.candidate_order] * len(groups), pa.string()),
        }
        for place, target in enumerate(TARGETS):
            missing = ~targets.available[..., place].ravel()
            columns[target.name] = pa.array(targets.values[..., place].ravel(), mask=missing)
        for name, profile in PROFILES.items():
            worth = utility(targets, scale, profile).ravel()
            columns[f"utility_{name}"] = pa.array(worth, mask=np.isnan(worth))
        return pa.table(columns)

    def actions(self) -> NDArray[np.float32]:
        """Encoded candidate actions, float32 ``[A, encoding width]``, in `candidate_order`.

        Raises:
            UsageError: The dataset declares no encoding of its bank.
        """
        encoded = self._packed.actions
        if encoded is None:
            raise UsageError(
                f"{self.folder}: declares no encoding of its action bank; encode `candidate_order` yourself"
            )
        return encoded.copy()

    def column(
        self,
        contract: InputContract | str,
        table: str,
        column: str,
        partition: str | None = None,
        *,
        variant: str | None = None,
    ) -> NDArray[Any]:
        """One input column in its own type, as `contract` admits it: ``[N, rows]``, and ``[A]`` for an encoding.

        A column that may be null is a masked array; one that the dataset records throughout is not.

        Raises:
            UsageError: No such column, or the contract refuses its track: identifiers and outcomes always; or it is
                one of objects, of which an observation has any number.
            DatasetError: A file cannot be read, or its rows cannot be packed.
        """
        declared = admit_column(InputContract.named(contract), table, column)
        if table == OBJECTS:
            raise UsageError(
                f"column `{table}.{column}` has no row for each observation; use `objects_inputs` or `arrow`"
            )
        packed = arrays.pack_column(self._packed.frame(table), table, column, self._group_ids, self.candidate_order)
        values = np.ma.getdata(packed) if declared.is_required(self.descriptor.unrecorded) else packed
        return values if table == "actions" else values[self._rows(partition, variant)]

    def images(
        self, contract: InputContract | str, stream: str, partition: str | None = None, *, variant: str | None = None
    ) -> ImageHistory:
        """Images of a stream at the 16 observations of the history, cameras in the order of the stream.

        They lie in the raw layer and are read one by one.

        Raises:
            UsageError: As `groups`; the contract refuses the stream, as `sensor` does ``semantic_bev``; or the dataset
                does not claim it.
            DatasetError: The media index cannot be read or packed.
        """
        declared = InputContract.named(contract).admit_stream(stream)
        if stream not in self.descriptor.streams:
            claimed = [name for name in self.descriptor.streams if STREAMS[name].cameras]
            raise UsageError(f"{self.folder}: has no images of the stream {stream!r}; it claims {claimed}")
        groups = self.groups(partition, variant)
        return ImageHistory(self.folder, self.descriptor, self._packed.media_index, groups, declared.cameras)

    def scalings(self) -> Scalings:
        """Scalings that were fitted on training groups, to normalise and to invert."""
        return self._packed.scalings

    def arrow(self, table: str) -> pa.Table:
        """A table of the model layer with its declared Arrow schema, identifiers and all; no contract applies.

        Raises:
            UsageError: The model layer has no such table.
            DatasetError: The file cannot be read safely, or its columns are not those declared.
        """
        return conform(self._packed.stored(table), table)

    def __repr__(self) -> str:
        return f"ModelLayer({self.descriptor.dataset_id!r} at {str(self.folder)!r})"

    @property
    def _contexts(self) -> Mapping[str, str]:
        """Partition of every group, by group id in sorted order."""
        return self._packed.assignment

    @property
    def _group_ids(self) -> tuple[str, ...]:
        return tuple(self._contexts)

    def _rows(self, partition: str | None, variant: str | None) -> NDArray[np.int64]:
        """Rows of all arrays that hold the groups of a partition and a variant."""
        partitions = np.array(list(self._contexts.values()), object)
        wanted = np.ones(len(partitions), bool)
        if partition is not None:
            wanted &= partitions == partition
            if not wanted.any() and partition not in PARTITIONS:
                raise UsageError(
                    f"{self.folder}: unknown partition {quote(partition)}; {nearest(partition, PARTITIONS)}"
                )
            if not wanted.any():
                present = sorted(set(partitions.tolist()))
                raise UsageError(f"{self.folder}: no group is in the partition {partition!r}; groups are in {present}")
        if variant is not None:
            members = self._variant(variant)
            wanted &= np.array([group_id in members for group_id in self._group_ids], bool)
        return np.flatnonzero(wanted)

    def _variant(self, name: str) -> frozenset[str]:
        document = model_document(self.folder, VARIANTS_FILE)
        try:
            declared = {variant.name: variant for variant in (EXTENDED, *declared_of(document))}
        except UsageError as error:
            raise DatasetError(
                f"{self.folder}: {VARIANTS_FILE!r} declares no variants; run `branchdrive-validate`"
            ) from error
        if name not in declared:
            raise UsageError(f"{self.folder}: no variant {name!r}; there are {list(declared)}")
        quality = from_arrow(read_layer_table(self.folder, "group_quality"), "group_quality")
        found = frozenset(quality["group_id"][members(quality, declared[name].where)].tolist())
        outside = sorted(found - self._contexts.keys())
        if outside:
            raise UsageError(
                f"{self.folder}: {len(outside)} groups of the variant {name!r}, as {outside[0]!r}, are not in the "
                "frozen population, and the model layer has no rows of them"
            )
        return found

    def _histories(self, rows: NDArray[np.int64], *, normalised: bool) -> dict[str, Array]:
        state, controls = self._packed.state[rows], self._packed.controls[rows]
        if normalised:
            state, controls = self.scalings().state.apply(state), self.scalings().controls.apply(controls)
            state = self._zero_where_unrecorded("state", state)
        return {"state": state, "controls": controls}

    def _expert_rows(self, rows: NDArray[np.int64], normalised: bool) -> Array:
        if not normalised:
            return self._packed.expert[rows]
        return self._zero_where_unrecorded("expert", self.scalings().expert.apply(self._packed.expert[rows]))

    def _zero_where_unrecorded(self, table: str, values: Array) -> Array:
        return np.where(recorded_features(table, self.descriptor), values, 0.0)


class _ReassignedLayer(ModelLayer):
    """A model layer in which some groups are in other partitions."""

    def __init__(self, layer: ModelLayer, assignment: Mapping[str, str]) -> None:
        super().__init__(layer.folder, layer.descriptor)
        self._packed = layer._packed
        self._homes = {**layer._contexts, **assignment}

    @property
    def _contexts(self) -> Mapping[str, str]:
        return self._homes
