"""What a raw layer holds: every group and attempt counts once, in one piece or in shards."""

from __future__ import annotations

from dataclasses import fields
from functools import cache

import numpy as np
from tests.synthetic import base_tables, descriptor

from branchdrive.contract.descriptor import Descriptor
from branchdrive.engine.examine import examine
from branchdrive.quality.collected import Collected
from branchdrive.quality.qualification import first_attempts
from branchdrive.raw.shard_view import ShardView


@cache
def parts() -> list[tuple[ShardView, Collected]]:
    declared, found = Descriptor.model_validate(descriptor()), []
    for tables in base_tables().values():
        view = ShardView(tables, declared)
        _, examination = examine(view)
        found.append((view, Collected.of(view, examination, first_attempts(view, examination))))
    return found


def test_every_group_and_attempt_counts_once() -> None:
    merged = Collected.merged(part for _, part in parts())
    assert sorted(merged.group_id) == sorted(group_id for view, _ in parts() for group_id in view.group_ids)
    assert sum(merged.scenario_types.values()) == sum(merged.towns.values()) == merged.num_groups == 3
    assert merged.statuses.total() == merged.attempts_by_town.total() == sum(view.num_rollouts for view, _ in parts())
    assert merged.num_ticks == sum(len(view.controls) for view, _ in parts())


def test_one_part_is_what_is_merged_of_it() -> None:
    _, part = parts()[0]
    merged = Collected.merged([part])
    for field in fields(Collected):
        assert np.array_equal(getattr(merged, field.name), getattr(part, field.name))


def test_groups_with_a_usable_route_are_in_clusters() -> None:
    merged = Collected.merged(part for _, part in parts())
    assert merged.has_route.all()
    assert sorted(merged.cluster_of_groups) == sorted(merged.group_id)
    assert len(set(merged.cluster_of_groups.values())) == merged.num_route_clusters
