"""The world of the minimal collector, shortened; other worlds of the tests are variants of it."""

from __future__ import annotations

import runpy
from dataclasses import replace
from typing import Any

from tests.repo.checkout import ROOT

import branchdrive as bd

EXAMPLE: dict[str, Any] = runpy.run_path(str(ROOT / "docs/examples/minimal_collector.py"))
StraightRoad: Any = EXAMPLE["StraightRoad"]


class ShortRoad(StraightRoad):  # type: ignore[misc]
    """A parked car in the way after five seconds."""

    parked_m = 46.0

    def reset(self, seed: int) -> bd.Scene:
        scene: bd.Scene = super().reset(seed)
        self.speed_mps, self.parked = 7.5 + 0.05 * (seed % 7), replace(self.parked, x_m=self.parked_m + seed % 5)
        return replace(scene, route_x_m=[0.0, 80.0])


class EmptyRoad(ShortRoad):
    """Nothing to react to: the parked car stands behind the ego."""

    parked_m = -40.0


class BrittleRoad(ShortRoad):
    """Fails at tick 100 of its second and third rollout, and of every one from the sixth on."""

    num_rollouts = 0
    failing = (2, 3, *range(6, 100))

    def reset(self, seed: int) -> bd.Scene:
        self.num_rollouts, self.tick = self.num_rollouts + 1, 0
        return super().reset(seed)

    def step(self, command: bd.Command) -> None:
        if self.tick == 100 and self.num_rollouts in self.failing:
            raise bd.WorldError("the server is gone")
        self.tick += 1
        super().step(command)


def descriptor(**fields: Any) -> bd.Descriptor:
    return bd.describe("test", seed=3, simulator=("straight-road", "1"), collector=("test", "1"), **fields)


NUM_FEW = 3


def few_policies(**fields: Any) -> bd.Descriptor:
    """The same with the nominal policy and `NUM_FEW` interventions, for tests of what is done with any policy."""
    described = descriptor(**fields)
    bank = bd.ActionBank(name="few", policies=described.action_bank.policies[: 1 + NUM_FEW])
    return described.model_copy(update={"action_bank": bank, "action_encoding": None})
