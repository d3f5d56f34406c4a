"""Defects and limits of single values, routes and boxes; `test_columns` goes through every column."""

from __future__ import annotations

import math

from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    REPLAY,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

NAN, INF = math.nan, math.inf


FAR_ACTOR = 7


def _place(table: str, column: str, rollout_id: str = BRAKE, **more: int) -> dict[str, str | int]:
    return {"table": table, "column": column, "rollout_id": rollout_id, **more}


# BD-VAL-001


@mutant("BD-VAL-001", at=_place("controls", "applied_steer", tick=110))
def nan_command(d: Draft) -> None:
    d.set("controls", "applied_steer", NAN, rollout_id=BRAKE, tick=110)


@mutant("BD-VAL-001", at=_place("observations", "x_m", tick=0))
def infinite_position(d: Draft) -> None:
    d.set("observations", "x_m", INF, rollout_id=BRAKE, tick=0)


@mutant("BD-VAL-001", at=_place("evidence", "separation_m", tick=BRANCH_TICK))
def nan_in_place_of_an_absent_value(d: Draft) -> None:
    d.set("evidence", "separation_m", NAN, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-VAL-001", at=_place("rollouts", "route_x_m"))
def nan_in_a_route(d: Draft) -> None:
    d.set("rollouts", "route_x_m", lambda xs: [*xs[:-1], NAN], rollout_id=BRAKE)


@mutant("BD-VAL-001", at=_place("rollouts", "route_y_m"))
def null_inside_a_route(d: Draft) -> None:
    d.set("rollouts", "route_y_m", lambda ys: [*ys[:-1], None], rollout_id=BRAKE)


@mutant("BD-VAL-001", at=_place("actors", "vel_x_mps", tick=50, actor_id=1))
def infinite_actor_velocity(d: Draft) -> None:
    d.set("actors", "vel_x_mps", -INF, rollout_id=BRAKE, tick=50, actor_id=1)


@boundary("BD-VAL-001")
def smallest_and_signed_zero_values(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", -0.0, rollout_id=BRAKE)
    d.set("observations", "accel_longitudinal_mps2", 1e-45, rollout_id=BRAKE, tick=5)


# BD-VAL-007


@mutant("BD-VAL-007", at=_place("observations", "accel_lateral_mps2", tick=BRANCH_TICK - 5))
def zero_with_a_sign(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", -0.0, rollout_id=BRAKE, tick=BRANCH_TICK - 5)


@mutant("BD-VAL-007", at=_place("rollouts", "route_y_m"))
def zero_with_a_sign_in_a_route(d: Draft) -> None:
    d.set("rollouts", "route_y_m", lambda ys: [-y if y == 0 else y for y in ys], rollout_id=BRAKE)


@boundary("BD-VAL-007")
def zeros_and_the_smallest_negative_number(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", 0.0, rollout_id=BRAKE)
    d.set("observations", "accel_longitudinal_mps2", -1e-45, rollout_id=BRAKE, tick=5)


# BD-VAL-002


@mutant("BD-VAL-002", at=_place("controls", "expert_throttle", tick=110))
def throttle_in_percent(d: Draft) -> None:
    d.set("controls", "expert_throttle", 30.0, rollout_id=BRAKE, tick=110)


@mutant("BD-VAL-002", at=_place("observations", "yaw_rad", tick=0))
def yaw_in_degrees(d: Draft) -> None:
    d.set("observations", "yaw_rad", 90.0, rollout_id=BRAKE, tick=0)


@mutant("BD-VAL-002", at=_place("rollouts", "route_x_m"))
def route_off_the_map(d: Draft) -> None:
    d.set("rollouts", "route_x_m", lambda xs: [*xs[:-1], 1.1e7], rollout_id=BRAKE)


@mutant("BD-VAL-002", at=_place("evidence", "ttc_s", tick=BRANCH_TICK))
def negative_sentinel(d: Draft) -> None:
    d.set("evidence", "ttc_s", -1.0, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-VAL-002", at=_place("rollouts", "attempt", REPLAY))
def attempts_counted_from_zero(d: Draft) -> None:
    d.set("rollouts", "attempt", 0, rollout_id=REPLAY)


@boundary("BD-VAL-002")
def values_at_both_ends_of_their_range(d: Draft) -> None:
    d.set("observations", "route_offset_m", 100000.0, rollout_id=BRAKE, tick=0)
    d.set("observations", "target_speed_mps", 0.0, rollout_id=BRAKE)
    d.set("observations", "route_heading_error_rad", math.pi, rollout_id=BRAKE, tick=0)
    d.set("observations", "route_heading_error_rad", -math.pi, rollout_id=BRAKE, tick=5)
    d.set("rollouts", "seed", 2**63 - 1, group_id="g2")
    d.set("rollouts", "repetition", 0, group_id="g2")


# BD-VAL-003


@mutant("BD-VAL-003", at=_place("controls", "source", tick=0))
def unknown_source(d: Draft) -> None:
    d.set("controls", "source", "autopilot", rollout_id=BRAKE, tick=0)


@mutant("BD-VAL-003", at=_place("observations", "command", tick=0))
def command_in_capitals(d: Draft) -> None:
    d.set("observations", "command", "LEFT", rollout_id=BRAKE, tick=0)


@mutant("BD-VAL-003", at=_place("actors", "actor_class", tick=0, actor_id=FAR_ACTOR))
def truck_as_a_class(d: Draft) -> None:
    d.set("actors", "actor_class", "truck", rollout_id=BRAKE, tick=0, actor_id=FAR_ACTOR)


@mutant("BD-VAL-003", at=_place("rollouts", "result_completion"))
def empty_word(d: Draft) -> None:
    d.set("rollouts", "result_completion", "", rollout_id=BRAKE)


@boundary("BD-VAL-003")
def every_word_of_a_vocabulary(d: Draft) -> None:
    for k, word in enumerate(("left", "right", "straight", "follow", "change_left", "change_right")):
        d.set("observations", "command", word, rollout_id=BRAKE, tick=5 * k)


# BD-VAL-004


@mutant("BD-VAL-004", at=_place("rollouts", "provenance"))
def line_break_in_text(d: Draft) -> None:
    d.set("rollouts", "provenance", "one line\nand another", rollout_id=BRAKE)


@mutant("BD-VAL-004", at=_place("rollouts", "simulator_version"))
def final_line_break(d: Draft) -> None:
    d.set("rollouts", "simulator_version", "1.0\n", rollout_id=BRAKE)


@mutant("BD-VAL-004", at=_place("rollouts", "protocol_variant"))
def identifier_in_capitals(d: Draft) -> None:
    d.set("rollouts", "protocol_variant", "V1", rollout_id=BRAKE)


@mutant("BD-VAL-004", at=_place("evidence", "lane_id", tick=5))
def empty_text(d: Draft) -> None:
    d.set("evidence", "lane_id", "", rollout_id=BRAKE, tick=5)


@mutant("BD-VAL-004", at=_place("frames", "file", NOMINAL, tick=BRANCH_TICK), base="media")
def media_file_outside_the_shard(d: Draft) -> None:
    d.set("frames", "file", "../media.bin", rollout_id=NOMINAL, camera="rear", tick=BRANCH_TICK)


@boundary("BD-VAL-004")
def shortest_and_longest_text(d: Draft) -> None:
    d.set("rollouts", "protocol_variant", "v" + "-" * 127, group_id="g0")
    d.set("rollouts", "provenance", "ü", rollout_id=BRAKE)
    d.set("rollouts", "result_termination", "0", rollout_id=BRAKE)
    d.set("rollouts", "provenance", "ü" * 1000, rollout_id=NOMINAL)
    d.set("rollouts", "provenance", "\U0001d54f" * 1000, rollout_id=REPLAY)  # two UTF-16 units each


@mutant("BD-VAL-004", at=_place("rollouts", "provenance"))
def text_of_too_many_code_points(d: Draft) -> None:
    d.set("rollouts", "provenance", "\U0001d54f" * 1001, rollout_id=BRAKE)


# BD-VAL-005


@mutant("BD-VAL-005", at=_place("rollouts", "route_x_m"))
def route_with_fewer_x_than_y(d: Draft) -> None:
    d.set("rollouts", "route_x_m", lambda xs: xs[:-1], rollout_id=BRAKE)


@mutant("BD-VAL-005", at=_place("rollouts", "route_x_m"))
def route_of_one_vertex(d: Draft) -> None:
    d.set("rollouts", ("route_x_m", "route_y_m"), [0.0], rollout_id=BRAKE)


@mutant("BD-VAL-005", at=_place("rollouts", "route_x_m"))
def route_without_vertices(d: Draft) -> None:
    d.set("rollouts", ("route_x_m", "route_y_m"), [], rollout_id=BRAKE)


@mutant("BD-VAL-005", at=_place("rollouts", "route_x_m"))
def route_that_stands_still(d: Draft) -> None:
    d.set("rollouts", ("route_x_m", "route_y_m"), lambda xs: [*xs, xs[-1]], rollout_id=BRAKE)


@boundary("BD-VAL-005", "BD-GRP-001")
def route_of_two_vertices(d: Draft) -> None:
    d.set("rollouts", ("route_x_m", "route_y_m"), lambda xs: [xs[0], xs[-1]], group_id="g0")


@boundary("BD-VAL-005")
def route_that_comes_back(d: Draft) -> None:
    # The way back is the same line, so the corridor is the same.
    d.set("rollouts", ("route_x_m", "route_y_m"), lambda xs: [*xs, *xs[-2::-1]], group_id="g0")
    d.set("rollouts", "result_route_fraction", lambda share: share / 2, group_id="g0")


# BD-VAL-006


@mutant("BD-VAL-006", at=_place("rollouts", "provenance"))
def provenance_with_a_path(d: Draft) -> None:
    d.set("rollouts", "provenance", "replayed from /srv/ada/runs/route.xml", rollout_id=BRAKE)


@mutant("BD-VAL-006", at=_place("rollouts", "provenance"))
def provenance_with_a_windows_path(d: Draft) -> None:
    d.set("rollouts", "provenance", r"log D:\runs\17", rollout_id=BRAKE)


@mutant("BD-VAL-006", at=_place("rollouts", "provenance"))
def provenance_with_a_time(d: Draft) -> None:
    d.set("rollouts", "provenance", "executed 2026-03-01T12:30:00Z", rollout_id=BRAKE)


@mutant("BD-VAL-006", at=_place("rollouts", "simulator_version"))
def version_with_a_host(d: Draft) -> None:
    d.set("rollouts", "simulator_version", "CARLA 0.9.15 10.0.0.7:2000", group_id="g0", rollout_id=BRAKE)


@boundary("BD-VAL-006")
def texts_that_look_like_paths_and_times(d: Draft) -> None:
    d.set("rollouts", "provenance", "maps/Town10/route 3, 5 km/h at 12:30, built 2026-03-01, see https://a.b/c/d")
    d.set("rollouts", "environment", "Clear/Noon 12:00")


# BD-BOX-001


@mutant("BD-BOX-001", at=_place("rollouts", "ego_width_m"))
def ego_without_width(d: Draft) -> None:
    d.set("rollouts", "ego_width_m", 0.0, rollout_id=BRAKE)


@mutant("BD-BOX-001", at=_place("rollouts", "ego_height_m"))
def ego_of_unknown_height(d: Draft) -> None:
    d.set("rollouts", "ego_height_m", NAN, rollout_id=BRAKE)


@mutant("BD-BOX-001", at=_place("actors", "length_m", tick=0, actor_id=1))
def half_extent_below_zero(d: Draft) -> None:
    d.set("actors", "length_m", -2.0, rollout_id=BRAKE, tick=0, actor_id=1)


@mutant("BD-BOX-001", at=_place("actors", "length_m", tick=0, actor_id=1))
def infinite_actor(d: Draft) -> None:
    d.set("actors", "length_m", INF, rollout_id=BRAKE, tick=0, actor_id=1)


@mutant("BD-BOX-001", at=_place("actors", "width_m", tick=0, actor_id=FAR_ACTOR))
def actor_in_centimetres(d: Draft) -> None:
    d.set("actors", "width_m", 175.0, rollout_id=BRAKE, tick=0, actor_id=FAR_ACTOR)


@boundary("BD-BOX-001")
def boxes_of_a_hundred_metres_and_of_a_hair(d: Draft) -> None:
    d.set("actors", "actor_class", "static", rollout_id=BRAKE, actor_id=[FAR_ACTOR, 1])
    d.set("actors", ("length_m", "width_m", "height_m"), 100.0, rollout_id=BRAKE, actor_id=FAR_ACTOR)
    d.set("actors", ("length_m", "width_m", "height_m"), 1e-6, rollout_id=BRAKE, actor_id=1)
    d.refresh_evidence(BRAKE)


# Several places: what violates a rule is counted


@mutant("BD-VAL-001", at={"rollout_id": BRAKE, "tick": 5}, findings=5)
def numbers_missing_in_five_rows_of_two_attempts(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", math.nan, rollout_id=BRAKE, tick=[5, 10, 15])
    d.set("observations", "accel_lateral_mps2", math.nan, rollout_id=FURTHER, tick=[5, 10])


@mutant("BD-VAL-002", at={"rollout_id": FURTHER, "tick": 0}, findings=402)
def every_brake_of_two_attempts_in_percent(d: Draft) -> None:
    d.set("controls", "expert_brake", 50.0, rollout_id=BOTH)


@mutant("BD-BOX-001", at={"rollout_id": FURTHER, "column": "ego_width_m"}, findings=2)
def two_egos_without_width(d: Draft) -> None:
    d.set("rollouts", "ego_width_m", 0.0, rollout_id=BOTH)
