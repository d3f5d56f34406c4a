"""A release of the preset `benchmark`: collected or given, built stage by stage, validated, its leakage gate checked.

Time and memory are those of processes that do nothing else; validation is compared with reading, hashing and
decoding the same files with as many workers.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import memory, minutes, run_branchdrive, run_module, size
from benchmarks.row import Row
from benchmarks.staged import StageCost
from benchmarks.validation import time_validation
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import LEAKAGE_FILE
from branchdrive.engine.spool import Spool
from branchdrive.errors import BranchDriveError
from branchdrive.formats.folder import Folder
from branchdrive.leakage.inputs import gate_features
from branchdrive.leakage.protocol import GateProtocol
from branchdrive.leakage.replays import replay_inputs
from branchdrive.leakage.text import leakage_sentences
from branchdrive.quality.text import access_sentence, target_sentences
from branchdrive.release.built_layers import BuiltLayers, load_layers
from branchdrive.release.scan import scan_raw
from branchdrive.runtime.executor import isolated
from branchdrive_reference.leakage.uniformity import gate_size, uniformity

__all__ = ["FOLDER", "ReleaseBench", "rows", "validated_rows"]

FOLDER = "dataset"
"""Where the release is made, below the folder that is given."""

_SEED = 11
_TITLES = {"raw": "read, judge and extract the raw layer"}
_BARS = {"leakage": "<= 10 min for 606 groups"}
_SIZE_PROTOCOL = GateProtocol(alpha=0.05, num_permutations=199, offsets_sd=(), num_replicates=1)
"""Of the gate on shuffled rows: fewer permutations than an audit takes, and no minimum detectable effect."""


@dataclass(frozen=True)
class ReleaseBench:
    """What is measured.

    Attributes:
        dataset: Dataset with a raw layer, which is copied; None collects the preset `benchmark`.
        num_groups: Groups to collect instead of the preset's.
        calibration: Least groups and clusters of the calibration partition.
        num_seeds: Seeds of the gate on shuffled rows.
        repeats: Repeats of validation and of what it is compared with.
        jobs: Worker processes of every command.
    """

    dataset: Path | None = None
    num_groups: int | None = None
    calibration: tuple[int, int] = (88, 48)
    num_seeds: int = 100
    repeats: int = 3
    jobs: int = 2


def rows(folder: Path, bench: ReleaseBench) -> Iterator[Row]:
    """Build and validate a release below `folder`.

    Args:
        folder: An empty folder with room for the dataset.
        bench: What is measured.

    Raises:
        BranchDriveError: A command failed, or the release is not valid.
    """
    root = folder / FOLDER
    yield from _collected(root, bench)
    yield from _built(root, bench)
    layers = load_layers(Folder(root))
    yield from _population(layers)
    yield from validated_rows(root, bench)
    yield from _leakage(root, layers, bench)


def _collected(root: Path, bench: ReleaseBench) -> Iterator[Row]:
    if bench.dataset is not None:
        if not bench.dataset.is_dir():
            raise BranchDriveError(f"{str(bench.dataset)!r} is not a folder")
        shutil.copytree(bench.dataset, root, ignore=shutil.ignore_patterns(*LAYERS))
        return
    groups = ("--groups", str(bench.num_groups)) if bench.num_groups else ()
    options = ("--preset", "benchmark", "--seed", str(_SEED), "--jobs", str(bench.jobs), *groups)
    collected = run_branchdrive("collect", str(root), *options)
    if collected.exit_code != 0:
        raise BranchDriveError(f"`branchdrive collect` ended with {collected.exit_code}: {collected.output}")
    yield Row(f"collect preset `benchmark`, seed {_SEED}, {bench.jobs} worker(s)", minutes(collected.wall_s))


def _built(root: Path, bench: ReleaseBench) -> Iterator[Row]:
    least = ",".join(map(str, bench.calibration))
    built = run_module("benchmarks.staged", str(root), least, str(bench.jobs))
    if built.exit_code != 0:
        raise BranchDriveError(f"the build ended with {built.exit_code}")
    for stage in (StageCost(**cost) for cost in json.loads(built.output)):
        title = _TITLES.get(stage.name, f"stage {stage.name}")
        cost = f"{minutes(stage.wall_s)}\n{memory(stage.main_bytes, stage.worker_bytes)}"
        yield Row(f"build: {title}", cost, _BARS.get(stage.name, ""))
    yield Row(
        f"build with `--calibration {least}`, {bench.jobs} worker(s)", minutes(built.wall_s), "<= 80 s for 1,000 groups"
    )


def _population(layers: BuiltLayers) -> Iterator[Row]:
    population = layers.documents["quality/population.json"]
    yield Row("population", "\n".join(_stage(stage, population["partitions"]) for stage in population["stages"]))
    groups = layers.rows("group_quality")
    valid = np.asarray(groups["core_valid"], bool)
    types = len(set(groups["scenario_type"][valid].tolist()))
    yield Row("core-valid groups", f"{valid.sum():,} from {types} scenario types", ">= 606 from 9 types")
    accesses = access_sentence(layers.documents["quality/ledger.json"])
    yield Row("test partition", "\n".join([*target_sentences(layers.documents["quality/retention.json"]), accesses]))


def _stage(stage: Mapping[str, Any], partitions: Sequence[str]) -> str:
    total = f"{stage['title']}: {stage['total']:,}"
    if not stage["groups"]:
        return total
    return f"{total} = " + " + ".join(f"{stage['groups'][name]:,} {name}" for name in partitions)


def validated_rows(root: Path, bench: ReleaseBench, *, what: str = "release", bar: str = "") -> Iterator[Row]:
    """Validate what is in the folder `root`, by the command line and against its floor.

    Raises:
        BranchDriveError: It is not valid.
    """
    validated = run_branchdrive("validate", str(root), "--jobs", str(bench.jobs), "--format", "json")
    if validated.exit_code != 0:
        raise BranchDriveError(f"`branchdrive validate` ended with {validated.exit_code}")
    report = json.loads(validated.output)
    figures = f"{minutes(validated.wall_s)}, {report['verdict']}"
    yield Row(f"validate the {what}, {bench.jobs} worker(s)\n{size(report['dataset'])}", figures, bar)
    yield Row(f"peak memory of the validator, {what}", memory(validated.main_bytes, validated.worker_bytes), "<= 2 GiB")
    timing = time_validation(root, jobs=bench.jobs, repeats=bench.repeats)
    figures = f"{timing.ratio}\nvalidation {timing.validation}\nfloor {timing.floor}"
    yield Row(f"{what}, {bench.jobs} worker(s)\ngross, over read + hash + decode", figures)


def _leakage(root: Path, layers: BuiltLayers, bench: ReleaseBench) -> Iterator[Row]:
    yield Row("leakage audit", "\n".join(leakage_sentences(layers.documents[LEAKAGE_FILE])))
    with Spool.temporary() as spool:
        scan = scan_raw(Folder.at(root), spool, isolated(bench.jobs))
        inputs = replay_inputs(scan.rows["replays"], layers.rows("group_quality"), scan.descriptor)
    gate = gate_size(gate_features(inputs)[0], seeds=range(bench.num_seeds), protocol=_SIZE_PROTOCOL)
    shuffled = f"{inputs.num_groups:,} groups, rows shuffled within groups, {bench.num_seeds:,} seeds"
    for name, p_values in gate.p_values.items():
        found, low = uniformity(p_values), float((p_values <= _SIZE_PROTOCOL.alpha).mean())
        figures = f"D = {found.distance:.3f}, p = {found.p:.2f}; {low:.1%} of p-values at most {_SIZE_PROTOCOL.alpha:g}"
        yield Row(f"gate's p-values of {name} against uniform\n{shuffled}", figures, "p > 0.01")
    yield Row(
        "gate fails on shuffled rows", f"{gate.failed.mean():.1%} of seeds", f"about {_SIZE_PROTOCOL.alpha:.0%} or less"
    )
