"""Ranking the bank of one context: the exported selector beside the same models in plain torch, on one thread.

Both take a context in physical units and give the order of the candidates under a profile; both run in turn on the
same contexts. The models have the size of M3 and one epoch of training: how well they choose has no part in it.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.row import Row
from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, fit_scale
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.release.builder import build_release
from branchdrive_reference.benchmark.latency import exported_selector, latencies_ms, plain_selector
from branchdrive_reference.benchmark.onnx_export import TOLERANCE, contexts_of, export_selector, largest_difference
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.collect.campaign import collect
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.training import train_model

__all__ = ["made_release", "rows"]

_MODEL, _PROFILE = "M3", PROFILES["balanced"]
_SEED, _NUM_GROUPS, _REPEATS = 7, 24, 500


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
    plain, contexts = plain_selector(checkpoints, layer), contexts_of(layer, "train")
    ours_ms, theirs_ms = latencies_ms((exported_selector(content), plain), contexts, scale, _PROFILE, repeats=repeats)
    what = f"rank {len(layer.actions())} candidates of one context, {len(checkpoints)} seeds of {_MODEL}, one thread"
    ours, theirs = statistics.median(ours_ms), statistics.median(theirs_ms)
    yield Row(
        f"{what}\nexported selector", f"{ours:.2f} ms, 95 % within {np.quantile(ours_ms, 0.95):.2f} ms", "<= 2.5 ms"
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
