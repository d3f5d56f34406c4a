"""One branch group of a world: the nominal pass, its branch, the interventions and the nominal replays.

Every rollout is executed from tick 0. Rollouts that an interrupted run has finished are reused, also the nominal one
with its branch and its commands. A seed whose nominal rollout has no branch, or breaks a rule that costs its group,
leaves a group of that one rollout.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from branchdrive.collector.drive import Drive, drive
from branchdrive.collector.record import record
from branchdrive.collector.report import GroupReport
from branchdrive.collector.review import review_nominal
from branchdrive.collector.town import Element
from branchdrive.collector.trigger import Trigger, brake_trigger, branch_columns
from branchdrive.collector.world import World
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.policy import Policy
from branchdrive.contract.text import listed
from branchdrive.contract.timing import WINDOW_OFFSETS
from branchdrive.errors import UsageError
from branchdrive.raw.rollout import Rollout
from branchdrive.writer.group_writer import GroupWriter
from branchdrive.writer.rollout_writer import RolloutWriter

__all__ = ["GroupPlan", "WorldCollector", "collect_group"]


@dataclass(frozen=True)
class GroupPlan:
    """One planned group.

    Attributes:
        index: Place in the dataset, from 0.
        group_id: Identity of the group.
        scenario_type: What world it is collected in.
        seed: What the world is reset with.
    """

    index: int
    group_id: str
    scenario_type: str
    seed: int


def _nothing() -> None:
    """Without interruption."""


@dataclass(frozen=True)
class WorldCollector:
    """Collects groups of worlds; processes hand it to each other, so that the makers of worlds are to be pickled.

    Attributes:
        makers: What makes the world of each scenario type: a class, or a function of a module.
        maps: Elements of the map of each town; what a world leaves open of lane, road and speed limit follows from it.
        trigger: What places the branch in a nominal rollout.
        max_ticks: Ticks after which a route is given up.
        num_replays: Nominal replays of a group.
        max_attempts: Attempts at a policy after which the group is given up.
        protocol_variant: Name of the protocol.
        all_frames: Whether media cover every saved observation, and not only the 26 around the branch.
    """

    makers: Mapping[str, Callable[[], World]]
    maps: Mapping[str, Sequence[Element]] = field(default_factory=dict)
    trigger: Trigger = field(default_factory=lambda: brake_trigger("expert-brake 1"))
    max_ticks: int = 1200
    num_replays: int = 2
    max_attempts: int = 3
    protocol_variant: str = "v1"
    all_frames: bool = False
    _worlds: dict[str, World] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_worlds": {}}  # every process makes its own

    def world(self, scenario_type: str) -> World:
        """The world of a scenario type, made once in this process.

        Raises:
            UsageError: There is none.
        """
        if scenario_type not in self.makers:
            raise UsageError(f"no world for scenario type {scenario_type!r}; there are {', '.join(self.makers)}")
        if scenario_type not in self._worlds:
            self._worlds[scenario_type] = self.makers[scenario_type]()
        return self._worlds[scenario_type]

    def __call__(
        self, writer: GroupWriter, descriptor: Descriptor, plan: GroupPlan, *, between: Callable[[], None] = _nothing
    ) -> GroupReport:
        """Execute what is missing of a group; see `collect_group`."""
        return _Group(self, writer, descriptor, plan, between).collect()


def collect_group(
    writer: GroupWriter,
    descriptor: Descriptor,
    world: Callable[[], World],
    *,
    scenario_type: str,
    seed: int,
    **options: object,
) -> GroupReport:
    """Execute what is missing of one group, in a world of one's own.

    Args:
        writer: Open writer of the group.
        descriptor: The dataset's descriptor.
        world: Makes the world.
        scenario_type: Its scenario type.
        seed: What it is reset with.
        **options: As `WorldCollector` has them: ``maps``, ``trigger``, ``max_ticks``, ``num_replays``,
            ``max_attempts``, ``protocol_variant``, ``all_frames``.

    Raises:
        ContractError: A rollout breaks the format; it is not written.
        UsageError: The world contradicts itself.
    """
    collector = WorldCollector({scenario_type: world}, **options)  # type: ignore[arg-type]
    return collector(writer, descriptor, GroupPlan(writer.index, writer.group_id, scenario_type, seed))


@dataclass
class _Group:
    collector: WorldCollector
    writer: GroupWriter
    descriptor: Descriptor
    plan: GroupPlan
    between: Callable[[], None]
    report: GroupReport = field(init=False)

    def __post_init__(self) -> None:
        self.report = GroupReport(self.plan.group_id)

    def collect(self) -> GroupReport:
        bank, report = self.descriptor.action_bank, self.report
        nominal = self._rollout("nominal", bank.nominal, None)
        unfound = "the trigger found no manoeuvre of the expert with its windows in the rollout"
        town_map = self.writer.town_map(nominal.record["town"])
        if not review_nominal(nominal, self.descriptor, report, unfound=unfound, town_map=town_map):
            return report
        wanted = [("intervention", policy, 0) for policy in bank.interventions]
        wanted += [("nominal_replay", bank.nominal, number) for number in range(self.collector.num_replays)]
        for role, policy, num_before in wanted:
            if not report.stopped_because:
                self._rollout(role, policy, nominal, num_before)
        return report

    def _rollout(self, role: str, policy: Policy, nominal: Rollout | None, num_before: int = 0) -> Rollout:
        """The first complete attempt, reused or executed; the last one where none is complete.

        Args:
            role: Role in the group.
            policy: The policy.
            nominal: The nominal rollout that it replays.
            num_before: Complete attempts with this role that belong to others.
        """
        attempts = [r for r in self.writer.rollouts if (r.record["role"], r.record["action_key"]) == (role, policy.key)]
        attempts.sort(key=lambda rollout: int(rollout.record["attempt"]))
        complete = [rollout for rollout in attempts if rollout.record["status"] == "complete"]
        if len(complete) > num_before:
            self.report.num_reused += 1
            return complete[num_before]
        failed = attempts[attempts.index(complete[-1]) + 1 :] if complete else attempts
        while len(failed) < self.collector.max_attempts:
            rollout = self._execute(role, policy, nominal)
            if rollout.record["status"] == "complete":
                return rollout
            failed.append(rollout)
        self.report.stopped_because = f"no attempt at {policy.key} was complete: {len(failed)} made"
        return failed[-1]

    def _execute(self, role: str, policy: Policy, nominal: Rollout | None) -> Rollout:
        self.between()
        world = self.collector.world(self.plan.scenario_type)
        variant = self.collector.protocol_variant
        writer = self.writer.begin_rollout(role=role, action_key=policy.key, protocol_variant=variant)
        try:
            take_frames = self._taker(world, writer, nominal)
            limit = self.collector.max_ticks
            run = drive(world, self.plan.seed, policy, nominal=nominal, max_ticks=limit, take_frames=take_frames)
            self.report.num_simulated += 1
            self.report.num_ticks += run.num_ticks
            return self._write(writer, role, run, nominal)
        except BaseException:
            with suppress(UsageError):  # the first error is the one that counts
                writer.abandon()
            raise

    def _taker(self, world: World, writer: RolloutWriter, nominal: Rollout | None) -> Callable[[int], None]:
        """What takes the images of a world at a tick; in a nominal rollout, whose branch is to be found, at any."""
        cameras = [camera.name for camera in self.descriptor.cameras]
        look: Callable[[], Mapping[str, bytes]] | None = getattr(world, "frames", None)
        if cameras and look is None:
            raise UsageError(
                f"the descriptor declares the cameras {listed(cameras)}, and the world {type(world).__name__} has no "
                "method `frames`; write it, or claim no media stream"
            )
        wanted = None if nominal is None else self._covered(nominal.branch_tick)

        def take(tick: int) -> None:
            if not cameras or look is None or (wanted is not None and tick not in wanted):
                return
            frames = look()
            if missing := [camera for camera in cameras if camera not in frames]:
                given = f"it gave {listed(frames)}" if frames else "it gave none"
                raise UsageError(
                    f"`frames` gives no image of {listed(missing)} at tick {tick}; {given}; give one of every camera"
                )
            for camera, image in frames.items():
                writer.append_frame(tick, camera, image)

        return take

    def _covered(self, branch_tick: int | None) -> frozenset[int] | None:
        """Ticks that media cover; ``None`` for all."""
        if self.collector.all_frames:
            return None
        return frozenset() if branch_tick is None else frozenset(branch_tick + offset for offset in WINDOW_OFFSETS)

    def _write(self, writer: RolloutWriter, role: str, run: Drive, nominal: Rollout | None) -> Rollout:
        town = self.collector.maps.get(run.scene.town)
        recorded = record(run, has_evidence="evidence" in self.descriptor.tables, town=town)
        recorded.append_to(writer)
        if nominal is not None:
            link = {**branch_columns(nominal), "nominal_rollout_id": nominal.rollout_id}
        else:
            branch = None if run.partial_because else self.collector.trigger.evaluate(run.trace)
            link = branch.columns(writer.rollout_id) if branch else {}
            covered = self._covered(branch.branch_tick if branch else None)
            if self.descriptor.cameras and covered is not None:
                writer.keep_frames(covered)
        simulator, collector = self.descriptor.simulator, self.descriptor.collector
        return writer.finish(
            **recorded.fields,
            **link,
            scenario_type=self.plan.scenario_type,
            seed=self.plan.seed,
            repetition=0,
            simulator_version=f"{simulator.name} {simulator.version}",
            collector_version=f"{collector.name} {collector.version}",
            provenance=f"{role} of group {self.plan.group_id}, seed {self.plan.seed}, executed from tick 0",
        )
