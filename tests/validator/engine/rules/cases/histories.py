"""Cases of the leakage rules on histories: variables that hold or tell an outcome."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.features import renormalise
from tests.validator.engine.rules.release import ReleaseDraft


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
