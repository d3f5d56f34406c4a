"""Branch groups as items of a torch dataset: one context, all its candidates, and what happened to each.

An item is a dictionary of tensors, float32 and masks bool, which the default loader stacks to batches::

    state       [16, 21]              actions     [A, encoding width]   the same in every item
    controls    [80, 3]               scalars     [A, 6]                mask  [A, 6]
                                      trajectory  [A, 10, 5]
    expert      [16, 4]               mixed and privileged contracts
    surroundings, surroundings_mask  [16, 11]     privileged contract
    objects [16, 32, 11], objects_mask [16, 32]   objects contract
    views [16, 6, *encoding], views_mask [16, 6]  where asked for
    bev   [16, 1, *encoding], bev_mask   [16, 1]  where asked for, privileged contract

Everything is normalised by the training scalings, except one-hots and flags, sines and cosines, actions,
surroundings and objects, which are as they are, and images, which are encoded and keep their type. No NaN is in an
item: where a mask is false stands 0, to be left out of a loss.
No identifier is in an item; `BranchGroupDataset.groups` has the group of each.

Source: paper, "Model Inputs and Targets"; spec/12-model.md#contracts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.driving.feature import InputContract
from branchdrive.errors import UsageError
from branchdrive.formats.place import Place
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.runtime.environment import install_command
from branchdrive_reference.learning.image_inputs import image_arrays

try:
    import torch
    from torch.utils.data import Dataset
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"`branchdrive_reference.learning` needs the package {error.name!r}: {install_command('models')}",
        name=error.name,
    ) from error

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from branchdrive_reference.learning.image_encoder import ImageEncoder

__all__ = ["BranchGroupDataset", "input_arrays"]


class BranchGroupDataset(Dataset[dict[str, torch.Tensor]]):
    """The branch groups of one partition under one input contract, in memory.

    Images are read where encoders are given for them: ``views`` of the six surround cameras, ``bev`` of the semantic
    bird's-eye view, see `branchdrive_reference.learning.image_encoder.open_encoder`.

    >>> from torch.utils.data import DataLoader
    >>> def loader(release: str) -> DataLoader:
    ...     return DataLoader(BranchGroupDataset(release, "train"), batch_size=32, shuffle=True)

    Attributes:
        groups: Ids of the groups, in the order of the items.
        candidate_order: Action keys, in the order of the candidate axis.
        contract: What the inputs may hold.

    Raises:
        UsageError: No group is in the partition, the release has not what the contract reads, or the contract refuses
            images.
        DatasetError: The release cannot be read.
    """

    def __init__(
        self,
        release: ModelLayer | Place,
        partition: str,
        contract: InputContract | str = InputContract.SENSOR,
        *,
        variant: str | None = None,
        images: Mapping[str, ImageEncoder] | None = None,
    ) -> None:
        layer = release if isinstance(release, ModelLayer) else open_model(release)
        self.groups = layer.groups(partition, variant)
        self.candidate_order = layer.candidate_order
        self.contract = contract = InputContract.named(contract)
        if not self.groups:
            raise UsageError(f"no group of the partition {partition!r} is in the variant {variant!r}")
        inputs = input_arrays(layer, partition, contract, variant)
        inputs |= image_arrays(layer, partition, contract, images or {}, variant)
        self._tensors = {name: _tensor(inputs.pop(name)) for name in [*inputs]}
        targets = layer.targets(partition, variant=variant, normalised=True)
        self._tensors["scalars"] = _tensor(np.where(targets.scalars_available, targets.scalars, 0.0))
        self._tensors["mask"] = _tensor(targets.scalars_available)
        self._tensors["trajectory"] = _tensor(targets.trajectories)
        has_encoding = layer.descriptor.action_encoding is not None
        self._shared = {"actions": _tensor(layer.actions())} if has_encoding else {}

    def __len__(self) -> int:
        return len(self.groups)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        """Tensors of one branch group.

        Raises:
            IndexError: There is no such item.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"item {index} of {len(self)}")
        return {**{name: values[index] for name, values in self._tensors.items()}, **self._shared}

    @property
    def tensors(self) -> dict[str, torch.Tensor]:
        """All items at once, groups first; what all of them share stands once."""
        return {**self._tensors, **self._shared}

    def __repr__(self) -> str:
        shapes = ", ".join(f"{name} {list(values.shape)}" for name, values in self[0].items())
        return f"BranchGroupDataset({len(self)} groups, {self.contract.value}: {shapes})"


def input_arrays(
    layer: ModelLayer, partition: str, contract: InputContract, variant: str | None
) -> dict[str, NDArray[Any]]:
    """Normalised inputs that the contract admits, and no others, by name; actions are not among them.

    Raises:
        UsageError: No group is in the partition, or the release has not what the contract reads.
        DatasetError: The release cannot be read.
    """
    match contract:
        case InputContract.SENSOR:
            sensor = layer.sensor_inputs(partition, variant=variant, normalised=True)
            return {"state": sensor.state, "controls": sensor.controls}
        case InputContract.OBJECTS:
            seen = layer.objects_inputs(partition, variant=variant, normalised=True)
            return {
                "state": seen.state,
                "controls": seen.controls,
                "objects": seen.objects,
                "objects_mask": seen.objects_available,
            }
        case InputContract.MIXED:
            mixed = layer.mixed_inputs(partition, variant=variant, normalised=True)
            return {"state": mixed.state, "controls": mixed.controls, "expert": mixed.expert}
        case InputContract.PRIVILEGED:
            full = layer.privileged_inputs(partition, variant=variant, normalised=True)
            return {
                "state": full.state,
                "controls": full.controls,
                "expert": full.expert,
                "surroundings": np.where(full.surroundings_available, full.surroundings, 0.0),
                "surroundings_mask": full.surroundings_available,
            }


def _tensor(values: NDArray[Any]) -> torch.Tensor:
    kind = values.dtype if values.dtype in (np.bool_, np.uint8) else np.float32
    return torch.from_numpy(np.array(values, kind, order="C"))
