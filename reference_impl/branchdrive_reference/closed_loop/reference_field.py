"""The reference world as a field of sites."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from branchdrive.collector.recording import Record
from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.descriptor import Descriptor, Software
from branchdrive.driving.route_cluster import resample_polyline
from branchdrive.errors import UsageError
from branchdrive.formats.table_file import read_layer_table
from branchdrive.tables.arrow import from_arrow
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.closed_loop.site import Nominal, Place, Route
from branchdrive_reference.collect.campaign import town_maps
from branchdrive_reference.collect.plan import PlannedGroup, plan_group
from branchdrive_reference.simulation import rollout
from branchdrive_reference.simulation.ending import RECOVERY_TICKS
from branchdrive_reference.simulation.placement import place_branch
from branchdrive_reference.simulation.record import record
from branchdrive_reference.town.elements import Element
from branchdrive_reference.town.route import town_routes
from branchdrive_reference.town.town import town
from branchdrive_reference.version import SIMULATOR_NAME, simulator_version

__all__ = ["ReferenceField"]

_REPLAY = 1
"""Number of the replay whose noise all passages of a site share."""


@dataclass(frozen=True)
class ReferenceField:
    """Groups as `branchdrive collect` plans them.

    Attributes:
        scenario_types: Scenario types that take turns; all if there is none.
        branches: Shares of groups by the kind of branch that is asked for.
    """

    scenario_types: tuple[str, ...]
    branches: Mapping[str, float]
    has_replay_noise = True

    @classmethod
    def of(cls, descriptor: Descriptor) -> ReferenceField:
        """The field that a dataset was collected in.

        Raises:
            UsageError: It is from another simulator.
        """
        if descriptor.simulator.name != SIMULATOR_NAME:
            raise UsageError(
                f"the release is from the simulator {descriptor.simulator.name!r}; name its worlds with "
                "`--world MODULE:NAME`"
            )
        collection = descriptor.collection
        return cls(tuple(collection.scenario_types), dict(collection.branches))

    @property
    def software(self) -> Software:
        """See `Field`."""
        return Software(name=SIMULATOR_NAME, version=simulator_version())

    @property
    def maps(self) -> Mapping[str, Sequence[Element]]:
        """See `Field`."""
        return town_maps()

    def _plan(self, seed: int, index: int) -> PlannedGroup:
        return plan_group(seed, index, self.scenario_types, self.branches)

    def place(self, seed: int, index: int) -> tuple[Place, Route]:
        """See `Field`."""
        plan = self._plan(seed, index)
        spec = plan.spec
        place = Place(index, plan.group_id, spec.scenario_type, spec.town, spec.route_id, spec.seed)
        return place, _route(spec.town, spec.route_id)

    def routes_of(self, release: Release, groups: Sequence[str]) -> list[Route]:
        """See `Field`; a town has its routes by their ids."""
        rows = from_arrow(read_layer_table(release.layer.folder, "records"), "records")
        wanted, columns = set(groups), (rows[name].tolist() for name in ("group_id", "town", "route_id"))
        found = {(name, route_id) for group, name, route_id in zip(*columns, strict=True) if group in wanted}
        try:
            return [_route(*one) for one in sorted(found)]
        except KeyError as error:
            raise UsageError(f"the reference world has no route {error}; the release is of another version") from error

    def site(self, seed: int, index: int) -> ReferenceSite:
        """See `Field`."""
        return ReferenceSite(self._plan(seed, index))


def _route(town_name: str, route_id: str) -> Route:
    line = town_routes(town(town_name))[route_id].polyline
    return Route(town_name, resample_polyline(line.x_m, line.y_m))


@dataclass(frozen=True)
class ReferenceSite:
    """One planned group of the reference world."""

    plan: PlannedGroup

    @property
    def group_id(self) -> str:
        """See `Site`."""
        return self.plan.group_id

    @property
    def scenario_type(self) -> str:
        """See `Site`."""
        return self.plan.spec.scenario_type

    def nominal(self) -> Nominal | str:
        """See `Site`."""
        executed = rollout.run(self.plan.spec, load_action_bank().nominal)
        if executed.ending.partial_reason is not None:
            return f"the nominal pass is not complete: {executed.ending.termination}"
        branch = place_branch(executed, self.plan.kind)
        return "the nominal pass has no branch" if branch is None else Nominal(branch, record(executed))

    def begin(self, nominal: Nominal, *, replay_noise: float, num_decisions: int) -> ReferencePassage:
        """See `Site`."""
        return ReferencePassage(self.plan, nominal, replay_noise, num_decisions)


class ReferencePassage(rollout.Passage):
    """A passage of the reference world; it ends as recorded candidates do."""

    def __init__(self, plan: PlannedGroup, nominal: Nominal, replay_noise: float, num_decisions: int) -> None:
        spec = replace(plan.spec, replay=_REPLAY, replay_noise=replay_noise) if replay_noise > 0 else plan.spec
        longer = (num_decisions - 1) * RECOVERY_TICKS
        super().__init__(spec, branch_tick=nominal.branch_tick, nominal_ticks=len(nominal.applied) + longer)

    def record(self) -> Record:
        """See `Passage`."""
        return record(self.run(load_action_bank().nominal, None, None))
