"""Defects and limits of the effects of commands, over the whole dataset."""

from __future__ import annotations

from dataclasses import replace

from tests.scenes import SCENES
from tests.synthetic import make_group
from tests.validator.engine.rules.case import SHARD_1, boundary, mutant
from tests.validator.engine.rules.cases.groups_outcomes import give_outcome, like_nominal
from tests.validator.engine.rules.draft import Draft

# BD-RSP-002


@mutant("BD-RSP-002", base="bare", at={"action_key": "brake_1.00"})
def command_that_does_nothing(d: Draft) -> None:
    like_nominal(d, lambda row: row["action_key"] == "brake_1.00")


@mutant(
    "BD-RSP-002", base="bare", at={"action_key": "accelerate_0.30"}, findings=11
)  # one steers like the nominal in a curve
def commands_are_ignored(d: Draft) -> None:
    """All but one: in a curve, the nominal steers like `steer_right_0.05`."""
    like_nominal(d, lambda row: True)


@boundary("BD-RSP-002", "BD-GRP-009", base="bare")
def throttle_that_does_nothing_in_two_of_three_groups(d: Draft) -> None:
    """The first third of a pedal may be dead."""
    like_nominal(d, lambda row: row["action_key"] == "accelerate_0.30" and row["group_id"] != "g0")


@mutant("BD-RSP-002", base="bare", at={"action_key": "accelerate_0.80"})
def two_actions_with_one_future(d: Draft) -> None:
    give_outcome(d, "accelerate_0.50", "accelerate_0.80", "g0", "g1", "g2")


@boundary("BD-RSP-002", "BD-GRP-009", base="bare")
def two_actions_with_one_future_in_two_of_three_groups(d: Draft) -> None:
    """Two throttles of a vehicle at its top speed."""
    give_outcome(d, "accelerate_0.50", "accelerate_0.80", "g0", "g1")


def _add_group(d: Draft, speed_mps: float = 6.0) -> None:
    """A fourth group, of the first scene on another road, which starts at a speed."""
    route, start = replace(SCENES[0].route, start=(0.0, 3000.0)), (*SCENES[0].start[:2], speed_mps)
    tables = make_group(3, scene=replace(SCENES[0], route=route, start=start))
    for table in d.tables[SHARD_1]:
        d.append(table, tables[table], folder=SHARD_1)


@boundary("BD-RSP-002", base="bare")
def group_on_another_road(d: Draft) -> None:
    _add_group(d)


@mutant("BD-RSP-002", base="bare", at={"action_key": "accelerate_0.80"})
def outcome_of_more_throttle_in_three_of_four_groups(d: Draft) -> None:
    _add_group(d)
    give_outcome(d, "accelerate_0.50", "accelerate_0.80", "g0", "g1", "g2")


@boundary("BD-RSP-002", base="bare")
def outcome_of_less_throttle_in_three_of_four_groups(d: Draft) -> None:
    """The vehicle gains less than 2 m/s, and may be at its top speed."""
    _add_group(d)
    give_outcome(d, "accelerate_0.80", "accelerate_0.50", "g0", "g1", "g2")


@boundary("BD-RSP-002", base="bare")
def outcome_of_more_throttle_at_speeds_of_their_own(d: Draft) -> None:
    """The group that tells both actions apart begins slower than the others: power may have a limit."""
    _add_group(d, speed_mps=5.5)
    give_outcome(d, "accelerate_0.50", "accelerate_0.80", "g0", "g1", "g2")
