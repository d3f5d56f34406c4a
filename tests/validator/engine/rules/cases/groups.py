"""Defects and limits of branch groups: the bank, its nominal, and what candidates share."""

from __future__ import annotations

from typing import Any

from tests.synthetic import BRANCH_TICK, Plan, make_group, plans
from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    NOMINAL,
    REPLAY,
    STEER_LEFT,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

GROUP = {"group_id": "g0"}


# BD-BNK-001


@mutant("BD-BNK-001", at=GROUP)
def action_never_executed(d: Draft) -> None:
    d.drop_attempt(BRAKE)


@mutant("BD-BNK-001", at=GROUP)
def seven_actions_never_executed(d: Draft) -> None:
    ids = d.take("rollouts", group_id="g0", role="intervention")["rollout_id"].to_pylist()
    for rollout_id in ids[:7]:
        d.drop_attempt(rollout_id)


@boundary("BD-BNK-001")
def group_without_replays(d: Draft) -> None:
    for attempt in (1, 2):
        d.drop_attempt(f"g0.nominal_replay.a{attempt}")


# BD-BNK-002


@mutant("BD-BNK-002", at=GROUP)
def one_action_against_another_nominal(d: Draft) -> None:
    d.copy_attempt(NOMINAL, "g0.nominal.a2", attempt=2, trigger_rollout_id="g0.nominal.a2")
    d.set("rollouts", ("nominal_rollout_id", "trigger_rollout_id"), "g0.nominal.a2", rollout_id=BRAKE)


@boundary("BD-BNK-002", "BD-TRG-001")
def whole_group_against_a_later_nominal(d: Draft) -> None:
    d.set("rollouts", "attempt", 4, rollout_id=NOMINAL)


# BD-GRP-001 .. BD-GRP-005


def _differs(column: str, rollout_id: str = STEER_LEFT) -> dict[str, Any]:
    return {**GROUP, "table": "rollouts", "column": column, "rollout_id": rollout_id}


@mutant("BD-GRP-001", at=_differs("route_id"))
def another_route_id(d: Draft) -> None:
    d.set("rollouts", "route_id", "route-9", rollout_id=STEER_LEFT)


@mutant("BD-GRP-001", at=_differs("route_y_m"))
def last_vertex_moved(d: Draft) -> None:
    d.set("rollouts", "route_y_m", lambda ys: [*ys[:-1], ys[-1] + 1e-9], rollout_id=STEER_LEFT)


@boundary("BD-GRP-001")
def vertex_at_negative_zero(d: Draft) -> None:
    d.set("rollouts", "route_y_m", lambda ys: [-0.0, *ys[1:]], rollout_id=STEER_LEFT)


@mutant("BD-GRP-002", at=_differs("town"))
def another_town(d: Draft) -> None:
    d.set("rollouts", "town", "Town13", rollout_id=STEER_LEFT)


@boundary("BD-GRP-002", "BD-GRP-005")
def unchosen_attempts_may_differ(d: Draft) -> None:
    d.copy_attempt(BRAKE, "g0.brake_0.50.a2", attempt=2, town="Town13", environment="Night")


@mutant("BD-GRP-003", at=_differs("seed"))
def another_seed_beyond_double_precision(d: Draft) -> None:
    d.set("rollouts", "seed", lambda seed: seed + 1, rollout_id=STEER_LEFT)


@mutant("BD-GRP-003", at=_differs("repetition"))
def another_repetition(d: Draft) -> None:
    d.set("rollouts", "repetition", 1, rollout_id=STEER_LEFT)


@boundary("BD-GRP-003", "BD-GRP-004")
def groups_may_differ_from_each_other(d: Draft) -> None:
    d.set("rollouts", "seed", 1, group_id="g1")
    d.replace_group(2, make_group(2, plans(2, branch_tick=110)))


@mutant("BD-GRP-004", at=_differs("branch_tick", "g2.steer_left_0.10.a1") | {"group_id": "g2"})
def one_action_branched_a_frame_later(d: Draft) -> None:
    planned = [
        Plan(p.role, p.action_key, p.attempt, BRANCH_TICK + 5 if p.action_key == "steer_left_0.10" else BRANCH_TICK)
        for p in plans(2)
    ]
    d.replace_group(2, make_group(2, planned))


