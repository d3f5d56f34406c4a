"""How long a selector takes to rank the bank of one context: networks in plain torch, and the exported selector.

Both take a context in physical units and give the order of the candidates under a profile, with all seeds of a model
and on one thread of the processor; they run in turn on the same contexts. Times are those of the machine at hand and
of what else it does.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (latency of the structured selector);
spec/14-benchmark.md#latency.
"""

from __future__ import annotations

import platform
import re
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from branchdrive.benchmark.latency import timed_models
from branchdrive.benchmark.lock import lock_digest
from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.tables import render_tables
from branchdrive.cli.progress import Update
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import LATENCY_FILE, LOCK_FILE, RESULTS_FILE, TABLES_FILE
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import Profile, Scale, utility
from branchdrive.errors import UsageError
from branchdrive.model.features import recorded_features
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.benchmark.camera_latency import (
    camera_contexts,
    exported_camera_selector,
    plain_camera_selector,
)
from branchdrive_reference.benchmark.document import published_protocol
from branchdrive_reference.benchmark.onnx_export import (
    INPUTS,
    OUTPUT,
    check_equal,
    contexts_of,
    export_selector,
    open_selector,
)
from branchdrive_reference.benchmark.prediction import locked_checkpoints
from branchdrive_reference.benchmark.release import Release, benchmark_data
from branchdrive_reference.benchmark.workspace import Workspace
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.prediction import check_release, physical
from branchdrive_reference.learning.ranker import can_rank, reads_cameras

__all__ = [
    "EXPORT",
    "NUM_THREADS",
    "exported_selector",
    "latencies_ms",
    "latency_document",
    "plain_selector",
    "publish_latency",
]

EXPORT = ("onnx", "onnxscript", "onnxruntime")
"""Packages without which no exported selector is timed."""

NUM_THREADS = 1

NUM_WINDOWS = 8
"""Contexts whose images are in memory while a model that reads cameras is timed."""

Array = NDArray[np.float32]
Predict = Callable[[Array, Array], NDArray[Any]]
"""Targets ``[A, 6]`` in their units from ``state [16, 21]`` and ``controls [80, 3]`` in physical units."""

_CPU_FACTS = Path("/proc/cpuinfo")


def latency_document(release: Release, *, repeats: int, show: Update) -> dict[str, Any]:
    """The document ``latency.json`` of the locked models of a release, measured here and now.

    The exported selector is timed where the packages in `EXPORT` are installed and the model can be exported. Contexts
    are those of training groups, and no outcome is read but for the scale of utility.

    Args:
        release: With a published benchmark.
        repeats: Rankings that are timed of each model and way, at least 1.
        show: Progress over models.

    Raises:
        UsageError: No benchmark is published, or a checkpoint was trained under another split or normalisation.
        DatasetError: The release or a checkpoint cannot be read.
        PlatformError: A package in `EXPORT` is too old or cannot be imported.
        BranchDriveError: An exported selector does not predict what torch does.
    """
    lock = release.document(LOCK_FILE)
    if lock is None:
        raise UsageError(f"{release}: has no locked models; run `branchdrive predict` first")
    protocol, layer = published_protocol(release), release.layer
    scale, profiles = utility_scale(protocol, benchmark_data(release)), protocol.preferences
    contexts, models = contexts_of(layer, "train"), timed_models(protocol)
    is_exporting = all(find_spec(name) for name in EXPORT)
    found = []
    for done, model in enumerate(models):
        show(done, len(models), model.id)
        checkpoints = locked_checkpoints(release, lock, model.id)
        sees = reads_cameras(checkpoints)
        plain = plain_camera_selector if sees else plain_selector
        ways: dict[str, Callable[..., NDArray[Any]]] = {"torch": plain(checkpoints, layer)}
        given: Sequence[tuple[Any, ...]] = camera_contexts(layer, "train", NUM_WINDOWS) if sees else contexts
        if is_exporting and can_rank(checkpoints):
            content = export_selector(checkpoints, layer, scale=scale, profiles=profiles)
            check_equal(content, checkpoints, layer)
            ways["exported"] = (
                exported_camera_selector(content, checkpoints, layer) if sees else exported_selector(content)
            )
        profile = next(iter(profiles.values()))
        times = latencies_ms(list(ways.values()), given, scale, profile, repeats=repeats)
        figures = dict(zip(ways, map(_figures, times), strict=True))
        about = {"model": model.id, "num_seeds": len(checkpoints), **({"reads_cameras": True} if sees else {})}
        found.append({**about, "exported": None, **figures})
    show(len(models), len(models))
    libraries = ("numpy", "torch", *(EXPORT[-1:] if is_exporting else ()))
    return {
        "prediction_lock_digest": lock_digest(lock),
        "machine": {
            "processor": _processor(), "architecture": platform.machine(), "device": "cpu", "num_threads": NUM_THREADS,
        },
        "software": {"python": platform.python_version(), **{name: version(name) for name in libraries}},
        "num_candidates": len(layer.candidate_order),
        "num_repeats": repeats,
        "models": found,
    }  # fmt: skip


