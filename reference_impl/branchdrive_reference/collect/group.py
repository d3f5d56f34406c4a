"""One branch group: the nominal pass, its branch, and the matched replays of every policy.

Every rollout is executed from tick 0. Rollouts that an interrupted run has finished are reused,
also the nominal one with its branch and its commands. Source: paper III-B.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.audit.rollout import check_rollout
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.policy import ACTUATORS, Policy
from branchdrive.dataset.group_writer import GroupWriter
from branchdrive.dataset.rollout import Rollout
from branchdrive_reference.collect.plan import GroupPlan
from branchdrive_reference.scenarios.trigger import Branch
from branchdrive_reference.simulation.record import record
from branchdrive_reference.simulation.rollout import Run, find_branch, run
from branchdrive_reference.version import COLLECTOR_NAME, COLLECTOR_VERSION, SIMULATOR_NAME, SIMULATOR_VERSION

__all__ = ["NUM_NOMINAL_REPLAYS", "PROTOCOL_VARIANT", "GroupReport", "collect_group"]

PROTOCOL_VARIANT = "reference-1"
NUM_NOMINAL_REPLAYS = 2

_BRANCH_COLUMNS = (
    "branch_tick", "branch_frame", "trigger_definition", "trigger_rollout_id", "trigger_tick",
    "trigger_signal", "trigger_value", "trigger_threshold", "trigger_confidence",
)  # fmt: skip


@dataclass
class GroupReport:
    """What collecting one group took and gave.

    Attributes:
        group_id: Identity of the group.
        num_simulated: Rollouts that were executed.
        num_reused: Rollouts found finished.
        num_ticks: Ticks that were executed.
        unbranched_because: Why no replay was spent on the group; empty if it was branched.
    """

    group_id: str
    num_simulated: int = 0
    num_reused: int = 0
    num_ticks: int = 0
    unbranched_because: str = ""


@dataclass
class _Collection:
    writer: GroupWriter
    descriptor: Descriptor
    plan: GroupPlan
    report: GroupReport = field(init=False)

    def __post_init__(self) -> None:
        self.report = GroupReport(self.plan.group_id)

    def nominal(self) -> Rollout:
        """The nominal rollout, reused or executed, with the branch that its trigger finds."""
        policy = self.descriptor.action_bank.nominal
        found = self._reuse("nominal", policy.key)
        if found is not None:
            return found
        executed = run(self.plan.spec, policy)
        complete = executed.ending.partial_reason is None
        branch = find_branch(executed) if complete else None
        return self._write("nominal", executed, lambda rollout_id: _branch_fields(branch, rollout_id))

    def replay(self, role: str, policy: Policy, nominal: Rollout, attempt: int = 1) -> None:
        """One matched replay against the nominal rollout."""
        if self._reuse(role, policy.key, attempt) is None:
            executed = run(self.plan.spec, policy, branch_tick=nominal.branch_tick, nominal=_applied(nominal))
            shared = {name: nominal.record[name] for name in _BRANCH_COLUMNS}
            self._write(role, executed, lambda _: {**shared, "nominal_rollout_id": nominal.rollout_id})

    def _reuse(self, role: str, action_key: str, attempt: int = 1) -> Rollout | None:
        found = self.writer.find(role, action_key, attempt)
        self.report.num_reused += found is not None
        return found

    def _write(self, role: str, executed: Run, link: Callable[[str], dict[str, Any]]) -> Rollout:
        """Write an executed rollout; `link` gives its branch and nominal columns for its rollout id."""
        recorded = record(executed)
        writer = self.writer.begin_rollout(role=role, action_key=executed.policy.key, protocol_variant=PROTOCOL_VARIANT)
        writer.append_ticks(**recorded.controls)
        writer.append_observations(**recorded.observations)
        writer.append_actors(**recorded.actors)
        writer.append_evidence(**recorded.evidence)
        self.report.num_simulated += 1
        self.report.num_ticks += executed.log.num_ticks
        return writer.finish(
            **recorded.fields,
            **link(writer.rollout_id),
            repetition=self.plan.repetition,
            simulator_version=f"{SIMULATOR_NAME} {SIMULATOR_VERSION}",
            collector_version=f"{COLLECTOR_NAME} {COLLECTOR_VERSION}",
            provenance=f"{role} of planned group {self.plan.index}, collection seed "
            f"{self.descriptor.collection.seed}, executed from tick 0",
        )


def _branch_fields(branch: Branch | None, rollout_id: str) -> dict[str, Any]:
    if branch is None:
        return {}
    return {
        "branch_tick": branch.branch_tick,
        "branch_frame": branch.branch_frame,
        "trigger_definition": branch.definition,
        "trigger_rollout_id": rollout_id,
        "trigger_tick": branch.tick,
        "trigger_signal": branch.signal,
        "trigger_value": branch.value,
        "trigger_threshold": branch.threshold,
        "trigger_confidence": branch.confidence,
    }


def _applied(nominal: Rollout) -> NDArray[np.float32]:
    """Applied commands of a nominal rollout, float32 ``[ticks, 3]``."""
    return np.stack([nominal.column("controls", f"applied_{actuator}") for actuator in ACTUATORS], axis=1)


def _unbranched_because(nominal: Rollout, descriptor: Descriptor) -> str:
    """Why a nominal rollout is not worth replays; empty if it is."""
    if nominal.record["status"] != "complete":
        return str(nominal.record["status_reason"])
    if nominal.branch_tick is None:
        return "the trigger found no manoeuvre of the expert"
    findings = check_rollout(nominal, descriptor)
    return findings[0].message if findings else ""


def collect_group(
    writer: GroupWriter, descriptor: Descriptor, plan: GroupPlan, *, between: Callable[[], None] = lambda: None
) -> GroupReport:
    """Execute what is missing of a group.

    Args:
        writer: Open writer of the group.
        descriptor: The dataset's descriptor.
        plan: The group.
        between: Called before every rollout; an exception from it leaves the group open.
    """
    collection = _Collection(writer, descriptor, plan)
    between()
    nominal = collection.nominal()
    collection.report.unbranched_because = _unbranched_because(nominal, descriptor)
    if collection.report.unbranched_because:
        return collection.report
    bank = descriptor.action_bank
    for policy in bank.interventions:
        between()
        collection.replay("intervention", policy, nominal)
    for attempt in range(1, NUM_NOMINAL_REPLAYS + 1):
        between()
        collection.replay("nominal_replay", bank.nominal, nominal, attempt)
    return collection.report
