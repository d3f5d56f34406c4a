"""Worlds of the collector SDK as a field of sites: whatever `collect_dataset` collects can be driven.

A module names them: its attribute is a `WorldCollector`, or a mapping from scenario types to what makes their worlds,
with `options()` of that module as further arguments, as collectors have them.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from branchdrive.collector.collection import plan_groups
from branchdrive.collector.drive import RECOVERY_TICKS, Drive, drive
from branchdrive.collector.drive import Passage as DrivenPassage
from branchdrive.collector.group import GroupPlan, WorldCollector
from branchdrive.collector.record import record
from branchdrive.collector.recording import Record
from branchdrive.collector.town import Element
from branchdrive.collector.world import WorldError
from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.descriptor import Software
from branchdrive.contract.policy import Command
from branchdrive.driving.route_cluster import resample_polyline
from branchdrive.errors import UsageError
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.closed_loop.site import Nominal, Place, Route

__all__ = ["WorldField"]


@dataclass(frozen=True)
class WorldField:
    """Groups as `collect_dataset` plans them.

    Attributes:
        name: ``MODULE:NAME`` of the worlds; every process imports them.
        software: The simulator, as the release has it.
        has_evidence: Whether worlds are asked for actors and evidence.
    """

    name: str
    software: Software
    has_evidence: bool
    has_replay_noise = False

    @classmethod
    def of(cls, name: str, release: Release) -> WorldField:
        """The worlds that a release was collected in.

        Raises:
            UsageError: There are none of that name.
        """
        descriptor = release.layer.descriptor
        made = cls(name, descriptor.simulator, "evidence" in descriptor.tables)
        _ = made.collector
        return made

    @cached_property
    def collector(self) -> WorldCollector:
        """What makes the worlds of this process.

        Raises:
            UsageError: There is none of that name.
        """
        module_name, _, attribute = self.name.partition(":")
        try:
            module = importlib.import_module(module_name)
            found = getattr(module, attribute)
        except (ImportError, AttributeError, ValueError) as error:
            raise UsageError(
                f"--world: {self.name!r} is no MODULE:NAME that can be imported: {error}; Python does not look "
                "in the current folder here, but it does in folders of the variable PYTHONPATH"
            ) from error
        if isinstance(found, WorldCollector):
            return found
        if not isinstance(found, Mapping) or not found:
            raise UsageError(f"--world: {self.name!r} is no WorldCollector and no mapping of worlds by scenario type")
        options: Mapping[str, Any] = module.options() if hasattr(module, "options") else {}
        return WorldCollector(found, **options)

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("name", "software", "has_evidence")}

    @property
    def maps(self) -> Mapping[str, Sequence[Element]]:
        """See `Field`."""
        return self.collector.maps

    def record(self, run: Drive) -> Record:
        """The recorded columns of a rollout in one of its worlds."""
        return record(run, has_evidence=self.has_evidence, town=self.maps.get(run.scene.town))

    def _plan(self, seed: int, index: int) -> GroupPlan:
        return plan_groups(seed, index + 1, tuple(self.collector.makers))[index]

    def place(self, seed: int, index: int) -> tuple[Place, Route]:
        """See `Field`; the world is reset for it, once."""
        plan = self._plan(seed, index)
        scene = self.collector.world(plan.scenario_type).reset(plan.seed)
        place = Place(index, plan.group_id, plan.scenario_type, scene.town, scene.route_id, plan.seed)
        return place, Route(scene.town, resample_polyline(scene.route_x_m, scene.route_y_m))

    def routes_of(self, release: Release, groups: Sequence[str]) -> list[Route]:
        """See `Field`; the raw layer has the polylines."""
        if not release.has_raw:
            raise UsageError(
                f"{release.root}: is here without its raw layer, which has its routes; drive the release in place"
            )
        wanted, found = set(groups), dict[bytes, Route]()
        for table in open_dataset(release.root).table(ROLLOUTS):
            for row in table.select(["group_id", "town", "route_x_m", "route_y_m"]).to_pylist():
                if row["group_id"] in wanted:
                    line = resample_polyline(row["route_x_m"], row["route_y_m"])
                    found[row["town"].encode() + line.tobytes()] = Route(row["town"], line)
        return [found[key] for key in sorted(found)]

    def site(self, seed: int, index: int) -> WorldSite:
        """See `Field`."""
        return WorldSite(self, self._plan(seed, index))


@dataclass(frozen=True)
class WorldSite:
    """One planned group of a world."""

    field: WorldField
    plan: GroupPlan

    @property
    def group_id(self) -> str:
        """See `Site`."""
        return self.plan.group_id

    @property
    def scenario_type(self) -> str:
        """See `Site`."""
        return self.plan.scenario_type

    def nominal(self) -> Nominal | str:
        """See `Site`."""
        collector = self.field.collector
        world, bank = collector.world(self.plan.scenario_type), load_action_bank()
        try:
            run = drive(world, self.plan.seed, bank.nominal, max_ticks=collector.max_ticks)
        except WorldError as error:
            return f"the nominal pass is not complete: {error}"
        if run.partial_because:
            return f"the nominal pass is not complete: {run.partial_because}"
        branch = collector.trigger.evaluate(run.trace)
        if branch is None:
            return "the nominal pass has no branch"
        return Nominal(branch, self.field.record(run))

    def begin(self, nominal: Nominal, *, replay_noise: float, num_decisions: int) -> WorldPassage:  # noqa: ARG002
        """See `Site`; `has_replay_noise` says that worlds have none."""
        return WorldPassage(self, nominal, num_decisions)


class WorldPassage:
    """A passage of a world; it ends as recorded candidates do, or where the simulator fails."""

    def __init__(self, site: WorldSite, nominal: Nominal, num_decisions: int) -> None:
        field, plan = site.field, site.plan
        collector = field.collector
        world = collector.world(plan.scenario_type)
        run = Drive(world.reset(plan.seed), load_action_bank().nominal, nominal.branch_tick, nominal.applied)
        self._passage = DrivenPassage(
            world, run, max_ticks=collector.max_ticks, recovery_ticks=num_decisions * RECOVERY_TICKS
        )
        self._field, self._has_failed = field, False

    @property
    def tick(self) -> int:
        """See `Passage`."""
        return self._passage.tick

    def think(self) -> Command | None:
        """See `Passage`."""
        if self._has_failed:
            return None
        try:
            return self._passage.think()
        except WorldError as error:
            self._fail(error)
            return None

    def act(self, command: Command) -> None:
        """See `Passage`."""
        try:
            self._passage.act(command)
        except WorldError as error:
            self._fail(error)

    def _fail(self, error: WorldError) -> None:
        self._passage.fail(error)
        self._has_failed = True

    def record(self) -> Record:
        """See `Passage`."""
        return self._field.record(self._passage.run)
