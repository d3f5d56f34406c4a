"""Defects and limits of replay noise against the nominal replays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
from tests.scenes import SCENES
from tests.synthetic import BRANCH_TICK, make_group
from tests.validator.engine.rules.case import BRAKE, NOMINAL, REPLAY, STEER_LEFT, boundary, mutant
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import TICK_TABLES


def declare(d: Draft, kind: str, **more: float) -> None:
    d.descriptor["collection"] = {**d.descriptor["collection"], "replay_noise": {"kind": kind, **more}}


def _copy(d: Draft, replay: str, nominal: str) -> None:
    for table in TICK_TABLES:
        d.drop(table, rollout_id=replay)
        d.duplicate(table, {"rollout_id": replay}, rollout_id=nominal)


def repeat_exactly(d: Draft, *noisy: str) -> None:
    """Let every replay repeat the drive of its nominal to the bit, until the branch, but for some nominal replays."""
    declare(d, "exact")
    before = Draft(d.tables, d.descriptor)
    for index, scene in enumerate(SCENES):
        d.replace_group(index, make_group(index, scene=replace(scene, noise=0.0)))
    for replay in noisy:
        folder = d.folder_of(replay)
        d.drop_attempt(replay)
        for table in ("rollouts", *TICK_TABLES):
            d.append(table, before.take(table, rollout_id=replay), folder=folder)


_REPLAYS = tuple(f"{group}.nominal_replay.a{attempt}" for group in ("g0", "g1", "g2") for attempt in (1, 2))


# BD-RPN-001


@mutant("BD-RPN-001", at={"table": "observations", "rollout_id": REPLAY}, findings=6)
def replays_differ_though_exact(d: Draft) -> None:
    repeat_exactly(d, *_REPLAYS)


@mutant("BD-RPN-001", at={"column": "speed_mps", "rollout_id": REPLAY, "tick": BRANCH_TICK})
def last_bit_of_one_speed_differs(d: Draft) -> None:
    repeat_exactly(d)
    d.set(
        "observations", "speed_mps", lambda v: float(np.nextafter(np.float32(v), np.float32(99))), rollout_id=REPLAY,
        tick=BRANCH_TICK,
    )  # fmt: skip
    d.refresh_evidence(REPLAY)


@mutant("BD-RPN-001", at={"rollout_id": REPLAY}, findings=6)
def nothing_is_declared(d: Draft) -> None:
    repeat_exactly(d, *_REPLAYS)
    del d.descriptor["collection"]["replay_noise"]


@mutant("BD-RPN-001", at={"table": "observations", "column": "target_speed_mps", "rollout_id": REPLAY, "tick": 200})
def replay_that_wants_another_speed(d: Draft) -> None:
    repeat_exactly(d)
    d.set("observations", "target_speed_mps", lambda v: v + 1.0, rollout_id=REPLAY, tick=200)


@mutant("BD-RPN-001", at={"table": "controls", "column": "expert_brake", "rollout_id": REPLAY, "tick": 0})
def replay_with_the_other_zero(d: Draft) -> None:
    repeat_exactly(d)
    d.set("controls", "expert_brake", -0.0, rollout_id=REPLAY, tick=0)


@mutant("BD-RPN-001", at={"table": "actors", "column": "height_m", "rollout_id": REPLAY})
def replay_with_a_higher_actor(d: Draft) -> None:
    repeat_exactly(d)
    d.set("actors", "height_m", lambda v: v + 0.01, rollout_id=REPLAY, actor_id=3)


@boundary("BD-RPN-001")
def exact_replays(d: Draft) -> None:
    repeat_exactly(d)


# BD-RPN-002


@mutant("BD-RPN-002", at={"rollout_id": REPLAY})
def replay_is_a_copy_under_injected_noise(d: Draft) -> None:
    declare(d, "injected", strength=0.5)
    _copy(d, REPLAY, NOMINAL)


@mutant("BD-RPN-002", at={"rollout_id": REPLAY}, findings=4)
def all_replays_of_a_shard_are_copies_under_natural_noise(d: Draft) -> None:
    for group in ("g0", "g1"):
        for attempt in (1, 2):
            _copy(d, f"{group}.nominal_replay.a{attempt}", f"{group}.nominal.a1")


@boundary("BD-RPN-002")
def one_replay_happens_to_be_equal_under_natural_noise(d: Draft) -> None:
    _copy(d, REPLAY, NOMINAL)


@boundary("BD-RPN-002")
def noise_moves_the_surroundings_alone(d: Draft) -> None:
    declare(d, "injected", strength=100)
    for replay in (REPLAY, "g0.nominal_replay.a2"):
        d.drop("observations", rollout_id=replay)
        d.duplicate("observations", {"rollout_id": replay}, rollout_id=NOMINAL)
        d.set("actors", "y_m", lambda v: v + 0.01, rollout_id=replay)
        d.refresh_evidence(replay)


# BD-RPN-005


def _move(d: Draft, metres: float) -> None:
    """Move the whole drive of an attempt along x, with its actors, and let what follows from its place follow."""
    for table in ("observations", "actors"):
        d.set(table, "x_m", lambda v: v + metres, rollout_id=BRAKE)
    d.reroute(BRAKE)
    d.refresh_evidence(BRAKE)


@mutant("BD-RPN-005", at={"rollout_id": BRAKE, "table": "observations", "column": "x_m", "tick": BRANCH_TICK - 80})
def drive_that_begins_six_metres_ahead(d: Draft) -> None:
    _move(d, 6.0)


@boundary("BD-RPN-005")
def drive_that_begins_four_metres_ahead(d: Draft) -> None:
    _move(d, 4.0)


# BD-RPN-003


@mutant(
    "BD-RPN-003",
    at={"table": "evidence", "column": "traffic_light_available", "rollout_id": BRAKE, "tick": BRANCH_TICK - 5},
)
def one_light_before_the_branch_tells_the_action(d: Draft) -> None:
    repeat_exactly(d)
    where = {"rollout_id": BRAKE, "tick": BRANCH_TICK - 5}
    light = d.value("evidence", "traffic_light", rollout_id=BRAKE, tick=BRANCH_TICK)
    d.set("evidence", "traffic_light_available", True, **where)
    d.set("evidence", "traffic_light", "red" if light != "red" else "green", **where)


@mutant("BD-RPN-003", at={"table": "controls", "column": "expert_brake", "rollout_id": BRAKE, "tick": BRANCH_TICK - 1})
def minus_zero_before_the_branch(d: Draft) -> None:
    repeat_exactly(d)
    d.set("controls", "expert_brake", -0.0, rollout_id=BRAKE, tick=BRANCH_TICK - 1)


@mutant("BD-RPN-003", at={"table": "controls", "column": "expert_steer", "rollout_id": STEER_LEFT, "tick": BRANCH_TICK})
def expert_that_steers_with_the_other_sign_while_it_is_overridden(d: Draft) -> None:
    repeat_exactly(d)
    for tick in range(BRANCH_TICK, BRANCH_TICK + 50):
        d.set("controls", "expert_steer", lambda steer: -steer, rollout_id=STEER_LEFT, tick=tick)


@boundary("BD-RPN-003")
def actors_in_another_order(d: Draft) -> None:
    repeat_exactly(d)
    folder = d.folder_of(BRAKE)

    def reverse(rows: pa.Table) -> pa.Table:
        own = np.array([rollout_id == BRAKE for rollout_id in rows["rollout_id"].to_pylist()])
        return pa.concat_tables([rows.filter(~own), rows.filter(own).take(np.arange(own.sum())[::-1])])

    d.map_table("actors", reverse, folder=folder)


@boundary("BD-RPN-003")
def histories_that_are_exact(d: Draft) -> None:
    repeat_exactly(d)


@boundary("BD-RPN-003")
def intervention_that_differs_from_the_branch_on(d: Draft) -> None:
    repeat_exactly(d)
    d.set("controls", "expert_brake", -0.0, rollout_id=BRAKE, tick=BRANCH_TICK)
