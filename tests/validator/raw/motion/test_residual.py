"""Residuals of motion and tracks of actors on drives whose answers are known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.synthetic import base_tables, descriptor
from tests.validator.engine.rules.case import BRAKE, SHARD_0, new_draft
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.descriptor import Descriptor
from branchdrive.raw.motion.contact import is_free, knows_contacts, touches
from branchdrive.raw.motion.prevalence import broken_relations, num_in_contact
from branchdrive.raw.motion.residual import displacement, lateral, longitudinal, turn
from branchdrive.raw.motion.route_state import contradicts_route, last_progress_m, misplaces_target_points
from branchdrive.raw.motion.tracks import actor_displacements, tracks
from branchdrive.raw.shard_view import ShardView


def view_of(tables: Mapping[str, pa.Table]) -> ShardView:
    return ShardView(tables, Descriptor.model_validate(descriptor()))


def edited(*edits: tuple[str, str, Any, dict[str, Any]]) -> ShardView:
    draft = new_draft()
    for table, column, value, where in edits:
        draft.set(table, column, value, rollout_id=BRAKE, **where)
    return view_of(draft.tables[SHARD_0])


def of_brake(view: ShardView, values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Values of the observations of one attempt, in order of ticks."""
    return np.asarray(values)[view.observations.rollout == view.rollout_ids.index(BRAKE)]


@pytest.fixture(scope="module")
def base() -> ShardView:
    return view_of(base_tables()[SHARD_0])


def test_sound_drives_stay_below_the_bounds(base: ShardView) -> None:
    residuals = [relation(base).residual for relation in (displacement, turn, longitudinal, lateral)]
    assert [bool(np.nanmax(values) < most) for values, most in zip(residuals, (0.5, 0.15, 7.5, 5), strict=True)] == [
        True
    ] * 4
    assert np.isnan(displacement(base).residual[base.observations.tick == 0]).all()
    assert not contradicts_route(base).any()
    assert not misplaces_target_points(base).any()


def test_residuals_are_those_of_the_formulas() -> None:
    view = edited(
        ("observations", "speed_mps", lambda v: v + 8.0, {"tick": 100}),
        ("observations", "yaw_rate_radps", lambda v: v + 0.8, {"tick": 100}),
    )
    base = view_of(base_tables()[SHARD_0])
    change = [
        of_brake(view, of(view).residual)[20:22] - of_brake(base, of(base).residual)[20:22]
        for of in (displacement, turn, longitudinal)
    ]
    assert np.abs(change[0] - 1.0).max() < 0.1  # 8 m/s in one of two observations, 0.25 s apart
    assert np.abs(change[1] - 0.1).max() < 0.01
    assert np.abs(change[2] - 32.0).max() < 4
    found = of_brake(view, lateral(view).residual)[20]
    speed = of_brake(view, view.observations["speed_mps"])[20]
    assert math.isclose(found, 0.8 * speed, rel_tol=0.1)


def test_a_contact_ends_relations_for_two_seconds(base: ShardView) -> None:
    view = edited(("evidence", "collision", True, {"tick": [100, 110]}))
    free = of_brake(view, is_free(view))
    assert free.tolist() == [True] * 20 + [False] * 11 + [True] * 10
    assert np.isfinite(of_brake(view, displacement(view).residual)).tolist() == [False] + [True] * 40
    others = view.observations.rollout != view.rollout_ids.index(BRAKE)
    assert (is_free(view) == is_free(base))[others].all()
    rows = actor_displacements(view).row
    stream = view.stream("actors")
    assert stream.tick[rows][stream.rollout[rows] == view.rollout_ids.index(BRAKE)].max() == 150


def test_a_contact_of_one_attempt_ends_with_it() -> None:
    view = edited(("evidence", "collision", True, {"tick": 200}))
    after = view.rollout_ids.index(BRAKE) + 1
    first = view.observations.start[after]
    assert touches(view)[first - 1]
    assert is_free(view)[first] == (not touches(view)[first])


def test_without_evidence_contacts_are_known_where_all_kinds_were_monitored_and_none_is_counted() -> None:
    tables = {name: rows for name, rows in base_tables()[SHARD_0].items() if name not in ("actors", "evidence")}
    draft = Draft({SHARD_0: tables}, descriptor())
    draft.set("rollouts", "result_num_static_collisions", None, rollout_id=BRAKE)
    document = descriptor()
    document["streams"].remove("actor_risk_evidence")
    view = ShardView(draft.tables[SHARD_0], Descriptor.model_validate(document))
    assert is_free(view).all()
    unknown = {
        rollout_id for rollout_id, known in zip(view.rollout_ids, knows_contacts(view), strict=True) if not known
    }
    rows = draft.take("rollouts").to_pylist()
    kinds = [f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static")]
    assert unknown == {BRAKE, *(row["rollout_id"] for row in rows if any(row[kind] for kind in kinds))}


def test_relations_are_counted_in_contacts_too() -> None:
    view = edited(
        ("evidence", "collision", True, {}),
        ("observations", "accel_lateral_mps2", 99.0, {"tick": 100}),
        ("actors", "vel_x_mps", 99.0, {"tick": 100}),
    )
    every = np.ones(view.num_rollouts, bool)
    found = broken_relations(view, every)
    assert found["BD-MOT-003"] == (1, view.num_rollouts)
    assert found["BD-MOT-001"] == (0, view.num_rollouts)
    assert found["BD-ACT-004"][0] == 1
    assert broken_relations(view, ~every) == dict.fromkeys(found, (0, 0))
    assert num_in_contact(view, every)[1] == view.num_rollouts


def test_tracks_follow_every_actor_in_any_order_of_rows(base: ShardView) -> None:
    draft = new_draft()
    order = np.random.default_rng(3).permutation(len(draft.tables[SHARD_0]["actors"]))
    draft.map_table("actors", lambda rows: rows.take(pa.array(order)), folder=SHARD_0)
    for view in (base, view_of(draft.tables[SHARD_0])):
        stream = view.stream("actors")
        row, previous, resumed, _ = tracks(view)
        followed = row[previous >= 0]
        before = previous[previous >= 0]
        assert (stream["actor_id"][followed] == stream["actor_id"][before]).all()
        assert (stream.rollout[followed] == stream.rollout[before]).all()
        assert set(stream.tick[followed] - stream.tick[before]) == {5}
        assert set(stream.tick[row]) == set(range(25, 151, 5))
        assert not len(resumed)
        first = stream.tick[row[previous < 0]]
        assert set(first) == {25, 130}  # the windows begin, and one pedestrian appears


def test_a_track_resumes_after_a_gap() -> None:
    draft = new_draft()
    draft.drop("actors", rollout_id=BRAKE, actor_id=[1, 3], tick=[60, 65])
    draft.drop("actors", rollout_id=BRAKE, actor_id=3, tick=range(70, 201))
    view = view_of(draft.tables[SHARD_0])
    stream, (*_, resumed, left) = view.stream("actors"), tracks(view)
    assert [(stream["actor_id"][k], stream.tick[k]) for k in (*resumed, *left)] == [(1, 70), (1, 55)]


def test_progress_and_length_of_routes(base: ShardView) -> None:
    furthest, length = last_progress_m(base)
    own = base.observations.rollout == 0
    assert furthest[0] == base.observations["route_progress_m"][own].max()
    assert length[0] == pytest.approx(160.0)
    view = edited(("rollouts", "route_x_m", [0.0], {}))
    assert np.isnan(last_progress_m(view)[1]).tolist() == [i == BRAKE for i in view.rollout_ids]
