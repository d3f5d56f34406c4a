"""Worlds that pilots are tried on: those of the documentation, of others, and one of a timing of its own."""

from __future__ import annotations

import io
import runpy
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from tests.validator.collector.straight import EXAMPLE, ShortRoad
from tests.validator.pilot import bicycle
from tests.validator.pilot.mistakes import Planted

import branchdrive as bd
from branchdrive.cli.main import run

__all__ = ["WORLDS", "Source", "collect"]

Maker = Callable[[], bd.World]


@dataclass(frozen=True)
class Source:
    """A collector: what it makes, and what is to be known of it.

    Attributes:
        load: Makers of worlds by scenario type, what describes the dataset, and options of the collection.
        num_groups: Groups of a pilot.
        seed: Of the collection.
        needs: Module that it takes, empty for none.
        unshown: Mistakes that cannot show in this world, each with the reason.
        problems: Sections in which the right collector may have one.
    """

    load: Callable[[], tuple[Mapping[str, Maker], Callable[[int], bd.Descriptor], Mapping[str, Any]]]
    num_groups: int
    seed: int = 1
    needs: str = ""
    unshown: Mapping[str, str] = field(default_factory=dict)
    problems: frozenset[str] = frozenset({"routes"})


def _minimal() -> Any:
    return EXAMPLE["WORLDS"], EXAMPLE["describe"], {}


def _short() -> Any:
    return {"ParkedObstacle": ShortRoad}, EXAMPLE["describe"], {}


def _template() -> Any:
    with tempfile.TemporaryDirectory() as folder:
        assert run(["init", "made", "--output", f"{folder}/made"], io.StringIO(), io.StringIO()) == 0
        module = runpy.run_path(f"{folder}/made/made/collector.py")
    return module["WORLDS"], module["describe"], {}


def _bicycle() -> Any:
    return {"Crossing": bicycle.LaggingBicycle}, bicycle.describe, {}


def _noisy() -> Any:
    return {"Crossing": bicycle.NoisyBicycle}, partial(bicycle.describe, noise="natural"), {}


def _example(name: str, *scenarios: str) -> Any:
    module = import_module(f"examples.{name}.collector")
    worlds = {scenario: module.WORLDS[scenario] for scenario in scenarios or module.WORLDS}
    return worlds, module.describe, module.options()


_PARKED = "the only other vehicle is parked"

WORLDS = {
    "minimal": Source(_minimal, 2, unshown={"ActorsInKmh": _PARKED}),
    "template": Source(_template, 2, unshown={"ActorsInKmh": _PARKED}),
    "short": Source(_short, 2, unshown={"ActorsInKmh": _PARKED}),
    "bicycle": Source(_bicycle, 3),
    "noisy": Source(  # a cyclist comes into range at another observation
        _noisy, 3, unshown={"KeptState": "replays differ by declaration"}, problems=frozenset({"routes", "replay"})
    ),
    "commonroad": Source(partial(_example, "commonroad_models"), 2, needs="vehiclemodels"),
    "highway": Source(
        partial(_example, "highway_env", "HighwayMerge"), 2, needs="highway_env",
        unshown={"RearAxle": "it turns at speeds alone at which an axle may slip"},
    ),
}  # fmt: skip


def collect(root: Path, source: Source, mistake: type[Planted] | None = None) -> Path:
    """Collect a pilot, with a mistake planted or none, and return its folder."""
    worlds, describe, options = source.load()
    maps: Mapping[str, Sequence[Mapping[str, Any]]] = options.get("maps", {})
    if mistake is not None:
        worlds = {name: partial(mistake, make) for name, make in worlds.items()}
        maps = {town: [mistake.element(element) for element in elements] for town, elements in maps.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of simulators
        bd.collect_dataset(
            root, describe(source.seed), worlds, num_groups=source.num_groups,
            **{"num_replays": 1, **options, "maps": maps},
        )  # fmt: skip
    return root
