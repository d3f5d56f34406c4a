"""Defects and limits of the windows before and after the branch, and of the recorded actors."""

from __future__ import annotations

from tests.synthetic import BRANCH_TICK, STRIDE, WINDOW_TICKS, make_group, plans
from tests.validator.engine.rules.case import BRAKE, NOMINAL, boundary, mutant
from tests.validator.engine.rules.draft import Draft

END = BRANCH_TICK + WINDOW_TICKS


FAR_ACTOR = 7


def _branch_early(d: Draft) -> None:
    d.replace_group(2, make_group(2, plans(2, branch_tick=75)))


mutant("BD-WIN-001", at={"group_id": "g2", "table": "controls"}, findings=15, name="branch_within_the_first_80_ticks")(
    _branch_early
)
mutant(
    "BD-WIN-002",
    at={"group_id": "g2", "table": "observations", "tick": -STRIDE},
    findings=15,
    name="branch_without_a_predecessor",
)(_branch_early)


# BD-WIN-003


def _cut(d: Draft, rollout_id: str, *, last_control: int, last_observation: int) -> None:
    shard = d.tables[d.folder_of(rollout_id)]
    d.drop("controls", rollout_id=rollout_id, tick=range(last_control + 1, 201))
    for table in [name for name in ("observations", "actors", "evidence") if name in shard]:
        d.drop(table, rollout_id=rollout_id, tick=range(last_observation + 1, 201))
    d.recount(rollout_id)


@mutant("BD-WIN-003", at={"rollout_id": NOMINAL, "table": "controls"})
def no_control_at_the_end_of_the_window(d: Draft) -> None:
    _cut(d, NOMINAL, last_control=END - 1, last_observation=END)


@mutant("BD-WIN-003", at={"rollout_id": NOMINAL, "table": "observations", "tick": END}, base="bare")
def no_observation_at_the_end_of_the_window(d: Draft) -> None:
    _cut(d, NOMINAL, last_control=END - 1, last_observation=END - STRIDE)


# BD-WIN-004


@mutant("BD-WIN-004", at={"rollout_id": BRAKE, "table": "evidence", "tick": BRANCH_TICK})
def no_evidence_at_the_branch(d: Draft) -> None:
    d.drop("evidence", rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-WIN-004", at={"rollout_id": BRAKE, "table": "evidence", "tick": BRANCH_TICK - 75})
def no_evidence_at_the_first_frame(d: Draft) -> None:
    d.drop("evidence", rollout_id=BRAKE, tick=BRANCH_TICK - 75)


@mutant("BD-WIN-004", at={"rollout_id": NOMINAL, "table": "evidence", "tick": END})
def no_evidence_at_the_last_frame(d: Draft) -> None:
    d.drop("evidence", rollout_id=NOMINAL, tick=END)


@mutant("BD-WIN-004", at={"rollout_id": BRAKE, "table": "evidence", "tick": BRANCH_TICK - 75})
def no_evidence_at_all(d: Draft) -> None:
    d.drop("evidence", rollout_id=BRAKE)


@boundary("BD-WIN-004", "BD-WIN-005")
def evidence_of_the_window_alone(d: Draft) -> None:
    outside = [tick for tick in range(0, 201, STRIDE) if not BRANCH_TICK - 75 <= tick <= END]
    d.drop("evidence", rollout_id=BRAKE, tick=outside)


# BD-WIN-005


@mutant("BD-WIN-005", at={"rollout_id": BRAKE, "table": "actors", "tick": BRANCH_TICK})
def far_actor_lost(d: Draft) -> None:
    d.drop("actors", rollout_id=BRAKE, tick=BRANCH_TICK, actor_id=FAR_ACTOR)


@mutant("BD-WIN-005", at={"rollout_id": BRAKE, "table": "actors", "tick": 50})
def far_actor_not_counted(d: Draft) -> None:
    d.duplicate("actors", {"actor_id": 99, "length_m": 5.0}, rollout_id=BRAKE, tick=50, actor_id=FAR_ACTOR)


@mutant("BD-WIN-005", at={"rollout_id": "g2.nominal.a1", "table": "actors", "tick": 65})
def actor_counted_in_an_empty_frame(d: Draft) -> None:
    d.set("evidence", "num_actors", 1, rollout_id="g2.nominal.a1", tick=65)


@boundary("BD-WIN-005", "BD-EVD-001", "BD-EVD-002", "BD-EVD-003")
def nobody_ever_near(d: Draft) -> None:
    d.drop("actors", rollout_id=BRAKE)
    d.set("observations", "pedestrian_hazard", False, rollout_id=BRAKE)
    d.set("evidence", "num_actors", 0, rollout_id=BRAKE)
    for name, columns in (
        ("separation", ("separation_m", "separation_actor_id")),
        ("ttc", ("ttc_s", "ttc_actor_id")),
        ("nearest_vehicle", ("nearest_vehicle_gap_m", "nearest_vehicle_rel_speed_mps")),
        ("nearest_pedestrian", ("nearest_pedestrian_gap_m",)),
    ):
        d.set("evidence", f"{name}_available", False, rollout_id=BRAKE)
        d.set("evidence", columns, None, rollout_id=BRAKE)
