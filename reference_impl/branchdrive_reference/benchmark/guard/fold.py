"""The folds of the guard: models that never saw a part of training, and the risk learned from their predictions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.risk import RiskFit, Risks
from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.errors import UsageError
from branchdrive.runtime.environment import extra
from branchdrive.statistics.random_words import words
from branchdrive_reference.benchmark.document import keep_risks
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.benchmark.workspace import Workspace
from branchdrive_reference.learning.held_out import HELD_OUT, Fold, open_fold
from branchdrive_reference.learning.pool import Task
from branchdrive_reference.learning.prediction import predict

__all__ = ["NUM_FOLDS", "cluster_folds", "fit_guard", "fold_tasks"]

NUM_FOLDS = 5

FOLD_SEED = 0
"""Seed of the folds of the guard."""


def cluster_folds(clusters: Sequence[str], *, seed: int, num_folds: int = NUM_FOLDS) -> NDArray[np.intp]:
    """Fold of every group ``[groups]``, in ``0 .. num_folds - 1``, all groups of a cluster in one.

    Clusters come the larger first, equal ones by the words of the stream ``guard/folds``, one for each cluster in
    the order of their names, and each goes to the fold with the fewest groups, the first of them. The order of the
    groups decides nothing.

    Args:
        clusters: Cluster of every group ``[groups]``.
        seed: In ``[0, 2^64)``.
        num_folds: At least 2.

    Raises:
        ValueError: There are fewer clusters than folds, fewer than two folds, or the seed does not fit 64 bits.
    """
    names, place_of, sizes = np.unique(np.asarray(clusters, np.str_), return_inverse=True, return_counts=True)
    if not 2 <= num_folds <= len(names):
        raise ValueError(f"{len(names)} clusters cannot be parted into {num_folds} folds, at least 2")
    fold_of = np.empty(len(names), np.intp)
    load = np.zeros(num_folds, np.intp)
    drawn = words(seed, "guard/folds", 1, len(names))[0]
    for cluster in np.lexsort((drawn, -sizes)):
        fold_of[cluster] = load.argmin()
        load[fold_of[cluster]] += sizes[cluster]
    return np.asarray(fold_of[place_of])


def fold_tasks(release: Release, protocol: BenchmarkProtocol) -> list[Task]:
    """The guarded models with each of their seeds, without each fold of the training groups.

    A fold holds whole route clusters out, so that no neighbour of a group trains the model that predicts it.

    Raises:
        UsageError: There are fewer route clusters in training than folds.
    """
    groups = release.layer.groups("train")
    clusters = [str(release.clusters[group]) for group in groups]
    if len(set(clusters)) < NUM_FOLDS:
        raise UsageError(
            f"{release}: {len(set(clusters))} route clusters in training are too few for the "
            f"{NUM_FOLDS} folds of the guard; use `--no-guard`, or a release with more"
        )
    number = cluster_folds(clusters, seed=FOLD_SEED)
    folds = [
        Fold(fold, tuple(group for group, home in zip(groups, number.tolist(), strict=True) if home == fold))
        for fold in range(NUM_FOLDS)
    ]
    return [task._replace(fold=fold) for fold in folds for task in model_tasks(protocol, protocol.guard.models)]


def fit_guard(workspace: Workspace, protocol: BenchmarkProtocol, data: BenchmarkData, *, device: str) -> Risks:
    """Fit the risks on predictions of the trained folds, and let them wait for the ranking lock.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: Training holds no violation or nothing but violations.
        DatasetError: A fold cannot be read.
        ProgramError: The minimum of a regression was not found.
    """
    with extra("guard", of="the guard", otherwise="use `--no-guard`"):
        from branchdrive_reference.benchmark.guard.fit import fit_risk
        from branchdrive_reference.benchmark.guard.program import ProgramError
    release, guard = workspace.release, protocol.guard
    tasks, scale = fold_tasks(release, protocol), utility_scale(protocol, data)
    found: dict[tuple[str, float], RiskFit] = {}
    try:
        for model in guard.models:
            own = [task for task in tasks if task.configuration.model.name == model]
            scalars = _out_of_fold(release, workspace.folds, own, device=device)
            for tolerance_m in guard.tolerances_m:
                found[model, tolerance_m] = fit_risk(
                    scalars,
                    data.part(protocol.partitions.fit).targets,
                    nominal=data.nominal,
                    scale=scale,
                    profiles=protocol.preferences,
                    tolerance_m=tolerance_m,
                    alpha=guard.alpha,
                )
    except UsageError as error:
        raise UsageError(f"{release}: {error}; use `--no-guard` to go without a guard") from error
    except ProgramError as error:
        raise ProgramError(f"{release}: {error}; use `--no-guard` to go without a guard") from error
    keep_risks(workspace, protocol, found)
    return found


def _out_of_fold(release: Release, folder: Path, tasks: Sequence[Task], *, device: str) -> NDArray[np.float64]:
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
        (one,) = predict([task.path(folder)], open_fold(release.layer, task.fold), HELD_OUT, device=device)
        found[seeds.index(task.seed), [groups[group] for group in one.groups]] = one.scalars
    return found
