"""A whole dataset of worlds: which groups there are, and collecting them.

The seeds of the groups are a function of the collection's seed and of their places alone.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from branchdrive.collector.campaign import check_begun, run_campaign
from branchdrive.collector.group import GroupPlan, WorldCollector
from branchdrive.collector.part import WHOLE, Part
from branchdrive.collector.report import CollectionReport
from branchdrive.collector.town import Element
from branchdrive.collector.world import World
from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.descriptor import Collection, DeclaredEncoding, Descriptor, Software
from branchdrive.contract.encoding import ENCODING_NAME, ENCODING_WIDTH, encoding_digest
from branchdrive.errors import UsageError
from branchdrive.runtime.progress import unwatched
from branchdrive.writer.writer import DatasetWriter

__all__ = ["collect_dataset", "describe", "plan_groups"]

_STREAMS = ("ego_route_state", "actor_risk_evidence", "controls", "route_result")


def describe(
    dataset_id: str, *, seed: int, simulator: tuple[str, str], collector: tuple[str, str], **fields: Any
) -> Descriptor:
    """A descriptor with the bank of the specification, without media unless `fields` have their streams and cameras.

    Args:
        dataset_id: Identity of the dataset.
        seed: Seed of the collection.
        simulator: Name and version of the simulator.
        collector: Name and version of the collector.
        **fields: Further fields of `Descriptor`, in place of what is filled in: version 0.1.0, the licence CC-BY-4.0,
            every required stream with actors and evidence, and a title.

    Raises:
        ContractError: A field breaks the format.
    """
    bank = load_action_bank()
    given: dict[str, Any] = {
        "dataset_version": "0.1.0",
        "title": f"Matched interventions in {simulator[0]}",
        "licence": "CC-BY-4.0",
        "streams": _STREAMS,
        "action_bank": bank,
        "action_encoding": DeclaredEncoding(name=ENCODING_NAME, width=ENCODING_WIDTH, sha256=encoding_digest(bank)),
        "collection": Collection(seed=seed),
        **fields,
    }
    programs = {
        role: Software(name=name, version=version)
        for role, (name, version) in (("simulator", simulator), ("collector", collector))
    }
    return Descriptor(dataset_id=dataset_id, **programs, **given)


def plan_groups(seed: int, num_groups: int, scenario_types: Sequence[str]) -> list[GroupPlan]:
    """The groups of a collection: scenario types take turns, and every group has a seed of its own, below 2**31."""
    plans = []
    for index in range(num_groups):
        name = scenario_types[index % len(scenario_types)]
        own_seed = int.from_bytes(hashlib.sha256(f"{seed}:{index}".encode()).digest()[:4]) >> 1
        plans.append(GroupPlan(index, f"g{index:05d}-{re.sub('[^a-z0-9]+', '-', name.lower())}", name, own_seed))
    return plans


def _chosen(plans: Sequence[GroupPlan], group_ids: Sequence[str]) -> list[GroupPlan]:
    """The groups with `group_ids`, in that order, with places of their own and the seeds that they have among all."""
    by_id = {plan.group_id: plan for plan in plans}
    unknown = [group_id for group_id in group_ids if group_id not in by_id]
    if unknown or len(set(group_ids)) < len(group_ids):
        found = f"there is no {unknown[0]!r}" if unknown else f"one is named twice in {', '.join(group_ids)}"
        raise UsageError(f"only: give ids of the {len(plans)} groups of the collection, each once; {found}")
    return [replace(by_id[group_id], index=index) for index, group_id in enumerate(group_ids)]


def collect_dataset(
    root: str | Path,
    descriptor: Descriptor,
    worlds: Mapping[str, Callable[[], World]],
    *,
    num_groups: int,
    jobs: int = 1,
    maps: Mapping[str, Sequence[Element]] | None = None,
    groups_per_shard: int = 32,
    only: Sequence[str] = (),
    part: tuple[int, int] = WHOLE,
    watch: Callable[[int, int], None] = unwatched,
    **options: Any,
) -> CollectionReport:
    """Collect a dataset at `root`, or go on with one that was interrupted; the bytes are the same.

    With several `jobs` it starts processes, and so belongs below ``if __name__ == "__main__":`` in a script.

    Args:
        root: Folder of the dataset.
        descriptor: What the dataset is; its collection's seed decides the seeds of the groups.
        worlds: What makes the world of each scenario type; they take turns.
        num_groups: Groups of the dataset. A seed without a branch leaves a group of one nominal rollout.
        jobs: Worker processes; 1 works in this process.
        maps: Elements of each town, where the descriptor claims the stream ``map``. What a world leaves open of lane,
            road and speed limit follows from them.
        groups_per_shard: Groups of one shard.
        only: Ids of the groups to collect of the `num_groups`, in that order; all of them where it is empty. A group
            has the same content, which ``branchdrive pilot --rerun`` tries.
        part: K and N, from 1: part K of N of these groups, whole shards. ``branchdrive merge`` makes the N parts the
            dataset that one machine collects.
        watch: Called with the number of finished groups and of ticks executed by this run.
        **options: As `WorldCollector` has them: ``trigger``, ``max_ticks``, ``num_replays``, ``max_attempts``,
            ``protocol_variant``, ``all_frames``.

    Raises:
        UsageError: The folder cannot be used, or a world contradicts itself.
        ContractError: A rollout breaks the format; it is not written, and what was finished is kept.
        WorkerError: A worker process died.
    """
    if not worlds or num_groups < 1:
        raise UsageError(f"a dataset takes a world and a group; found {len(worlds)} worlds and {num_groups} groups")
    collector = WorldCollector(worlds, maps or {}, **options)
    plans = plan_groups(descriptor.collection.seed, num_groups, tuple(worlds))
    if only:
        plans = _chosen(plans, only)
    own = [plans[place] for place in Part(*part).places(len(plans), groups_per_shard)]
    with DatasetWriter(root, descriptor, groups_per_shard=groups_per_shard, maps=maps) as writer:
        check_begun(writer, len(plans), own)
        return run_campaign(writer, own, collector, jobs=jobs, watch=watch)
