"""Scenes of a dataset one after the other, and which groups and scenario types are left out, and why.

The file of a group's picture. The only place where text of a dataset becomes part of a path.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from branchdrive.contract.columns import PATTERNS
from branchdrive.errors import UsageError
from branchdrive.raw.reader import Dataset
from branchdrive_reference.drawing.elements import elements_around
from branchdrive_reference.drawing.scene import DrawnScene, read_scene
from branchdrive_reference.study.label import label

__all__ = ["Gallery", "named_pictures", "picture_path"]

_REASONS_OF_TYPE = 3
"""Groups of a scenario type that are named before the rest is counted."""


def named_pictures(
    dataset: Dataset, names: Sequence[str], folder: Path, file_format: str
) -> Iterator[tuple[Path, DrawnScene]]:
    """File and scene of every named group.

    Raises:
        UsageError: One cannot be drawn; before the first picture if that is for its name.
    """
    paths = [picture_path(folder, name, file_format) for name in names]
    for path, name in zip(paths, names, strict=True):
        yield path, _scene(dataset, name)


def _scene(dataset: Dataset, group_id: str) -> DrawnScene:
    """The scene of a group with the map around it."""
    scene = read_scene(dataset.group(group_id), dataset.descriptor)
    return replace(scene, elements=elements_around(dataset, scene))


class Gallery:
    """Pictures of the groups that can be drawn, the first of each scenario type or all of them.

    Args:
        dataset: Where the groups lie.
        types: Scenario type of every group that is wanted, in the order of the dataset.
        every: Whether all groups of a type are drawn, not only the first.
    """

    def __init__(self, dataset: Dataset, types: Mapping[str, str], *, every: bool) -> None:
        self._dataset = dataset
        self._types = types
        self._every = every
        self._reasons: dict[str, list[str]] = {}
        self._num_left_out: dict[str, int] = {}
        self._drawn: set[str] = set()

    def __len__(self) -> int:
        """Pictures to come at most."""
        return len(self._types) if self._every else len(set(self._types.values()))

    def pictures(self, folder: Path, file_format: str) -> Iterator[tuple[Path, DrawnScene]]:
        """File and scene of every picture; a group that cannot be drawn gives way to the next of its type."""
        for group_id, scenario_type in self._types.items():
            if scenario_type in self._drawn and not self._every:
                continue
            try:
                path = picture_path(folder, group_id, file_format)
                scene = _scene(self._dataset, group_id)
            except UsageError as error:
                self._leave_out(scenario_type, str(error))
            else:
                self._drawn.add(scenario_type)
                yield path, scene

    def _leave_out(self, scenario_type: str, reason: str) -> None:
        self._num_left_out[scenario_type] = self._num_left_out.get(scenario_type, 0) + 1
        reasons = self._reasons.setdefault(scenario_type, [])
        if len(reasons) < _REASONS_OF_TYPE:
            reasons.append(reason)

    def left_out(self) -> list[str]:
        """One line for every group that was left out, a few of each type, and for every type without picture."""
        lines = []
        for scenario_type, reasons in self._reasons.items():
            lines += [f"not drawn: {reason}" for reason in reasons]
            num, name = self._num_left_out[scenario_type], label(scenario_type)
            if num > len(reasons):
                lines.append(f"not drawn: {num - len(reasons):,} more groups of scenario type '{name}'")
            if scenario_type not in self._drawn:
                lines.append(f"no picture of scenario type '{name}': none of its {num:,} groups can be drawn")
        return lines


def picture_path(folder: Path, group_id: str, file_format: str) -> Path:
    """Where the picture of a group lies, directly in `folder`.

    Raises:
        UsageError: The id is none that the format allows: it might name a place elsewhere.
    """
    if not re.fullmatch(PATTERNS["id"], group_id):
        raise UsageError(
            f"group '{label(group_id)}' has an id that the format does not allow; no picture is named after it"
        )
    return folder / f"{group_id}.{file_format}"
