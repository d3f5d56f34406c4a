"""Drives and their records: what moves the world is what is recorded, and rates are those of the tick before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.validator.collector.straight import BrittleRoad, EmptyRoad, ShortRoad

import branchdrive as bd
from branchdrive.collector.drive import drive
from branchdrive.collector.record import record

BANK = bd.load_action_bank()
RUN = drive(ShortRoad(), 1, BANK.nominal, max_ticks=600)
RECORD = record(RUN)


class Watched(ShortRoad):
    """Keeps the commands that it is stepped with."""

    def reset(self, seed: int) -> bd.Scene:
        self.commands: list[tuple[float, ...]] = []
        return super().reset(seed)

    def step(self, command: bd.Command) -> None:
        self.commands.append(tuple(map(float, command)))
        super().step(command)


def test_the_world_is_driven_with_the_recorded_values() -> None:
    world = Watched()
    recorded = record(drive(world, 1, BANK.nominal, max_ticks=600))
    applied = np.stack([recorded.controls[f"applied_{name}"] for name in ("steer", "throttle", "brake")], axis=1)
    assert applied.dtype == np.float32
    assert applied.astype(float).tolist() == [list(command) for command in world.commands]


def test_a_drive_ends_at_the_end_of_its_route_at_a_saved_observation() -> None:
    assert (RUN.completion, RUN.termination) == ("completed", "end of route")
    assert RUN.num_ticks % 5 == 0
    assert RECORD.observations["tick"][-1] == RUN.num_ticks
    assert RECORD.fields["result_route_fraction"] == 1.0


def test_a_route_is_given_up_in_time() -> None:
    run = drive(ShortRoad(), 1, BANK.nominal, max_ticks=42)
    assert (run.num_ticks, run.completion) == (45, "timeout")
    assert 0.1 < record(run).fields["result_route_fraction"] < 0.3


def test_rates_are_of_the_tick_before_and_zero_at_first() -> None:
    speed = np.array([ego.speed_mps for ego in RUN.observations])
    recorded = RECORD.observations["accel_longitudinal_mps2"]
    assert recorded[0] == 0.0
    assert recorded[1:] == pytest.approx(np.diff(speed)[4::5] / 0.05, abs=1e-4)


def test_rates_of_the_world_are_taken_where_it_has_them() -> None:
    run = replace(RUN, observations=[replace(ego, yaw_rate_radps=0.5) for ego in RUN.observations])
    columns = record(run).observations
    assert columns["yaw_rate_radps"].tolist() == [0.0, *[0.5] * (len(columns["tick"]) - 1)]


def test_headings_are_wrapped_in_tables_and_rates() -> None:
    turning = [replace(ego, yaw_rad=3.14 + 0.001 * tick) for tick, ego in enumerate(RUN.observations)]
    columns = record(replace(RUN, observations=turning)).observations
    assert np.abs(columns["yaw_rad"]).max() <= np.float32(np.pi)
    assert columns["yaw_rate_radps"][1:] == pytest.approx(0.02, abs=1e-4)


def test_contacts_between_observations_are_collisions_counted_once() -> None:
    touching = [
        replace(ego, contacts=[1] if 21 <= tick <= 27 or tick == 60 else [])
        for tick, ego in enumerate(RUN.observations)
    ]
    recorded = record(replace(RUN, observations=touching))
    assert np.flatnonzero(recorded.evidence["collision"]).tolist() == [5, 6, 12]
    assert recorded.fields["result_num_vehicle_collisions"] == 2
    assert recorded.fields["result_num_pedestrian_collisions"] == 0


def test_contact_with_nobody_is_refused() -> None:
    touching = [replace(ego, contacts=[99]) for ego in RUN.observations]
    with pytest.raises(bd.UsageError, match=r"contact with \[99\] at tick 0, and `actors` never listed them"):
        record(replace(RUN, observations=touching))


def test_evidence_needs_to_know_the_road() -> None:
    blind = replace(RUN, observations=[replace(ego, on_road=None) for ego in RUN.observations])
    with pytest.raises(bd.UsageError, match="on_road"):
        record(blind)
    assert record(blind, has_evidence=False).fields["result_num_off_road_infractions"] == 0


def test_a_map_says_what_the_world_leaves_open() -> None:
    open_run = replace(
        RUN, observations=[replace(e, on_road=None, lane_id=None, speed_limit_mps=None) for e in RUN.observations]
    )
    y_m = RUN.observations[0].y_m
    lane = bd.lane_element("a", [0.0, 40.0], [y_m, y_m], 3.5, 9.0)
    recorded = record(open_run, town=[lane])
    is_on = recorded.observations["x_m"] <= 40.0
    assert recorded.evidence["on_road"][: is_on.sum()].all() and not recorded.evidence["on_road"][-1]
    assert recorded.evidence["lane_id"][0] == "a" and recorded.evidence["lane_id"][-1] is None
    assert set(recorded.observations["speed_limit_mps"]) == {np.float32(9.0)}
    assert recorded.fields["result_num_off_road_infractions"] == 1


def test_a_failed_simulator_leaves_a_partial_drive() -> None:
    world = BrittleRoad()
    world.failing = (1,)
    run = drive(world, 1, BANK.nominal, max_ticks=600)
    assert (run.num_ticks, run.completion, run.partial_because) == (100, "aborted", "the server is gone")
    fields = record(run).fields
    assert (fields["status"], fields["status_reason"]) == ("partial", "the server is gone")


def test_without_a_manoeuvre_the_trigger_finds_nothing() -> None:
    run = drive(EmptyRoad(), 1, BANK.nominal, max_ticks=600)
    assert bd.brake_trigger("x 1").evaluate(run.trace) is None
    branch = bd.brake_trigger("x 1").evaluate(RUN.trace)
    assert branch is not None and branch.branch_tick >= 80
