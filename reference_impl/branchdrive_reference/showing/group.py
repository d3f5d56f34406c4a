"""A group of a dataset, read so that it can be shown."""

from __future__ import annotations

from dataclasses import replace

from branchdrive.contract.columns import STREAMS
from branchdrive.errors import UsageError
from branchdrive.raw.reader import Dataset
from branchdrive.release.publish import is_rendering
from branchdrive_reference.drawing.elements import elements_around
from branchdrive_reference.drawing.scene import read_scene
from branchdrive_reference.showing.sheet import Sheet
from branchdrive_reference.study.bank import canonical_bank

__all__ = ["read_sheet"]


def read_sheet(dataset: Dataset, group_id: str) -> Sheet:
    """The sheet of a group.

    Raises:
        UsageError: The dataset has no media, or the group cannot be shown.
        DatasetError: A file cannot be read.
    """
    descriptor = dataset.descriptor
    if not any(STREAMS[name].cameras for name in descriptor.streams):
        advice = "add them with `branchdrive render`"
        if is_rendering(dataset.root):
            advice = "a `branchdrive render` was interrupted: run it again"
        raise UsageError(f"{str(dataset.root)!r} has no media; {advice}")
    group = dataset.group(group_id)
    scene = read_scene(group, descriptor)
    scene = replace(scene, elements=elements_around(dataset, scene))
    bank = dict(zip(descriptor.action_bank.keys, canonical_bank(group, descriptor), strict=True))
    return Sheet(scene, bank[descriptor.action_bank.nominal.key], descriptor)
