"""Ranking the bank of one context: the exported selector beside the same models in plain torch, on one thread.

Both take a context in physical units and give the order of the candidates under a profile; both run in turn on the
same contexts. The models have the size of M3 and one epoch of training: how well they choose has no part in it.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.row import Row
from branchdrive.benchmark.protocol import default_protocol
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, Scale, fit_scale, utility
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.release.builder import build_release
from branchdrive_reference.benchmark.onnx_export import (
    INPUTS,
    OUTPUT,
    TOLERANCE,
    contexts_of,
    export_selector,
    largest_difference,
    open_selector,
)
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.collect.campaign import collect
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.prediction import physical
from branchdrive_reference.learning.training import train_model

__all__ = ["made_release", "rows"]

_MODEL, _PROFILE = "M3", PROFILES["balanced"]
_SEED, _NUM_GROUPS, _REPEATS = 7, 24, 500

Array = NDArray[np.float32]
Predict = Callable[[Array, Array], NDArray[Any]]


def rows(folder: Path, *, release: Path | None = None, repeats: int = _REPEATS) -> Iterator[Row]:
    """Latency of both on a release, and how far their predictions differ.

    Args:
        folder: An empty folder, for the models.
        release: A release; None makes a small one below `folder`.
        repeats: Rankings that are timed.
    """
    layer = open_model(made_release(folder / "release") if release is None else release)
    checkpoints = _checkpoints(layer, folder / "checkpoints")
    training = layer.targets("train")
    scale = fit_scale(Targets(training.scalars, training.scalars_available))
    content = export_selector(checkpoints, layer, scale=scale, profiles=PROFILES)
    plain, contexts = _plain(checkpoints, layer), contexts_of(layer, "train")
    ours_ms, theirs_ms = _latencies((_exported(content), plain), contexts, scale, repeats)
    what = f"rank {len(layer.actions())} candidates of one context, {len(checkpoints)} seeds of {_MODEL}, one thread"
    ours, theirs = statistics.median(ours_ms), statistics.median(theirs_ms)
    yield Row(
        f"{what}\nexported selector", f"{ours:.2f} ms, 95 % within {np.quantile(ours_ms, 0.95):.2f} ms", "<= 2 ms"
    )
    yield Row(f"{what}\nplain torch", f"{theirs:.2f} ms, {theirs / ours:.1f}x the selector's")
    found = largest_difference(content, plain, contexts)
    yield Row("predictions of the selector against plain torch", f"{found:.1e}", f"<= {TOLERANCE:.0e}")


def made_release(root: Path) -> Path:
    """A small release in the new folder `root`."""
    collect(root, num_groups=_NUM_GROUPS, seed=_SEED)
    build_release(root)
    return root


def _checkpoints(layer: ModelLayer, folder: Path) -> list[Checkpoint]:
    return [
        train_model(
            layer,
            folder,
            replace(task.configuration, training=replace(task.configuration.training, max_epochs=1, warmup_epochs=1)),
            seed=task.seed,
        )
        for task in model_tasks(default_protocol(), [_MODEL])
    ]


def _exported(content: bytes) -> Predict:
    session = open_selector(content)

    def predict(state: Array, controls: Array) -> NDArray[Any]:
        (found,) = session.run([OUTPUT], dict(zip(INPUTS, (state, controls), strict=True)))
        return np.asarray(found)

    return predict


def _plain(checkpoints: Sequence[Checkpoint], layer: ModelLayer) -> Predict:
    """The networks as they were trained, one seed after the other."""
    networks, scalings = [checkpoint.network() for checkpoint in checkpoints], layer.scalings()
    actions = torch.from_numpy(layer.actions().astype(np.float32))

    def predict(state: Array, controls: Array) -> NDArray[Any]:
        with torch.inference_mode():
            inputs = {
                "state": torch.from_numpy(scalings.state.apply(state[None]).astype(np.float32)),
                "controls": torch.from_numpy(scalings.controls.apply(controls[None]).astype(np.float32)),
                "actions": actions,
            }
            outcomes = [network(inputs, num_groups=1, num_candidates=len(actions)) for network in networks]
        found: NDArray[np.float64] = np.mean([physical(outcome, scalings)[0][0] for outcome in outcomes], axis=0)
        return found

    return predict


def _latencies(
    ways: Sequence[Predict], contexts: Sequence[tuple[Array, Array]], scale: Scale, repeats: int
) -> list[list[float]]:
    """Milliseconds of every repeat of each way, taken in turn; a tenth of the repeats before them is not counted."""
    found: list[list[float]] = [[] for _ in ways]
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for repeat in range(-repeats // 10, repeats):
            context = contexts[repeat % len(contexts)]
            for way, taken in zip(ways, found, strict=True):
                begin = time.perf_counter()
                scalars = way(*context).astype(np.float64)
                values = utility(Targets(scalars, np.ones(scalars.shape, np.bool_)), scale, _PROFILE)
                np.argsort(-values, kind="stable")
                if repeat >= 0:
                    taken.append(1e3 * (time.perf_counter() - begin))
    finally:
        torch.set_num_threads(threads)
    return found
