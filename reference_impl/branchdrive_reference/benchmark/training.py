"""Training the models of a benchmark, and the folds of the guard, with one progress for all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from branchdrive.cli.progress import Update
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.guard.fold import NUM_FOLDS, cluster_folds
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.configuration import Configuration
from branchdrive_reference.learning.fold import HELD_OUT, Fold, open_fold
from branchdrive_reference.learning.pool import Task, train_models
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.training import EpochReport

__all__ = ["fold_tasks", "model_tasks", "out_of_fold", "train"]

FOLD_SEED = 0
"""Seed of the folds of the guard."""


def model_tasks(protocol: BenchmarkProtocol, models: Sequence[str] | None = None) -> list[Task]:
    """Every declared model with each of its seeds; of the named models only, where some are named.

    Raises:
        UsageError: No model is called so.
        DatasetError: A model's configuration is none of this software.
    """
    declared = [model.id for model in protocol.models]
    unknown = [name for name in models or () if name not in declared]
    if unknown:
        raise UsageError(f"no model {unknown[0]!r}; the protocol declares {', '.join(declared)}")
    return [
        Task(Configuration.from_record(model.configuration), seed)
        for model in protocol.models
        if models is None or model.id in models
        for seed in model.seeds
    ]


def fold_tasks(release: Release, protocol: BenchmarkProtocol) -> list[Task]:
    """The guard's model with each of its seeds, without each fold of the training groups.

    A fold holds whole route clusters out, so that no neighbour of a group trains the model that predicts it.

    Raises:
        UsageError: There are fewer route clusters in training than folds.
    """
    groups = release.layer.groups("train")
    clusters = [str(release.clusters[group]) for group in groups]
    if len(set(clusters)) < NUM_FOLDS:
        raise UsageError(
            f"{release.root}: {len(set(clusters))} route clusters in training make no {NUM_FOLDS} folds for the guard; "
            "use `--no-guard`, or a release with more"
        )
    number = cluster_folds(clusters, seed=FOLD_SEED)
    folds = [
        Fold(fold, tuple(group for group, home in zip(groups, number.tolist(), strict=True) if home == fold))
        for fold in range(NUM_FOLDS)
    ]
    return [task._replace(fold=fold) for fold in folds for task in model_tasks(protocol, [protocol.guard.model])]


def train(
    release: Release, folder: Path, tasks: Sequence[Task], *, jobs: int, device: str, show: Update
) -> list[Checkpoint]:
    """Train the tasks, or go on where a training was interrupted; see `train_models`."""
    return train_models(release.root, folder, tasks, jobs=jobs, device=device, on_epoch=_watch(tasks, show))


def _watch(tasks: Sequence[Task], show: Update) -> Callable[[EpochReport], None]:
    """Shows epochs of all tasks; one that is over, or was before, counts with all its epochs."""
    most = [task.configuration.training.max_epochs if task.configuration.model.is_trained else 0 for task in tasks]
    total, done = (
        sum(most),
        dict.fromkeys(((t.configuration.model.name, t.seed, t.fold and t.fold.number) for t in tasks), 0),
    )

    def watch(report: EpochReport) -> None:
        done[report.model, report.seed, report.fold] = report.max_epochs if report.is_last else report.epoch
        fold = "" if report.fold is None else f" fold {report.fold + 1}"
        show(sum(done.values()), total, f"epochs, {report.model} seed {report.seed}{fold} loss {report.val_loss:.3f}")

    show(0, total, "epochs")
    return watch


def out_of_fold(release: Release, folder: Path, tasks: Sequence[Task], *, device: str) -> NDArray[np.float64]:
    """Predicted scalars ``[seeds, groups, candidates, 6]`` of training groups, each by models that never saw it.

    Args:
        release: The release.
        folder: Of the trained folds.
        tasks: All of `fold_tasks`.
        device: ``cpu``, ``cuda`` or ``auto``.
    """
    groups = {group: row for row, group in enumerate(release.layer.groups("train"))}
    seeds = list(dict.fromkeys(task.seed for task in tasks))
    found = np.full((len(seeds), len(groups), len(release.layer.candidate_order), 6), np.nan)
    for task in tasks:
        if task.fold is None:
            raise UsageError(f"{task.name} holds nothing out")
        (one,) = predict([task.path(folder)], open_fold(release.root, task.fold), HELD_OUT, device=device)
        found[seeds.index(task.seed), [groups[group] for group in one.groups]] = one.scalars
    return found
