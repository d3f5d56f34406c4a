"""The valid datasets that the fuzz damages: a small raw layer, drives, a release, and a dataset of all layers.

Most cases damage the small ones, which take a fraction of the time.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.release.builder import build_release
from branchdrive.release.stage import BuildOptions
from branchdrive.testing.dataset import SmallDataset
from branchdrive.testing.drive import CAR_M, CONE_M, PERSON_M, InventedActor, InventedScene, Route

__all__ = ["WEIGHTS", "write_base", "write_bases"]

WEIGHTS = {"raw": 24, "drives": 3, "release": 7, "benchmark": 1}
"""Share of the cases that damages each dataset."""

_NUM_GROUPS = 7
"""Groups of the release; with fewer, no split gives every partition enough."""

_SPLIT_SEED = 3


def _dataset(num_groups: int) -> SmallDataset:
    """Groups of a bank of two interventions among three actors, with media and maps."""
    known = load_action_bank()
    chosen = [policy for policy in known.interventions if policy.key in ("brake_0.50", "steer_left_0.10")]
    return SmallDataset(
        tuple(_scene(index) for index in range(num_groups)),
        ActionBank(name="fuzz", policies=(known.nominal, *chosen)),
        num_ticks=151,
        groups_per_shard=4,
        streams=("actor_risk_evidence", "rgb_surround", "map"),
    )


def _scene(index: int) -> InventedScene:
    return InventedScene(
        Route((300.0 * index, 40.0 * index), 0.1 * index),
        (
            InventedActor("vehicle", CAR_M, 32.0, 0.0, speed_mps=5.0),
            InventedActor("pedestrian", PERSON_M, 75.0, -7.0, lateral_mps=0.75),
            InventedActor("static", CONE_M, 60.0, 4.0),
        ),
        town="Town01",
        start=(2.0, 0.4, 5.0 + 0.1 * index),
        noise=0.002,
    )


def write_bases(folder: Path) -> dict[str, Path]:
    """Write the datasets into `folder`, those that are not there yet; their roots by name."""
    folder.mkdir(parents=True, exist_ok=True)
    roots = {name: folder / name for name in WEIGHTS}
    for name, root in roots.items():
        if not root.exists():
            shutil.rmtree(aside := folder / f"{name}.unfinished", ignore_errors=True)
            write_base(name, aside)
            aside.rename(root)
    return roots


def write_base(name: str, root: Path) -> None:
    """Write one of the datasets into the new folder `root`."""
    if name in ("drives", "benchmark"):
        # Layers come from the builder, and predictions from the tests of the benchmark.
        from tests.validator.engine.rules.case import new_draft

        new_draft(name).write(root)
        return
    _dataset(1 if name == "raw" else _NUM_GROUPS).write(root)
    if name == "release":
        build_release(root, options=BuildOptions(seed=_SPLIT_SEED), stages=("canonical", "quality", "model"))