def publish_latency(workspace: Workspace, document: dict[str, Any]) -> None:
    """Publish latencies beside what is published, and in the tables where there are some."""
    release = workspace.release
    files = {**release.benchmark_files(), LATENCY_FILE: dump_json(document)}
    if (results := release.document(RESULTS_FILE)) is not None:
        files[TABLES_FILE] = render_tables(results, document).encode()
    workspace.publish(files)


def plain_selector(checkpoints: Sequence[Checkpoint], layer: ModelLayer) -> Predict:
    """The mean over networks as they were trained, one seed after the other.

    Raises:
        UsageError: A checkpoint was trained under another split or normalisation.
        DatasetError: The release cannot be read.
    """
    for checkpoint in checkpoints:
        check_release(checkpoint, layer)
    networks, scalings = [checkpoint.network() for checkpoint in checkpoints], layer.scalings()
    actions, is_recorded = torch.from_numpy(layer.actions()), recorded_features("state", layer.descriptor)

    def predict(state: Array, controls: Array) -> NDArray[Any]:
        known = np.where(is_recorded, scalings.state.apply(state[None]), 0.0)
        with torch.inference_mode():
            inputs = {
                "state": torch.from_numpy(known.astype(np.float32)),
                "controls": torch.from_numpy(scalings.controls.apply(controls[None]).astype(np.float32)),
                "actions": actions,
            }
            outcomes = [network(inputs, num_groups=1, num_candidates=len(actions)) for network in networks]
        found: NDArray[np.float64] = np.mean([physical(outcome, scalings)[0][0] for outcome in outcomes], axis=0)
        return found

    return predict


def exported_selector(content: bytes) -> Predict:
    """An exported selector in ONNX Runtime.

    Raises:
        PlatformError: The extra is not installed.
    """
    session = open_selector(content)

    def predict(state: Array, controls: Array) -> NDArray[Any]:
        (found,) = session.run([OUTPUT], dict(zip(INPUTS, (state, controls), strict=True)))
        return np.asarray(found)

    return predict


def latencies_ms(
    ways: Sequence[Callable[..., NDArray[Any]]],
    contexts: Sequence[tuple[Any, ...]],
    scale: Scale,
    profile: Profile,
    *,
    repeats: int,
) -> list[list[float]]:
    """Milliseconds of every repeat of each way, taken in turn; a tenth of the repeats before them is not counted."""
    found: list[list[float]] = [[] for _ in ways]
    threads = torch.get_num_threads()
    torch.set_num_threads(NUM_THREADS)
    try:
        for repeat in range(-repeats // 10, repeats):
            context = contexts[repeat % len(contexts)]
            for way, taken in zip(ways, found, strict=True):
                begin = time.perf_counter()
                scalars = way(*context).astype(np.float64)
                values = utility(Targets(scalars, np.ones(scalars.shape, np.bool_)), scale, profile)
                np.argsort(-values, kind="stable")
                if repeat >= 0:
                    taken.append(1e3 * (time.perf_counter() - begin))
    finally:
        torch.set_num_threads(threads)
    return found


def _figures(taken_ms: Sequence[float]) -> dict[str, float]:
    median_ms, quantile_ms = np.quantile(taken_ms, [0.5, 0.95])
    return {"median_ms": round(float(median_ms), 4), "quantile_95_ms": round(float(quantile_ms), 4)}


def _processor() -> str | None:
    """What the system calls its processor, ``None`` where it does not say."""
    facts = _CPU_FACTS.read_text("utf-8", "replace") if _CPU_FACTS.is_file() else ""
    named = re.search(r"^model name\s*:\s*(.+)$", facts, re.M)
    name = " ".join(re.findall(r"[!-~]+", named[1] if named else platform.processor()))
    return name[:200] or None
