"""Ranking the bank from six cameras: with the steps of earlier observations kept, and from all images of the window.

Both take JPEG images of 160 x 90 pixels and one history in physical units, decode, encode and rank, on one thread. The
models have the size of M5 and weights as they are drawn: how well they choose has no part in it.
"""

from __future__ import annotations

import io
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.ranking import made_release
from benchmarks.row import Row
from branchdrive.benchmark.protocol import visual_protocol
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, Scale, fit_scale, utility
from branchdrive.environment import extra
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive_reference.benchmark.onnx_export import (
    CAMERA_INPUTS,
    INPUTS,
    OUTPUT,
    STEPS,
    contexts_of,
    export_selector,
    open_selector,
)
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.learning.checkpoint import Checkpoint, Curve, environment
from branchdrive_reference.learning.image_encoder import open_encoder
from branchdrive_reference.learning.network import build_network, initialise
from branchdrive_reference.learning.provenance import provenance
from branchdrive_reference.learning.ranker import VIEW_CAMERAS, CameraNetwork, CameraRanker

__all__ = ["rows"]

_MODEL, _PROFILE = "M5", PROFILES["balanced"]
_SIZE, _QUALITY, _SEED = (160, 90), 90, 7
_REPEATS = 200

Rank = Callable[[int], Any]


def rows(folder: Path, *, release: Path | None = None, repeats: int = _REPEATS) -> Iterator[Row]:
    """Latency of each way on a release.

    Args:
        folder: An empty folder.
        release: A release; None makes a small one below `folder`.
        repeats: Observations that are timed.
    """
    layer = open_model(made_release(folder / "release") if release is None else release)
    checkpoints, training = drawn_models(layer, _MODEL), layer.targets("train")
    scale = fit_scale(Targets(training.scalars, training.scalars_available))
    observations, history = _observations(HISTORY_OBSERVATIONS), contexts_of(layer, "train", 1)[0]
    ranker = CameraRanker(checkpoints, layer, scale=scale, profile=_PROFILE)
    content = export_selector(checkpoints, layer, scale=scale, profiles=PROFILES)
    exported = _exported(content, ranker.network, observations, history, scale)

    def one_more(place: int) -> Any:
        ranker.observe(observations[place])
        return ranker(*history)

    def from_all(place: int) -> Any:
        ranker.reset()
        for step in range(HISTORY_OBSERVATIONS):
            ranker.observe(observations[(place + step) % HISTORY_OBSERVATIONS])
        return ranker(*history)

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        new_ms, torch_ms = _milliseconds(exported, repeats), _milliseconds(one_more, repeats)
        all_ms = _milliseconds(from_all, max(repeats // HISTORY_OBSERVATIONS, 1))
    finally:
        torch.set_num_threads(threads)
    what = (
        f"rank {len(layer.actions())} candidates from six cameras and a history, {len(checkpoints)} seeds of {_MODEL}"
    )
    ours = statistics.median(new_ms)
    yield Row(
        f"{what}\na new observation, exported selector, one thread",
        f"{ours:.2f} ms, 95 % within {np.quantile(new_ms, 0.95):.2f} ms", "<= 10 ms",
    )  # fmt: skip
    yield Row(f"{what}\na new observation, torch", f"{statistics.median(torch_ms):.2f} ms")
    theirs = statistics.median(all_ms)
    images = HISTORY_OBSERVATIONS * len(VIEW_CAMERAS)
    yield Row(
        f"{what}\nall {images} images of the window, torch", f"{theirs:.1f} ms, {theirs / ours:.1f}x the selector's"
    )


def drawn_models(layer: ModelLayer, name: str) -> list[Checkpoint]:
    """Seeds of a model of the protocol with their first weights."""
    found = []
    for task in model_tasks(visual_protocol(), [name]):
        num_features = layer.actions().shape[1]
        network = build_network(task.configuration.model, num_features)
        initialise(network, seed=task.seed)
        origin = provenance(layer, task.configuration, task.seed, {})
        about = environment(torch.device("cpu"))
        weights = network.state_dict()
        found.append(Checkpoint(origin, task.configuration, num_features, about, Curve(), weights, sha256=""))
    return found


def _observations(count: int) -> list[dict[str, bytes]]:
    """Smooth pictures of noise by camera."""
    with extra("media", of="the benchmark of cameras"):
        from PIL import Image
    rng, found = np.random.default_rng(_SEED), []
    for _ in range(count):
        images = {}
        for camera in VIEW_CAMERAS:
            stream = io.BytesIO()
            coarse = Image.fromarray(rng.integers(0, 256, (18, 32, 3), np.uint8))
            coarse.resize(_SIZE).save(stream, "JPEG", quality=_QUALITY)
            images[camera] = stream.getvalue()
        found.append(images)
    return found


def _exported(
    content: bytes, network: CameraNetwork, observations: Sequence[dict[str, bytes]], history: Any, scale: Scale
) -> Rank:
    session, encoder, there = open_selector(content), open_encoder(network.encoding), np.ones(len(VIEW_CAMERAS), bool)
    kept = np.repeat(network.blank_step()[:, None].numpy(), HISTORY_OBSERVATIONS - 1, axis=1)
    given = dict(zip(INPUTS, history, strict=True))

    def rank(place: int) -> Any:
        nonlocal kept
        views = encoder.encode([observations[place][camera] for camera in VIEW_CAMERAS])
        inputs = dict(zip(CAMERA_INPUTS, (views, there, kept), strict=True))
        scalars, kept = session.run([OUTPUT, STEPS], inputs | given)
        values = utility(Targets(scalars.astype(np.float64), np.ones(scalars.shape, np.bool_)), scale, _PROFILE)
        return np.argsort(-values, kind="stable")

    return rank


def _milliseconds(rank: Rank, repeats: int) -> list[float]:
    """Of every repeat; a tenth of the repeats before them is not counted."""
    taken = []
    for repeat in range(-(repeats // 10), repeats):
        begin = time.perf_counter()
        rank(repeat % HISTORY_OBSERVATIONS)
        if repeat >= 0:
            taken.append(1e3 * (time.perf_counter() - begin))
    return taken
