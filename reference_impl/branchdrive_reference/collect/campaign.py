"""A whole collection: plan, execute what is missing, commit shards in order, finish the dataset.

The descriptor that the collector writes for its datasets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from branchdrive.collector.campaign import check_begun, run_campaign
from branchdrive.collector.part import WHOLE, Part
from branchdrive.collector.report import CollectionReport
from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.descriptor import (
    Collection,
    DeclaredEncoding,
    Descriptor,
    Driver,
    ReplayNoise,
    Software,
    Vehicle,
)
from branchdrive.contract.encoding import ENCODING_NAME, ENCODING_WIDTH, encoding_digest
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.errors import UsageError
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.interrupt import deferred_interrupt
from branchdrive.runtime.progress import unwatched
from branchdrive.writer.writer import DatasetWriter
from branchdrive_reference.collect.disk import GROUPS_PER_SHARD, DiskNeed, disk_need
from branchdrive_reference.collect.group import execute_group
from branchdrive_reference.collect.plan import plan_group, select_scenarios
from branchdrive_reference.town.elements import Element, town_elements
from branchdrive_reference.town.town import TOWN_NAMES, town
from branchdrive_reference.version import COLLECTOR_NAME, COLLECTOR_VERSION, SIMULATOR_NAME, simulator_version
from branchdrive_reference.world.vehicle import MAX_BRAKE_MPS2, MAX_DRIVE_MPS2, MAX_STEER_RAD, WHEELBASE_M

__all__ = ["collect", "collection_descriptor", "town_maps"]


def collect(
    root: Path,
    *,
    num_groups: int,
    seed: int,
    replay_noise: float = 0.0,
    faults: Mapping[str, float] | None = None,
    branches: Mapping[str, float] | None = None,
    scenario_types: Sequence[str] = (),
    part: tuple[int, int] = WHOLE,
    jobs: int = 1,
    executor: Executor | None = None,
    resume: bool = False,
    foresee: Callable[[DiskNeed], None] = unwatched,
    watch: Callable[[int, int], None] = unwatched,
) -> CollectionReport:
    """Collect a dataset at `root`, or go on with one that was interrupted.

    Args:
        root: Folder of the dataset.
        num_groups: Branch groups of the whole dataset.
        seed: Seed of the collection.
        replay_noise: Strength of the noise of replays; 0 replays exactly.
        faults: Rates of injected faults by name.
        branches: Shares of groups by the kind of branch that is asked for; the others branch at the manoeuvre.
        scenario_types: Scenario types to plan; all registered ones by default.
        part: K and N, from 1: part K of N of the groups, whole shards.
        jobs: Worker processes; 1 works in this process.
        executor: What collects groups instead of these; the folder is on all of its machines.
        resume: Whether the folder must hold this collection already.
        foresee: Called with the room that the groups still take, before the first of them.
        watch: Called with the number of finished groups and of ticks executed by this run, at the
            beginning and after every group.

    Raises:
        UsageError: The folder holds something else or nothing to be resumed, another collector works
            on it, a scenario type is unknown, or the dataset is finished with fewer groups: what is finished
            keeps its version.
        PlatformError: The groups do not fit on the disk.
        KeyboardInterrupt: The user interrupted; whatever was finished is kept.
    """
    descriptor = collection_descriptor(
        seed, replay_noise=replay_noise, faults=faults, branches=branches, scenario_types=scenario_types
    )
    places = Part(*part).places(num_groups, GROUPS_PER_SHARD)
    if not (root / DESCRIPTOR_FILE).exists():
        if resume:
            raise UsageError(f"{root}: holds no collection to resume; leave out --resume to begin one")
        disk_need(root, len(places), jobs=jobs).check(root)  # before anything is created
    with DatasetWriter(root, descriptor, groups_per_shard=GROUPS_PER_SHARD, maps=town_maps()) as writer:
        planned = descriptor.collection
        with deferred_interrupt() as raise_if_noted:  # loading compiled code swallows interrupts
            plans = [plan_group(seed, place, planned.scenario_types, planned.branches) for place in places]
        raise_if_noted()
        check_begun(writer, num_groups, plans)

        def prepare(num_missing: int) -> None:
            need = disk_need(root, num_missing, jobs=jobs)
            need.check(root)
            foresee(need)

        return run_campaign(writer, plans, execute_group, jobs=jobs, executor=executor, prepare=prepare, watch=watch)


def town_maps() -> dict[str, tuple[Element, ...]]:
    """Elements of the maps of all towns, by name."""
    return {name: town_elements(town(name)) for name in TOWN_NAMES}


def collection_descriptor(
    seed: int,
    *,
    replay_noise: float = 0.0,
    faults: Mapping[str, float] | None = None,
    branches: Mapping[str, float] | None = None,
    scenario_types: Sequence[str] = (),
) -> Descriptor:
    """Descriptor of a collection; the number of groups is not part of it.

    Args:
        seed: Seed of the collection.
        replay_noise: Strength of the noise of replays.
        faults: Rates of injected faults by name.
        branches: Shares of groups by the kind of branch that is asked for; the others branch at the manoeuvre.
        scenario_types: Scenario types to plan; all registered ones if none is named.

    Raises:
        UsageError: A scenario type is not registered.
    """
    bank = load_action_bank()
    return Descriptor(
        dataset_id=f"branchdrive-reference-s{seed}",
        dataset_version="0.1.0",
        title="Matched interventions in the BranchDrive reference world",
        licence="CC-BY-4.0",
        simulator=Software(name=SIMULATOR_NAME, version=simulator_version()),
        collector=Software(name=COLLECTOR_NAME, version=COLLECTOR_VERSION),
        streams=("ego_route_state", "actor_risk_evidence", "map", "controls", "route_result"),
        action_bank=bank,
        action_encoding=DeclaredEncoding(name=ENCODING_NAME, width=ENCODING_WIDTH, sha256=encoding_digest(bank)),
        collection=Collection(
            seed=seed,
            replay_noise=ReplayNoise.of_strength(replay_noise),
            faults={str(name): rate for name, rate in sorted((faults or {}).items())},
            branches={str(kind): share for kind, share in sorted((branches or {}).items())},
            scenario_types=select_scenarios(scenario_types),
        ),
        vehicle=Vehicle(
            wheelbase_m=WHEELBASE_M,
            max_steer_rad=MAX_STEER_RAD,
            max_accel_mps2=MAX_DRIVE_MPS2,
            max_decel_mps2=MAX_BRAKE_MPS2,
            actuation="pedals",
        ),
        driver=Driver(kind="expert"),
    )