@mutant("BD-GRP-004", at={**GROUP, "column": "branch_tick"})
def nominal_branched_a_frame_later(d: Draft) -> None:
    d.set("rollouts", "branch_tick", BRANCH_TICK + 5, rollout_id=NOMINAL)
    d.set("rollouts", "branch_frame", (BRANCH_TICK + 5) // 5, rollout_id=NOMINAL)


@mutant("BD-GRP-005", at=_differs("scenario_type"))
def another_scenario(d: Draft) -> None:
    d.set("rollouts", "scenario_type", "HardBrake", rollout_id=STEER_LEFT)


@mutant("BD-GRP-005", at=_differs("environment"))
def another_weather(d: Draft) -> None:
    d.set("rollouts", "environment", "Night", rollout_id=STEER_LEFT)


@mutant("BD-GRP-004", at=_differs("trigger_signal"))
def another_trigger_signal(d: Draft) -> None:
    d.set("rollouts", "trigger_signal", "lane_shift", rollout_id=STEER_LEFT)


@mutant("BD-GRP-005", at=_differs("ego_height_m"))
def another_ego(d: Draft) -> None:
    d.set("rollouts", "ego_height_m", 3.5, rollout_id=STEER_LEFT)


@mutant("BD-GRP-006", at={"rollout_id": REPLAY, "column": "town"}, lost=0)
def replay_in_another_town(d: Draft) -> None:
    d.set("rollouts", "town", "Town13", rollout_id=REPLAY)


@mutant("BD-GRP-006", at={"rollout_id": REPLAY, "column": "seed"}, lost=0)
def replay_with_another_seed(d: Draft) -> None:
    d.set("rollouts", "seed", 1, rollout_id=REPLAY)


@boundary("BD-GRP-006")
def replay_of_another_collector_version(d: Draft) -> None:
    d.set("rollouts", "collector_version", "other 2", rollout_id=REPLAY)


# BD-GRP-007


@mutant("BD-GRP-007", at=_differs("protocol_variant"))
def action_of_another_variant_alone(d: Draft) -> None:
    d.set("rollouts", "protocol_variant", "online-steering", rollout_id=STEER_LEFT)


@boundary("BD-GRP-007", "BD-BNK-002")
def further_nominal_under_its_own_variant(d: Draft) -> None:
    d.copy_attempt(NOMINAL, "g0.nominal.b", attempt=1, protocol_variant="a", trigger_rollout_id="g0.nominal.b")


@boundary("BD-GRP-007")
def retries_under_other_variants(d: Draft) -> None:
    d.copy_attempt(STEER_LEFT, "g0.steer.b", attempt=1, protocol_variant="a")
    d.set("rollouts", "protocol_variant", "z", rollout_id=REPLAY)


# BD-GRP-008


@mutant("BD-GRP-008", at=_differs("simulator_version"), lost=0)
def simulator_updated_within_a_group(d: Draft) -> None:
    d.set("rollouts", "simulator_version", "other 2", rollout_id=STEER_LEFT)


@mutant("BD-GRP-008", at=_differs("collector_version"), lost=0)
def collector_updated_within_a_group(d: Draft) -> None:
    d.set("rollouts", "collector_version", "other 2", rollout_id=STEER_LEFT)


@boundary("BD-GRP-008")
def collector_updated_between_groups(d: Draft) -> None:
    d.set("rollouts", "collector_version", "other 2", group_id="g0")


# Several places: what violates a rule is counted


@mutant("BD-GRP-003", at={"group_id": "g2", "column": "seed"}, findings=2, lost=2)
def other_seeds_in_two_groups(d: Draft) -> None:
    d.set("rollouts", "seed", lambda seed: seed + 1, rollout_id=[*BOTH, STEER_LEFT])


@mutant("BD-BNK-001", at={"group_id": "g2"}, findings=2, lost=2)
def actions_missing_in_two_groups(d: Draft) -> None:
    for rollout_id in BOTH:
        d.drop_attempt(rollout_id)
