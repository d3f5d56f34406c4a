"""A release in which some training groups are held out, to be predicted by models that never saw them.

Validation stays what it is, and so does the normalisation: it is fitted on all training groups.

Source: this project's choice.
"""

from __future__ import annotations

from typing import NamedTuple

from branchdrive.errors import UsageError
from branchdrive.formats.place import Place
from branchdrive.model.reader import ModelLayer, open_model

__all__ = ["HELD_OUT", "Fold", "open_fold"]

HELD_OUT = "held_out"
"""Partition of the groups that a fold holds out."""


class Fold(NamedTuple):
    """One fold.

    Attributes:
        number: From 0; folds of one release have different numbers.
        groups: Ids of the training groups that it holds out.
    """

    number: int
    groups: tuple[str, ...]


def open_fold(release: ModelLayer | Place, fold: Fold) -> ModelLayer:
    """The model layer of a release with the groups of `fold` in the partition `HELD_OUT` instead of ``train``.

    Folds of one layer read its tables once.

    Raises:
        UsageError: A group of the fold is not a training group.
        DatasetError: As `open_model`.
    """
    layer = release if isinstance(release, ModelLayer) else open_model(release)
    strange = sorted(set(fold.groups) - set(layer.groups("train")))
    if strange:
        raise UsageError(f"{layer.folder}: fold {fold.number} holds out {strange[0]!r}, which is not a training group")
    return layer.with_assignment(dict.fromkeys(fold.groups, HELD_OUT))
