"""Learning curves: what regret selectors leave on groups they did not see, by how many they were fitted on.

All groups are of ``train``. Five folds of whole route clusters hold each of them out once; of what a fold leaves,
samples are the first groups of the order of clusters that the stream ``curve/clusters`` draws, so that a smaller one is
part of a larger one. Networks stop by ``val``. No outcome of ``test`` or ``calibration`` is read, so a curve is no
access to what a benchmark reports.

    regret of a selector at a size = mean over ranked groups g of regret_g of the selector that was fitted on the
                                     sample of that size of the fold that holds g out

Intervals resample route clusters. Scales of inputs and of utilities are those of all of ``train``.

Source: this project's choice; measures as in spec/14-benchmark.md#ranking.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.data import BenchmarkData, Part
from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.prediction.metric.table import Interval
from branchdrive.benchmark.prediction.record import interval_record
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.benchmark.protocol.selection import ENSEMBLE, Baseline
from branchdrive.benchmark.ranking.baseline import estimate, is_seen
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.measure import Selector, best_fixed, by_score, fixed, measures
from branchdrive.cli.progress import Update
from branchdrive.driving.feature import InputContract
from branchdrive.driving.utility import Scale, predicted_utility, utility
from branchdrive.errors import UsageError
from branchdrive.runtime.executor import Executor
from branchdrive.statistics.bca import intervals
from branchdrive.statistics.bootstrap import Design, counted_mean, design
from branchdrive.statistics.random_words import words
from branchdrive_reference.benchmark.guard.fold import NUM_FOLDS, cluster_folds
from branchdrive_reference.benchmark.release import Release, baseline_contexts, benchmark_data, need_objects
from branchdrive_reference.benchmark.training import drop_stale, model_tasks, train
from branchdrive_reference.learning.held_out import HELD_OUT, Fold, open_fold
from branchdrive_reference.learning.pool import Task
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.trees import need_scikit_learn

__all__ = ["ACTION_PRIOR", "NOMINAL", "Curve", "Sample", "learning_curve", "open_curve"]

Array = NDArray[np.float64]

NOMINAL, ACTION_PRIOR = "nominal", "action_prior"

FOLD_SEED = 0
"""Seed of folds and of the order of clusters."""

CHECKPOINTS_DIR = "checkpoints"


class Sample(NamedTuple):
    """Groups to fit on, and groups that what was fitted is judged by; no route cluster has groups of both.

    Attributes:
        number: From 0, over all sizes of all folds.
        size: How many there are to fit on.
        fitted: Their ids.
        judged: Ids of those that the fold holds out.
    """

    number: int
    size: int
    fitted: tuple[str, ...]
    judged: tuple[str, ...]


class Curve(NamedTuple):
    """What is to be fitted, and on what.

    Attributes:
        release: The release.
        protocol: Declares models, baselines and preferences.
        models: Names of the models.
        num_seeds: How many of the seeds of each.
        samples: A sample for every fold and size.
        data: Outcomes.
        contexts: What baselines see; ``None`` where none is declared.
    """

    release: Release
    protocol: BenchmarkProtocol
    models: tuple[str, ...]
    num_seeds: int
    samples: tuple[Sample, ...]
    data: BenchmarkData
    contexts: Contexts | None

    @property
    def sizes(self) -> list[int]:
        """Sizes of samples, ascending."""
        return sorted({sample.size for sample in self.samples})

    @property
    def part(self) -> Part:
        """The groups of ``train``."""
        return self.data.part(self.protocol.partitions.fit)

    @property
    def baselines(self) -> list[Baseline]:
        """Declared baselines that the dataset has something for."""
        contexts = self.contexts
        return [] if contexts is None else [one for one in self.protocol.baselines if is_seen(one, contexts)]

    @property
    def selectors(self) -> list[str]:
        """Names of the selectors, models last."""
        names = [one.name for one in self.baselines]
        return [NOMINAL, ACTION_PRIOR, *names, *(f"{ENSEMBLE}{model}" for model in self.models)]

    def fold(self, sample: Sample) -> Fold:
        """All groups of ``train`` that are not in a sample."""
        kept = set(sample.fitted)
        return Fold(sample.number, tuple(group for group in self.part.groups if group not in kept))

    def tasks(self, sample: Sample, model: str) -> list[Task]:
        """Trainings of a model on a sample, one for each seed."""
        fold = self.fold(sample)
        return [task._replace(fold=fold) for task in model_tasks(self.protocol, [model])[: self.num_seeds]]


def open_curve(
    release: Release,
    protocol: BenchmarkProtocol,
    *,
    models: Sequence[str] | None = None,
    sizes: Sequence[int] = (),
    num_seeds: int = 1,
) -> Curve:
    """Plan a learning curve, and refuse what cannot be fitted before anything is.

    Args:
        release: With a model layer.
        protocol: Declares models, baselines and preferences.
        models: Their names; by default all that read no image.
        sizes: How many groups to fit on; by default a quarter, a half and all of what the smallest fold leaves.
        num_seeds: How many of the declared seeds of a model; all where it has fewer.

    Raises:
        UsageError: No model is called so, ``train`` has too few route clusters, or a size is more than a fold leaves.
        DatasetError: The release cannot be read, or has no objects and a model reads some.
        PlatformError: Trees are missing, and the extra for them is not installed.
    """
    readers = {task.configuration.model.name: task.configuration.model for task in model_tasks(protocol, models)}
    wanted = [name for name, model in readers.items() if models is not None or not model.images]
    if any(readers[name].trees for name in wanted):
        need_scikit_learn()
    if any(readers[name].contract == InputContract.OBJECTS.value for name in wanted):
        need_objects(release)
    data = benchmark_data(release)
    samples = _samples(release, data.part(protocol.partitions.fit), sizes)
    contexts = baseline_contexts(release, protocol, data)
    return Curve(release, protocol, tuple(wanted), num_seeds, samples, data, contexts)


def _samples(release: Release, part: Part, sizes: Sequence[int]) -> tuple[Sample, ...]:
    """Samples of all folds, sizes of a fold ascending."""
    num_clusters = len(set(part.clusters))
    if num_clusters < NUM_FOLDS:
        raise UsageError(
            f"{release}: {num_clusters} route clusters in `train` are too few for {NUM_FOLDS} folds of a learning curve"
        )
    home = cluster_folds(part.clusters, seed=FOLD_SEED)
    names = sorted(set(part.clusters))
    drawn = dict(zip(names, words(FOLD_SEED, "curve/clusters", 1, len(names))[0].tolist(), strict=True))
    order = sorted(range(len(part.groups)), key=lambda i: (drawn[part.clusters[i]], part.clusters[i], part.groups[i]))
    most = min(int((home != fold).sum()) for fold in range(NUM_FOLDS))
    asked = sorted(set(sizes)) or sorted({max(1, most // 4), max(1, most // 2), most})
    if asked[-1] > most:
        raise UsageError(
            f"{release}: {NUM_FOLDS} folds leave {most} groups of `train`; a sample cannot have {asked[-1]}"
        )
    found: list[Sample] = []
    for fold in range(NUM_FOLDS):
        rest = [part.groups[i] for i in order if home[i] != fold]
        judged = tuple(group for group, one in zip(part.groups, home.tolist(), strict=True) if one == fold)
        found += [Sample(len(found) + k, size, tuple(rest[:size]), judged) for k, size in enumerate(asked)]
    return tuple(found)


def learning_curve(
    curve: Curve, folder: Path, *, jobs: int, executor: Executor | None = None, device: str, show: Update
) -> dict[str, Any]:
    """Fit, judge, and tell; what is in the folder already is not trained again.

    Args:
        curve: What to fit on what.
        folder: Of checkpoints.
        jobs: Processes that train.
        executor: See `train_models`.
        device: Where torch computes.
        show: Called with the progress.

    Returns:
        The figures as a document.

    Raises:
        UsageError: As `train_models`.
        DatasetError: As `train_models`.
    """
    place = folder / CHECKPOINTS_DIR
    tasks = [task for sample in curve.samples for model in curve.models for task in curve.tasks(sample, model)]
    drop_stale(place, tasks)
    train(curve.release, place, tasks, jobs=jobs, executor=executor, device=device, show=show)
    part, statistics = curve.part, curve.protocol.statistics
    resampling = design(part.clusters, seed=int(statistics.seed), num_resamples=int(statistics.resamples))
    scale = utility_scale(curve.protocol, curve.data)
    predicted = {
        (sample.number, model): _predicted(curve, sample, model, place, device)
        for sample in curve.samples
        for model in curve.models
    }
    return {
        "protocol": curve.protocol.name,
        "protocol_digest": curve.protocol.digest,
        "num_groups": len(part.groups),
        "num_clusters": len(set(part.clusters)),
        "num_folds": NUM_FOLDS,
        "num_seeds": curve.num_seeds,
        "sizes": curve.sizes,
        "selectors": curve.selectors,
        "reference": _reference(curve),
        "profiles": [_profile_record(curve, name, scale, resampling, predicted) for name in curve.protocol.preferences],
    }


def _predicted(curve: Curve, sample: Sample, model: str, place: Path, device: str) -> Array:
    """Mean predicted scalars ``[judged, candidates, 6]`` of the seeds of a model."""
    layer, paths = (
        open_fold(curve.release.layer, curve.fold(sample)),
        [t.path(place) for t in curve.tasks(sample, model)],
    )
    found = predict(paths, layer, HELD_OUT, device=device)
    row = {group: i for i, group in enumerate(found[0].groups)}
    kept = [row[group] for group in sample.judged]
    return np.asarray(np.mean([one.scalars[kept] for one in found], axis=0))


def _reference(curve: Curve) -> str:
    """The selector that others are held against: the first declared baseline, else the best constant."""
    return next((one.name for one in curve.baselines), ACTION_PRIOR)


def _profile_record(
    curve: Curve, profile: str, scale: Scale, resampling: Design, predicted: Mapping[tuple[int, str], Array]
) -> dict[str, Any]:
    """Regrets under one profile."""
    executed = utility(curve.part.targets, scale, curve.protocol.preferences[profile])
    is_ranked = np.asarray(np.isfinite(executed).all(axis=1))
    regrets = np.full((len(executed), len(curve.sizes), len(curve.selectors)), np.nan)
    row = {group: i for i, group in enumerate(curve.part.groups)}
    for sample in curve.samples:
        fitted, judged = ([row[group] for group in groups] for groups in (sample.fitted, sample.judged))
        if not is_ranked[fitted].any():
            return {"profile": profile, "num_ranked": int(is_ranked.sum()), "points": []}
        own = {model: scalars for (number, model), scalars in predicted.items() if number == sample.number}
        there, column = is_ranked[judged], curve.sizes.index(sample.size)
        rows = np.array(judged, np.intp)[there]
        for k, selector in enumerate(_choices(curve, sample, profile, scale, executed[fitted], own)):
            kept = Selector(selector.scores[there], selector.shares[there])
            regrets[rows, column, k] = measures(kept, executed[rows], nominal=curve.data.nominal).regret
    return {"profile": profile, "num_ranked": int(is_ranked.sum()), "points": _points(curve, regrets, resampling)}


def _choices(
    curve: Curve, sample: Sample, profile: str, scale: Scale, known: Array, predicted: Mapping[str, Array]
) -> list[Selector]:
    """What the selectors choose in the judged groups of a sample, in the order of `Curve.selectors`."""
    num_judged, num_candidates, contexts = len(sample.judged), len(curve.data.candidates), curve.contexts
    found = [fixed(place, num_judged, num_candidates) for place in (curve.data.nominal, best_fixed(known))]
    if contexts is not None:
        found += [by_score(estimate(one, contexts, sample.fitted, known, sample.judged)) for one in curve.baselines]
    preference = curve.protocol.preferences[profile]
    return found + [by_score(predicted_utility(predicted[model], scale, preference)) for model in curve.models]


def _points(curve: Curve, regrets: Array, resampling: Design) -> list[dict[str, Any]]:
    """Regret of every selector at every size, and its difference to the reference of that size."""
    reference = curve.selectors.index(_reference(curve))
    both = np.concatenate([regrets, regrets - regrets[:, :, [reference]]], axis=2).reshape(len(regrets), -1)
    there = ~np.isnan(both)
    parts = resampling.split(counted_mean(resampling, both))
    ends = intervals(*parts, there.sum(axis=0), resampling.clusters.num_there(there))
    cells = [
        {"value": float(value), **interval_record(Interval.of(ends, k))} for k, value in enumerate(parts[0].tolist())
    ]
    found, num = [], len(curve.selectors)
    for place, size in enumerate(curve.sizes):
        own = cells[2 * num * place : 2 * num * (place + 1)]
        for k, selector in enumerate(curve.selectors):
            found.append({"size": size, "selector": selector, "regret": own[k], "less_reference": own[num + k]})
    return found
