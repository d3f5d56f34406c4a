"""Drives in the reference world: equal to recorded candidates, and the same however they were come by."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from branchdrive.collector.recording import Record
from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.policy import ACTUATORS
from branchdrive.model.arrays import pack_objects
from branchdrive.model.objects import object_columns
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.closed_loop.course import Course, Schedule, window_targets
from branchdrive_reference.closed_loop.reference_field import ReferenceField, ReferenceSite
from branchdrive_reference.closed_loop.sight import SensorNoise, Sight
from branchdrive_reference.closed_loop.site import Nominal
from branchdrive_reference.collect.campaign import collect
from branchdrive_reference.simulation.record import record
from branchdrive_reference.simulation.rollout import run

BANK = load_action_bank()
EXACT = SensorNoise(0.0, 1)
STEERS = BANK.keys.index("steer_left_0.10")
BRAKES = BANK.keys.index("brake_0.50")


@pytest.fixture(scope="module")
def driven() -> tuple[ReferenceSite, Nominal]:
    site = ReferenceField(("HardBrakeRoute",), {}).site(900, 0)
    nominal = site.nominal()
    assert isinstance(nominal, Nominal)
    return site, nominal


def course(
    driven: tuple[ReferenceSite, Nominal], num_decisions: int = 1, every: int = 50, noise: float = 0.0
) -> Course:
    return Course(*driven, BANK, Schedule(every, num_decisions), replay_noise=noise)


def kept(values: Any, rows: Any) -> list[Any]:
    listed = values.tolist() if isinstance(values, np.ndarray) else list(values)
    return [value for value, is_kept in zip(listed, rows.tolist(), strict=True) if is_kept]


def assert_same(one: Record, other: Record, until: int | None = None) -> None:
    """All recorded columns but those of the policy, up to a tick."""
    for table in ("observations", "evidence", "controls"):
        columns, expected = getattr(one, table), getattr(other, table)
        rows = [np.asarray(found["tick"]) <= (until or 10**9) for found in (columns, expected)]
        for name in columns:
            if not name.startswith(("active", "source", "nominal_", "intended_")):
                values = [kept(found[name], row) for found, row in zip((columns, expected), rows, strict=True)]
                assert values[0] == values[1], (table, name)


@pytest.mark.parametrize("place", [STEERS, BRAKES])
def test_a_drive_of_one_decision_is_the_recorded_candidate_bit_for_bit(driven: Any, place: int) -> None:
    site, nominal = driven
    policy = BANK.policies[place]
    recorded = record(run(site.plan.spec, policy, branch_tick=nominal.branch_tick, nominal=nominal.applied))
    found = course(driven).drive(lambda _: place, EXACT)
    assert found.choices == (place,) and found.ticks == (nominal.branch_tick,)
    assert_same(found.record, recorded)
    assert found.record.fields["result_completion"] == recorded.fields["result_completion"]


def test_the_first_window_of_any_schedule_is_the_recorded_one(driven: Any) -> None:
    _, nominal = driven
    once, often = (course(driven, number).drive(lambda _: STEERS, EXACT) for number in (1, 3))
    assert often.choices == (STEERS,) * 3
    assert_same(once.record, often.record, until=nominal.branch_tick + 49)
    applied = [np.asarray(found.record.controls["applied_steer"]) for found in (once, often)]
    assert applied[0][nominal.branch_tick + 60] != applied[1][nominal.branch_tick + 60]


def test_windows_of_the_bank_are_those_of_whole_drives(driven: Any) -> None:
    _, nominal = driven
    bank = course(driven).bank_targets()
    whole = window_targets(course(driven).drive(lambda _: BRAKES, EXACT).record, nominal.branch_tick)
    assert bank.values.shape == (len(BANK.keys), 6)
    np.testing.assert_array_equal(bank.values[BRAKES], whole.values[0])


def test_a_drive_is_the_same_alone_and_after_others(driven: Any) -> None:
    def choose(sight: Sight) -> int:
        if sight.number == 1:
            sight.look_ahead()  # which drives ahead, and must leave nothing behind
        return (STEERS, BRAKES, 0)[sight.number]

    shared = course(driven, 3)
    shared.bank_targets()
    shared.drive(lambda _: STEERS, EXACT)
    alone = course(driven, 3).drive(lambda sight: (STEERS, BRAKES, 0)[sight.number], EXACT)
    assert_same(shared.drive(choose, EXACT).record, alone.record)


def test_windows_of_a_later_decision_are_those_of_drives_that_decided_so(driven: Any) -> None:
    _, nominal = driven
    ahead = course(driven, 2).bank_targets((STEERS,))
    assert ahead.values.shape == (len(BANK.keys), 6) and ahead.available.any()
    for place in (BRAKES, STEERS, BANK.nominal_index):
        choices = iter((STEERS, place))
        whole = course(driven, 2).drive(lambda _, made=choices: next(made), EXACT)
        found = window_targets(whole.record, nominal.branch_tick + 50)
        np.testing.assert_array_equal(ahead.values[place], found.values[0])


def test_objects_of_the_first_decision_are_those_of_the_model_layer(driven: Any, tmp_path: Path) -> None:
    site, _ = driven
    seen: list[dict[str, Any]] = []

    def choose(sight: Sight) -> int:
        seen.append(sight.objects())
        return BANK.nominal_index

    course(driven, 2).drive(choose, EXACT)
    collect(tmp_path / "one", num_groups=1, seed=900, scenario_types=("HardBrakeRoute",))
    dataset = open_dataset(tmp_path / "one")
    (shard,) = dataset.shards
    view = ShardView({name: shard.decode(name) for name in dataset.descriptor.tables}, dataset.descriptor)
    frame = object_columns(view, np.flatnonzero(view.role("nominal")))
    expected = pack_objects(frame, [site.group_id])
    assert expected.available.any()
    np.testing.assert_array_equal(seen[0]["objects"], expected.values[0])
    np.testing.assert_array_equal(seen[0]["objects_mask"], expected.available[0])
    assert seen[1]["objects_mask"].any() and not np.array_equal(seen[0]["objects"], seen[1]["objects"])


def test_nominal_decisions_leave_the_nominal_pass(driven: Any) -> None:
    _, nominal = driven
    found = course(driven, 4).drive(lambda _: BANK.nominal_index, EXACT)
    applied = np.stack([np.asarray(found.record.controls[f"applied_{name}"]) for name in ACTUATORS], axis=1)
    np.testing.assert_array_equal(applied, nominal.applied)


def test_after_the_first_decision_the_expert_stands_in_for_the_stored_trace(driven: Any) -> None:
    _, nominal = driven
    copying = next(i for i, one in enumerate(BANK.policies) if "stored_nominal" in [rule.rule for rule in one.rules])
    name = next(
        actuator for actuator, rule in zip(ACTUATORS, BANK.policies[copying].rules, strict=True)
        if rule.rule == "stored_nominal"
    )  # fmt: skip
    found = course(driven, 2).drive(lambda _: copying, EXACT).record
    applied, expert = (np.asarray(found.controls[f"{kind}_{name}"]) for kind in ("applied", "expert"))
    first = slice(nominal.branch_tick, nominal.branch_tick + 50)
    second = slice(nominal.branch_tick + 50, nominal.branch_tick + 100)
    np.testing.assert_array_equal(applied[first], nominal.applied[first, ACTUATORS.index(name)])
    np.testing.assert_array_equal(applied[second], expert[second])


def test_noise_changes_a_drive_and_is_shared_by_selectors(driven: Any) -> None:
    exact, noisy = (course(driven, noise=noise).drive(lambda _: BRAKES, EXACT).record for noise in (0.0, 1.0))
    assert not np.array_equal(exact.observations["x_m"], noisy.observations["x_m"])
    again = course(driven, noise=1.0).drive(lambda _: BRAKES, EXACT).record
    assert_same(noisy, again)


def test_sensor_noise_changes_what_is_seen_and_not_the_drive(driven: Any) -> None:
    seen: list[Sight] = []

    def choose(sight: Sight) -> int:
        seen.append(sight)
        return 0

    clean, noisy, again = (
        course(driven).drive(choose, noise) for noise in (EXACT, SensorNoise(1.0, 7), SensorNoise(1.0, 7))
    )
    states = [sight.history()["state"] for sight in seen]
    assert not np.array_equal(states[0], states[1])
    np.testing.assert_array_equal(states[1], states[2])
    np.testing.assert_array_equal(seen[0].history()["controls"], seen[1].history()["controls"])
    assert_same(clean.record, noisy.record)
    assert_same(noisy.record, again.record)
