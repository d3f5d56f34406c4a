"""Cases of the leakage rules on histories: variables that hold or tell an outcome."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.model_inputs_features import renormalise
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.contract.timing import HISTORY_OFFSETS


def hide(d: ReleaseDraft, hidden: Callable[[int, float], float], outcome: float | None = None) -> None:
    """Make the speed limit at the branch a function of the rank of a group and of its mean jerk when it brakes.

    With `outcome` given, that target becomes `outcome` times the speed limit.
    """
    for rank, group in enumerate(d.frame("contexts")["group_id"].tolist()):
        where = {"group_id": group, "action_key": "brake_0.50"}
        limit = hidden(rank, d.value("scalars", "mean_jerk_mps3", **where))
        d.set("state", "speed_limit_mps", limit, group_id=group, offset_ticks=0)
        if outcome is not None:
            d.set("scalars", "mean_jerk_mps3", outcome * limit, **where)
    renormalise(d)


def ranked_groups(d: ReleaseDraft) -> Iterator[tuple[int, str, float]]:
    """Rank, name and mean jerk of the groups when they brake, the least jerk first."""
    groups = d.frame("contexts")["group_id"].tolist()
    jerk = {group: d.value("scalars", "mean_jerk_mps3", group_id=group, action_key="brake_0.50") for group in groups}
    for rank, group in enumerate(sorted(groups, key=jerk.__getitem__)):
        yield rank, group, jerk[group]


@boundary("BD-LKG-010", base="alone")
def variable_that_is_nearly_a_target(d: ReleaseDraft) -> None:
    hide(d, lambda rank, outcome: outcome * (1 + (-1) ** rank * 1e-3))


@boundary("BD-LKG-013", base="alone")
def variable_that_follows_a_target_from_afar(d: ReleaseDraft) -> None:
    hide(d, lambda rank, outcome: outcome + 3.0 * (rank % 4))


@boundary("BD-LKG-010", base="alone")
def target_of_nine_values(d: ReleaseDraft) -> None:
    hide(d, lambda rank, outcome: 10.0 + rank % 9, 0.5)


@boundary("BD-LKG-010", base="alone")
def target_in_the_history_of_fewer_than_half_of_the_groups(d: ReleaseDraft) -> None:
    for group in d.frame("contexts")["group_id"].tolist()[:7]:
        outcome = d.value("scalars", "mean_jerk_mps3", group_id=group, action_key="brake_0.50")
        d.set("state", "speed_limit_mps", outcome, group_id=group, offset_ticks=0)
    renormalise(d)


# BD-LKG-009: histories that tell a target


@mutant("BD-LKG-009", at={"column": "state speed_limit_mps at tick -75"}, base="alone")
def history_that_ranks_a_target(d: ReleaseDraft) -> None:
    groups = d.frame("contexts")["group_id"].tolist()
    for rank, group in enumerate(np.random.default_rng(3).permutation(groups).tolist()):
        d.set("state", "speed_limit_mps", 10.0 + rank, group_id=group, offset_ticks=-75)
        d.set("scalars", "max_yaw_rate_radps", 0.25 + rank**2 / 512, group_id=group)
    renormalise(d)


# BD-LKG-010: histories that hold a target


@mutant("BD-LKG-010", at={"column": "state speed_limit_mps at tick 0"}, base="alone")
def target_hidden_in_the_history(d: ReleaseDraft) -> None:
    hide(d, lambda _, outcome: outcome)


@mutant("BD-LKG-010", at={"column": "state speed_limit_mps at tick 0"}, base="alone")
def target_hidden_by_scale_and_offset(d: ReleaseDraft) -> None:
    hide(d, lambda _, outcome: 3 * outcome + 1)


@mutant("BD-LKG-010", at={"column": "state speed_limit_mps at tick 0"}, base="alone")
def target_hidden_with_the_other_sign(d: ReleaseDraft) -> None:
    hide(d, lambda _, outcome: 40 - outcome)


# BD-LKG-013: histories that tell an outcome


@mutant("BD-LKG-013", at={"column": "state speed_limit_mps at tick 0"}, base="alone")
def target_hidden_under_a_little_noise(d: ReleaseDraft) -> None:
    hide(d, lambda rank, outcome: outcome + 2e-5 * (-1) ** rank)


@mutant("BD-LKG-013", at={"column": "state speed_limit_mps at tick 0"}, base="alone")
def target_hidden_by_a_square(d: ReleaseDraft) -> None:
    hide(d, lambda _, outcome: outcome**2)


@mutant("BD-LKG-013", at={"column": "expert target_speed_mps at tick -40"}, base="alone")
def target_hidden_in_the_target_speed(d: ReleaseDraft) -> None:
    for _, group, outcome in ranked_groups(d):
        d.set("expert", "target_speed_mps", outcome + 1e-5, group_id=group, offset_ticks=-40)
    renormalise(d)


# BD-LKG-014: values that repeat


def repeat(d: ReleaseDraft, num_different: Callable[[int], int]) -> None:
    """Let the speed limits of a history have as many values as follows from the rank of a group's jerk, from 0."""
    for rank, group, _ in ranked_groups(d):
        for number, offset in enumerate(HISTORY_OFFSETS):
            limit = 10.0 + min(number, num_different(rank) - 1) / 64
            d.set("state", "speed_limit_mps", limit, group_id=group, offset_ticks=offset)
    renormalise(d)


