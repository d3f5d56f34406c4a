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
from branchdrive.raw.motion import before_contact, displacement_m, lateral_mps2, longitudinal_mps2, turn_rad
from branchdrive.raw.route_state import contradicts_route, last_progress_m, misplaces_target_points
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.tracks import actor_displacement_m, tracks


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
    residuals = (displacement_m(base), turn_rad(base), longitudinal_mps2(base), lateral_mps2(base))
    assert [bool(np.nanmax(values) < most) for values, most in zip(residuals, (0.5, 0.15, 7.5, 5), strict=True)] == [
        True
    ] * 4
    assert np.isnan(displacement_m(base)[base.observations.tick == 0]).all()
    assert not contradicts_route(base).any()
    assert not misplaces_target_points(base).any()


def test_residuals_are_those_of_the_formulas() -> None:
    view = edited(
        ("observations", "speed_mps", lambda v: v + 8.0, {"tick": 100}),
        ("observations", "yaw_rate_radps", lambda v: v + 0.8, {"tick": 100}),
    )
    base = view_of(base_tables()[SHARD_0])
    change = [
        of_brake(view, after(view))[20:22] - of_brake(base, after(base))[20:22]
        for after in (displacement_m, turn_rad, longitudinal_mps2)
    ]
    assert np.abs(change[0] - 1.0).max() < 0.1  # 8 m/s in one of two observations, 0.25 s apart
    assert np.abs(change[1] - 0.1).max() < 0.01
    assert np.abs(change[2] - 32.0).max() < 4
    lateral = of_brake(view, lateral_mps2(view))[20]
    speed = of_brake(view, view.observations["speed_mps"])[20]
    assert math.isclose(lateral, 0.8 * speed, rel_tol=0.1)


def test_nothing_is_compared_from_the_first_contact_on() -> None:
    view = edited(("evidence", "collision", True, {"tick": 100}))
    free = of_brake(view, before_contact(view))
    assert free.tolist() == [True] * 20 + [False] * 21
    assert np.isfinite(of_brake(view, displacement_m(view))).tolist() == [False, *free[1:].tolist()]
    rows, *_ = actor_displacement_m(view)
    stream = view.stream("actors")
    mine = stream.rollout[rows] == view.rollout_ids.index(BRAKE)
    assert stream.tick[rows][mine].max() == 95


def test_without_evidence_only_attempts_without_collisions_are_compared() -> None:
    tables = {name: rows for name, rows in base_tables()[SHARD_0].items() if name not in ("actors", "evidence")}
    draft = Draft({SHARD_0: tables}, descriptor())
    draft.set("rollouts", "result_num_static_collisions", None, rollout_id=BRAKE)
    document = descriptor()
    document["streams"].remove("actor_risk_evidence")
    view = ShardView(draft.tables[SHARD_0], Descriptor.model_validate(document))
    assert not of_brake(view, before_contact(view)).any()
    assert before_contact(view).any()


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
