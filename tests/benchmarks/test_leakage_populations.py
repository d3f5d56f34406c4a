"""Small populations of a release: disjoint within a pass, and each split as the whole."""

from __future__ import annotations

from benchmarks.leakage_populations import NUM_GROUPS, populations
from tests.validator.leakage.replays import replay_inputs


def test_populations_of_a_pass_share_no_group() -> None:
    inputs = replay_inputs(3 * NUM_GROUPS + 5, seed=0)
    found = list(populations(inputs, 6))
    for first in (0, 3):
        groups = [group for population in found[first : first + 3] for group in population.group_ids]
        assert len(groups) == len(set(groups)) == 3 * NUM_GROUPS
    assert found[0].group_ids != found[3].group_ids
    for population in found:
        assert list(population.group_ids) == sorted(population.group_ids)
        counts = {name: population.partitions.count(name) for name in ("train", "val", "test")}
        assert counts == {"train": 12, "val": 4, "test": 4}


def test_rows_of_a_population_are_those_of_its_groups() -> None:
    inputs = replay_inputs(NUM_GROUPS, seed=0)
    (population,) = populations(inputs, 1)
    assert population.group_ids == inputs.group_ids
    assert (population.ego == inputs.ego).all()