@mutant("BD-LKG-014", at={"column": "state speed_limit_mps number of different values"}, base="alone")
def target_hidden_in_how_often_values_repeat(d: ReleaseDraft) -> None:
    repeat(d, lambda rank: 1 + rank)


@boundary("BD-LKG-014", base="alone")
def values_that_repeat_in_nine_ways(d: ReleaseDraft) -> None:
    repeat(d, lambda rank: 1 + 9 * rank // 15)


# BD-LKG-015: images of nominals


@mutant("BD-LKG-015", at={"column": "top_down size_bytes at tick 0"}, base="alone")
def target_hidden_in_the_sizes_of_images(d: ReleaseDraft) -> None:
    for rank, group, _ in ranked_groups(d):
        d.set("media_index", "size_bytes", 3_000 + 7 * rank, group_id=group)


@boundary("BD-LKG-015", base="alone")
def sizes_of_images_that_follow_a_target_from_afar(d: ReleaseDraft) -> None:
    for rank, group, _ in ranked_groups(d):
        d.set("media_index", "size_bytes", 3_000 + 7 * (rank ^ 1), group_id=group)


# BD-LKG-016: categories


BEST_BY_TYPE = ("brake_0.50", "steer_left_0.10", "accelerate_0.30")
"""Actions for the scenario types in alphabetical order."""


def best_by_type(d: ReleaseDraft, exceptions: int) -> None:
    """Give each scenario type an action with the largest yaw rate, but for a number of groups."""
    contexts = d.frame("contexts")
    kinds = sorted(set(contexts["scenario_type"].tolist()))
    pairs = zip(contexts["group_id"].tolist(), contexts["scenario_type"].tolist(), strict=True)
    for number, (group, kind) in enumerate(pairs):
        action = BEST_BY_TYPE[(kinds.index(kind) + (number < exceptions)) % len(kinds)]
        d.set("scalars", "max_yaw_rate_radps", 1.5, group_id=group, action_key=action)
    renormalise(d)


@mutant("BD-LKG-016", at={"table": "contexts", "column": "scenario_type"}, base="alone")
def scenario_types_that_name_an_action(d: ReleaseDraft) -> None:
    best_by_type(d, 0)


@boundary("BD-LKG-016", base="alone")
def scenario_types_that_name_an_action_in_all_groups_but_one(d: ReleaseDraft) -> None:
    best_by_type(d, 1)


# BD-LKG-008: identifiers, a diagnostic


@mutant("BD-LKG-008", at={"table": "group_quality", "column": "group_id"})
def partitions_in_the_order_of_identifiers(d: ReleaseDraft) -> None:
    frame = d.frame("group_quality")
    ordered = sorted(frame["group_id"][frame["partitioned"]].tolist())
    homes = dict(zip(ordered, ["train"] * 12 + ["val"] * 3 + ["test"] * 3, strict=True))
    for group, home in homes.items():
        d.set("group_quality", "partition", home, group_id=group)
    d.reseal("split")
