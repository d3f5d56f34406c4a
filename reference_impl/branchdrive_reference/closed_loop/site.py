"""What a closed loop asks of a simulator: places of a fresh population, each driven again and again from tick 0.

A site is one planned group. Its nominal pass finds the branch, where the first decision is made; every further passage
begins at tick 0 in the same state, so that passages of one site differ by their commands and by declared noise alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.recording import Record
from branchdrive.collector.trigger import Branch
from branchdrive.contract.descriptor import Software
from branchdrive.contract.policy import ACTUATORS, Command
from branchdrive_reference.benchmark.release import Release

__all__ = ["Field", "Nominal", "Passage", "Place", "Route", "Site"]


class Route(NamedTuple):
    """A route.

    Attributes:
        town: Name of the map.
        points: Its polyline, resampled by `resample_polyline` ``[points, 2]``.
    """

    town: str
    points: NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """What is known of a planned group before it is driven; the plan names it.

    Attributes:
        index: Place in the population of the plan's seed, from 0.
        group_id: Identity.
        scenario_type: Scenario type.
        town: Name of the map.
        route_id: Identity of the route in the town.
        seed: Seed of the world.
    """

    index: int
    group_id: str
    scenario_type: str
    town: str
    route_id: str
    seed: int


@dataclass(frozen=True, eq=False)
class Nominal:
    """The nominal pass of a site.

    Attributes:
        branch: Where the first decision is made, and why.
        record: What was recorded.
    """

    branch: Branch
    record: Record

    @property
    def branch_tick(self) -> int:
        """Tick of the first decision."""
        return self.branch.branch_tick

    @cached_property
    def applied(self) -> NDArray[np.float32]:
        """Its commands, float32 ``[ticks, 3]``."""
        return np.stack([np.asarray(self.record.controls[f"applied_{name}"]) for name in ACTUATORS], axis=1)


class Passage(Protocol):
    """A drive from tick 0 that goes on tick by tick."""

    @property
    def tick(self) -> int:
        """Ticks that were executed."""

    def think(self) -> Command | None:
        """The expert's command of the present tick, float32; ``None`` where the drive is over."""

    def act(self, command: Command) -> None:
        """Drive the ego with a command for one tick."""

    def record(self) -> Record:
        """What is recorded so far, at a saved observation with that one."""


class Site(Protocol):
    """One planned group that can be driven."""

    @property
    def group_id(self) -> str:
        """Its identity."""

    @property
    def scenario_type(self) -> str:
        """Its scenario type."""

    def nominal(self) -> Nominal | str:
        """The nominal pass; the reason where it is not complete or has no branch."""

    def begin(self, nominal: Nominal, *, replay_noise: float, num_decisions: int) -> Passage:
        """A new passage at tick 0.

        Args:
            nominal: The nominal pass.
            replay_noise: Strength of the noise of replays; equal for all passages of the site.
            num_decisions: Decisions that may be made; each beyond the first adds the recovery time of one.
        """


class Field(Protocol):
    """A world with all its sites; processes hand it to each other, so that it is to be pickled."""

    has_replay_noise: bool
    """Whether its replays can differ."""

    @property
    def software(self) -> Software:
        """The simulator, with the libraries that decide its bits as part of its version."""

    @property
    def maps(self) -> Mapping[str, Sequence[Mapping[str, object]]]:
        """Elements of the maps of its towns, as a writer of datasets takes them."""

    def place(self, seed: int, index: int) -> tuple[Place, Route]:
        """The planned group at a place of the population with a seed, and its route."""

    def routes_of(self, release: Release, groups: Sequence[str]) -> list[Route]:
        """Distinct routes of groups of a release.

        Raises:
            UsageError: The release is not of this world, or does not say where its routes are.
        """

    def site(self, seed: int, index: int) -> Site:
        """The group, ready to be driven."""
