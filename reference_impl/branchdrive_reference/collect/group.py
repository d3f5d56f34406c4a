"""One branch group: the nominal pass, its branch, and the matched replays of every policy.

Every rollout is executed from tick 0. Rollouts that an interrupted run has finished are reused,
also the nominal one with its branch and its commands. Source: paper, "Two-Pass Collection".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from branchdrive.collector.report import GroupReport
from branchdrive.collector.review import review_nominal
from branchdrive.collector.trigger import branch_columns
from branchdrive.contract.descriptor import Descriptor
from branchdrive.raw.rollout import Rollout
from branchdrive.writer.group_writer import GroupWriter
from branchdrive_reference.collect.effect import execute_attempt, protocol_variant, record_attempt
from branchdrive_reference.collect.plan import PlannedGroup
from branchdrive_reference.collect.script import Attempt, group_script
from branchdrive_reference.simulation.branch_kind import BranchKind
from branchdrive_reference.simulation.placement import place_branch
from branchdrive_reference.simulation.rollout import Run
from branchdrive_reference.version import COLLECTOR_NAME, COLLECTOR_VERSION, SIMULATOR_NAME, SIMULATOR_VERSION

__all__ = ["execute_group"]


@dataclass
class _Collection:
    writer: GroupWriter
    descriptor: Descriptor
    plan: PlannedGroup
    report: GroupReport = field(init=False)

    def __post_init__(self) -> None:
        self.report = GroupReport(self.plan.group_id)

    def nominal(self, attempt: Attempt) -> Rollout:
        """A nominal pass, reused or executed, with the branch that its trigger finds."""
        found = self._reuse(attempt)
        if found is not None:
            return found
        executed = execute_attempt(attempt, self.plan.spec, 0.0, None)
        is_complete = executed.ending.partial_reason is None and not attempt.is_failure
        branch = place_branch(executed, self.plan.kind) if is_complete else None
        return self._write(
            attempt, executed, None, lambda rollout_id: {} if branch is None else branch.columns(rollout_id)
        )

    def replay(self, attempt: Attempt, nominal: Rollout) -> None:
        """One matched replay against the nominal rollout."""
        if self._reuse(attempt) is None:
            noise = self.descriptor.collection.replay_noise.strength or 0.0
            executed = execute_attempt(attempt, self.plan.spec, noise, nominal)
            shared = branch_columns(nominal)
            self._write(attempt, executed, nominal, lambda _: {**shared, "nominal_rollout_id": nominal.rollout_id})

    def _reuse(self, attempt: Attempt) -> Rollout | None:
        found = self.writer.find(attempt.role, attempt.policy.key, attempt.number)
        self.report.num_reused += found is not None
        return found

    def _write(
        self, attempt: Attempt, executed: Run, nominal: Rollout | None, link: Callable[[str], dict[str, Any]]
    ) -> Rollout:
        """Write an executed rollout; `link` gives its branch and nominal columns for its rollout id."""
        recorded = record_attempt(attempt, executed, nominal)
        writer = self.writer.begin_rollout(
            role=attempt.role, action_key=attempt.policy.key, protocol_variant=protocol_variant(attempt)
        )
        recorded.append_to(writer)
        self.report.num_simulated += 1
        self.report.num_ticks += executed.log.num_ticks
        return writer.finish(
            **recorded.fields,
            **link(writer.rollout_id),
            repetition=self.plan.repetition,
            simulator_version=f"{SIMULATOR_NAME} {SIMULATOR_VERSION}",
            collector_version=f"{COLLECTOR_NAME} {COLLECTOR_VERSION}",
            provenance=self._provenance(attempt),
        )

    def _provenance(self, attempt: Attempt) -> str:
        place = f"{attempt.role} of planned group {self.plan.index}"
        origin = f"{place}, collection seed {self.descriptor.collection.seed}, executed from tick 0"
        faults = " and ".join(attempt.faults)
        return f"{origin}, with the injected fault {faults}" if faults else origin


_UNFOUND = {
    BranchKind.ONSET: "the trigger found no manoeuvre of the expert",
    BranchKind.EARLY: "the trigger found no manoeuvre of the expert with a whole history before it",
    BranchKind.QUIET: "the trigger found no quiet stretch of the expert's drive with somebody near",
}


def execute_group(
    writer: GroupWriter, descriptor: Descriptor, plan: PlannedGroup, *, between: Callable[[], None] = lambda: None
) -> GroupReport:
    """Execute what is missing of a group.

    Args:
        writer: Open writer of the group.
        descriptor: The dataset's descriptor.
        plan: The group.
        between: Called before every rollout; an exception from it leaves the group open.
    """
    collection = _Collection(writer, descriptor, plan)
    script = group_script(descriptor, plan.index)
    nominals: list[Rollout] = []
    for attempt in script.nominal:
        between()
        nominals.append(collection.nominal(attempt))
    nominal = next((made for made in nominals if made.record["status"] == "complete"), nominals[-1])
    town_map = writer.town_map(nominal.record["town"])
    if not review_nominal(nominal, descriptor, collection.report, unfound=_UNFOUND[plan.kind], town_map=town_map):
        return collection.report
    collection.report.stopped_because = script.stopped_because
    for attempt in script.replays:
        between()
        collection.replay(attempt, nominal)
    return collection.report
