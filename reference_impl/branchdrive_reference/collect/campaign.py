"""A whole collection: plan, execute what is missing, commit shards in order, finish the dataset.

The descriptor that the collector writes for its datasets.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from branchdrive.collector.pool import execute_groups, num_workers
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
from branchdrive.interrupt import deferred_interrupt
from branchdrive.writer.writer import DatasetWriter
from branchdrive_reference.collect.disk import GROUPS_PER_SHARD, DiskNeed, disk_need
from branchdrive_reference.collect.group import GroupReport, collect_group
from branchdrive_reference.collect.plan import plan_group, select_scenarios
from branchdrive_reference.town.elements import Element, town_elements
from branchdrive_reference.town.town import TOWN_NAMES, town
from branchdrive_reference.version import COLLECTOR_NAME, COLLECTOR_VERSION, SIMULATOR_NAME, SIMULATOR_VERSION
from branchdrive_reference.world.vehicle import MAX_BRAKE_MPS2, MAX_DRIVE_MPS2, MAX_STEER_RAD, WHEELBASE_M

__all__ = ["CampaignReport", "collect", "collection_descriptor", "town_maps"]


@dataclass(frozen=True)
class CampaignReport:
    """What a collection has done.

    Attributes:
        groups: Reports of the groups that this run finished.
        num_found: Groups that were finished before.
        num_workers: Processes that executed groups; 1 is the collector's own.
        seconds: Wall time, writing included.
        identity: Identity of the finished dataset.
    """

    groups: tuple[GroupReport, ...]
    num_found: int
    num_workers: int
    seconds: float
    identity: str

    @property
    def num_ticks(self) -> int:
        """Ticks that this run executed."""
        return sum(report.num_ticks for report in self.groups)

    @property
    def ticks_per_s(self) -> float:
        """Executed ticks per second of wall time."""
        return self.num_ticks / self.seconds


def _ignore(*_: object) -> None:
    """Nobody watches."""


def collect(
    root: Path,
    *,
    num_groups: int,
    seed: int,
    replay_noise: float = 0.0,
    faults: Mapping[str, float] | None = None,
    scenario_types: Sequence[str] = (),
    jobs: int = 1,
    resume: bool = False,
    foresee: Callable[[DiskNeed], None] = _ignore,
    watch: Callable[[int, int], None] = _ignore,
) -> CampaignReport:
    """Collect a dataset at `root`, or go on with one that was interrupted.

    Args:
        root: Folder of the dataset.
        num_groups: Branch groups of the whole dataset.
        seed: Seed of the collection.
        replay_noise: Strength of the noise of replays; 0 replays exactly.
        faults: Rates of injected faults by name.
        scenario_types: Scenario types to plan; all registered ones by default.
        jobs: Worker processes; 1 works in this process.
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
    begin_s = time.perf_counter()
    descriptor = collection_descriptor(seed, replay_noise=replay_noise, faults=faults, scenario_types=scenario_types)
    if not (root / DESCRIPTOR_FILE).exists():
        if resume:
            raise UsageError(f"{root}: holds no collection to resume; leave out --resume to begin one")
        disk_need(root, num_groups, jobs=jobs).check(root)  # before anything is created
    with DatasetWriter(root, descriptor, groups_per_shard=GROUPS_PER_SHARD, maps=town_maps()) as writer:
        selected = descriptor.collection.scenario_types
        _check_begun(root, writer, num_groups)
        with deferred_interrupt() as raise_if_noted:  # loading compiled code swallows interrupts
            plans = [plan_group(seed, index, selected) for index in range(num_groups)]
        raise_if_noted()
        missing = [plan for plan in plans if not writer.is_closed(plan.group_id)]
        num_found = num_groups - len(missing)
        if writer.is_finished and missing:
            raise UsageError(
                f"{root}: is a finished dataset of {num_found} groups, which stays as it is; "
                f"choose another folder to collect {num_groups}"
            )
        if missing:
            need = disk_need(root, len(missing), jobs=jobs)
            need.check(root)
            foresee(need)
        reports: list[GroupReport] = []
        num_ticks = 0
        watch(num_found, num_ticks)
        with closing(execute_groups(root, descriptor, missing, collect_group, jobs=jobs)) as finished:
            for report in finished:
                reports.append(report)
                num_ticks += report.num_ticks
                writer.commit()
                watch(num_found + len(reports), num_ticks)
        identity = writer.finalize()
    workers = num_workers(len(missing), jobs=jobs)
    return CampaignReport(tuple(reports), num_found, workers, time.perf_counter() - begin_s, identity)


def _check_begun(root: Path, writer: DatasetWriter, num_groups: int) -> None:
    """Refuse to go on with fewer groups than the collection was begun with.

    Raises:
        UsageError: A group beyond the first `num_groups` was begun.
    """
    begun = max(writer.places.values(), default=-1) + 1
    if begun > num_groups:
        raise UsageError(
            f"{root}: this collection has begun {begun} groups, more than the {num_groups} asked for; "
            f"ask for at least {begun}, or choose another folder"
        )


@cache
def _simulator_version() -> str:
    """Version of the simulator and of the libraries that decide its bits: a collection never mixes them."""
    libraries = (f"{name}.{version(name)}" for name in ("numba", "numpy", "pymunk"))
    return f"{SIMULATOR_VERSION}+{'.'.join(libraries)}"


def town_maps() -> dict[str, tuple[Element, ...]]:
    """Elements of the maps of all towns, by name."""
    return {name: town_elements(town(name)) for name in TOWN_NAMES}


def collection_descriptor(
    seed: int,
    *,
    replay_noise: float = 0.0,
    faults: Mapping[str, float] | None = None,
    scenario_types: Sequence[str] = (),
) -> Descriptor:
    """Descriptor of a collection; the number of groups is not part of it.

    Args:
        seed: Seed of the collection.
        replay_noise: Strength of the noise of replays.
        faults: Rates of injected faults by name.
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
        simulator=Software(name=SIMULATOR_NAME, version=_simulator_version()),
        collector=Software(name=COLLECTOR_NAME, version=COLLECTOR_VERSION),
        streams=("ego_route_state", "actor_risk_evidence", "map", "controls", "route_result"),
        action_bank=bank,
        action_encoding=DeclaredEncoding(name=ENCODING_NAME, width=ENCODING_WIDTH, sha256=encoding_digest(bank)),
        collection=Collection(
            seed=seed,
            replay_noise=ReplayNoise.of_strength(replay_noise),
            faults={str(name): rate for name, rate in sorted((faults or {}).items())},
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
