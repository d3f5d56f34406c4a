"""Ranking the bank from six cameras: with the steps of earlier observations kept, and from all images of the window.

Both take JPEG images of 160 x 90 pixels and one history in physical units, decode, encode and rank, on one thread. The
models have the size of M5 and weights as they are drawn: how well they choose has no part in it.
"""

from __future__ import annotations

import io
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.ranking import made_release
from benchmarks.row import Row
from branchdrive.benchmark.protocol.protocol import visual_protocol
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, fit_scale
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.runtime.environment import extra
from branchdrive_reference.benchmark.camera_latency import (
    CameraContext,
    exported_camera_selector,
    plain_camera_selector,
)
from branchdrive_reference.benchmark.latency import latencies_ms
from branchdrive_reference.benchmark.onnx_export import contexts_of, export_selector
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.learning.checkpoint import Checkpoint, Curve, environment
from branchdrive_reference.learning.network import build_network, initialise
from branchdrive_reference.learning.provenance import provenance
from branchdrive_reference.learning.ranker import VIEW_CAMERAS, CameraRanker

__all__ = ["rows"]

_MODEL, _PROFILE = "M5", PROFILES["balanced"]
_SIZE, _QUALITY, _SEED = (160, 90), 90, 7
_REPEATS = 200


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
    images, (state, controls) = _observations(HISTORY_OBSERVATIONS), contexts_of(layer, "train", 1)[0]
    contexts = [
        CameraContext(state, controls, [*images[place:], *images[:place]]) for place in range(HISTORY_OBSERVATIONS)
    ]
    ranker = CameraRanker(checkpoints, layer, scale=scale, profile=_PROFILE)

    def one_more(state: Any, controls: Any, window: Sequence[Sequence[bytes]]) -> NDArray[np.float64]:
        ranker.observe(dict(zip(VIEW_CAMERAS, window[-1], strict=True)))
        return ranker(state, controls).scalars

    content = export_selector(checkpoints, layer, scale=scale, profiles=PROFILES)
    new = [exported_camera_selector(content, checkpoints, layer), one_more]
    new_ms, torch_ms = latencies_ms(new, contexts, scale, _PROFILE, repeats=repeats)
    whole, few = plain_camera_selector(checkpoints, layer), max(repeats // HISTORY_OBSERVATIONS, 1)
    (all_ms,) = latencies_ms([whole], contexts, scale, _PROFILE, repeats=few)
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
    num_images = HISTORY_OBSERVATIONS * len(VIEW_CAMERAS)
    yield Row(
        f"{what}\nall {num_images} images of the window, torch", f"{theirs:.1f} ms, {theirs / ours:.1f}x the selector's"
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


def _observations(count: int) -> list[list[bytes]]:
    """Smooth pictures of noise, of all cameras."""
    with extra("media", of="the benchmark of cameras"):
        from PIL import Image
    rng = np.random.default_rng(_SEED)

    def picture() -> bytes:
        stream = io.BytesIO()
        coarse = Image.fromarray(rng.integers(0, 256, (18, 32, 3), np.uint8))
        coarse.resize(_SIZE).save(stream, "JPEG", quality=_QUALITY)
        return stream.getvalue()

    return [[picture() for _ in VIEW_CAMERAS] for _ in range(count)]
