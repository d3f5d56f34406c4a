"""Defects and limits of maps: elements, towns, and what lies under the ego."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import BRAKE, SHARD_1, boundary, mutant
from tests.validator.engine.rules.draft import Draft

TOWN = "Town13"
"""Driven in one shard alone, so that its map may change there."""


ROAD = "road1:-1"
"""The lane of every route."""


SLACK_M = 0.05


def far(kind: str, **more: Any) -> dict[str, Any]:
    return {"table": "map", "town": TOWN, "element_id": f"far-{kind}", **more}


def edit(d: Draft, element_id: str, **columns: Any) -> None:
    for column, value in columns.items():
        d.set("map", column, value, town=TOWN, element_id=element_id)


# BD-MAP-001


@mutant("BD-MAP-001", at=far("lane"))
def fewer_y_than_x(d: Draft) -> None:
    edit(d, "far-lane", y_m=[0.0, 0.0])


@mutant("BD-MAP-001", at=far("lane"))
def one_width_for_all_vertices(d: Draft) -> None:
    edit(d, "far-lane", width_m=[3.5])


@mutant("BD-MAP-001", at=far("signal"))
def heights_of_other_vertices(d: Draft) -> None:
    edit(d, "far-signal", z_m=[4.0, 4.0])


@mutant("BD-MAP-001", at=far("lane"))
def lane_without_widths(d: Draft) -> None:
    edit(d, "far-lane", width_m=None)


@mutant("BD-MAP-001", at=far("lane"))
def lane_without_a_name(d: Draft) -> None:
    edit(d, "far-lane", lane_id=None)


@mutant("BD-MAP-001", at=far("shoulder"))
def shoulder_without_widths(d: Draft) -> None:
    edit(d, "far-shoulder", width_m=None)


@mutant("BD-MAP-001", at=far("wall"))
def wall_of_one_vertex(d: Draft) -> None:
    edit(d, "far-wall", x_m=[0.0], y_m=[0.0])


@mutant("BD-MAP-001", at=far("wall"))
def wall_that_stands_still(d: Draft) -> None:
    edit(d, "far-wall", x_m=[0.0, 1.0, 1.0], y_m=[0.0, 1.0, 1.0])


@mutant("BD-MAP-001", at=far("crossing"))
def outline_of_two_vertices(d: Draft) -> None:
    edit(d, "far-crossing", x_m=[0.0, 1.0], y_m=[0.0, 1.0])


@mutant("BD-MAP-001", at=far("crossing"))
def outline_closed_twice(d: Draft) -> None:
    edit(d, "far-crossing", x_m=[0.0, 1.0, 1.0, 0.0], y_m=[0.0, 0.0, 1.0, 0.0])


@mutant("BD-MAP-001", at=far("signal"))
def signal_drawn_as_a_line(d: Draft) -> None:
    edit(d, "far-signal", x_m=[0.0, 1.0], y_m=[0.0, 1.0], z_m=None)


@mutant("BD-MAP-001", at={"table": "map", "town": TOWN, "element_id": "lane-1"})
def lane_under_the_ego_without_widths(d: Draft) -> None:
    """The lane under the ego has no widths, and evidence names it: nothing asks for a lane and a road."""
    edit(d, "lane-1", width_m=None)
    d.drop("map", town=TOWN, element_id="ground-1")


@mutant("BD-MAP-001", at={"table": "map", "town": "Town12", "element_id": "lane-0"}, findings=2)
def lane_below_a_bridge_without_widths(d: Draft) -> None:
    """The only road below a bridge has no widths, so that nothing says that the rail is of another level."""
    rail_of_a_bridge_over_the_road(d)
    d.set("map", "width_m", None, town="Town12", element_id="lane-0")
    d.drop("map", town="Town12", element_id="ground-0")


@boundary("BD-MAP-001")
def elements_of_the_fewest_vertices(d: Draft) -> None:
    edit(d, "far-lane", x_m=[0.0, 0.0], y_m=[5000.0, 5000.1], width_m=[0.01, 100.0], z_m=[0.0, -3.0])
    edit(d, "far-crossing", x_m=[0.0, 1.0, 0.0], y_m=[0.0, 0.0, 1.0])


# BD-MAP-002


@mutant("BD-MAP-002", at=far("wall", column="element_id"))
def element_written_twice(d: Draft) -> None:
    d.duplicate("map", town=TOWN, element_id="far-wall")


@boundary("BD-MAP-002")
def element_ids_shared_by_two_towns(d: Draft) -> None:
    assert len(d.take("map", element_id="far-wall")) == 3  # Town12 is in both shards


# BD-MAP-003


@mutant("BD-MAP-003", at={"table": "rollouts", "column": "town", "rollout_id": "g1.nominal.a1"}, findings=16)
def town_without_lanes(d: Draft) -> None:
    d.drop("map", town=TOWN, kind="lane")


@boundary("BD-MAP-003")
def map_of_a_town_that_nobody_drives_in(d: Draft) -> None:
    d.duplicate("map", {"town": "Town99"}, town=TOWN)


# BD-MAP-004


@mutant("BD-MAP-004", at={"table": "map", "town": "Town12"})
def limit_changed_in_one_shard(d: Draft) -> None:
    def changed(rows: pa.Table) -> pa.Table:
        limits = pc.if_else(
            pc.equal(rows["element_id"], "far-lane"), pa.scalar(8.0, pa.float32()), rows["speed_limit_mps"]
        )
        place = rows.schema.get_field_index("speed_limit_mps")
        return rows.set_column(place, rows.schema.field(place), limits)

    d.map_table("map", changed, folder=SHARD_1)


@boundary("BD-MAP-004")
def maps_in_another_order(d: Draft) -> None:
    d.map_table("map", lambda rows: rows.take(np.arange(len(rows))[::-1]), folder=SHARD_1)


# BD-MAP-005: the first route runs along x, so that a lane's edges lie beside it at half its width.

HERE = {"rollout_id": BRAKE, "tick": BRANCH_TICK}


def _place(table: str, column: str, **more: Any) -> dict[str, Any]:
    return {"table": table, "column": column, **HERE, **more}


def _narrow(d: Draft, beyond_m: float) -> dict[str, Any]:
    """Make the first lane so narrow that the outermost centre of its group lies beyond its edge; that observation."""
    rows = d.take("observations", rollout_id=d.take("rollouts", group_id="g0")["rollout_id"].to_pylist())
    offsets = np.abs(rows["y_m"].to_numpy())
    outermost = int(offsets.argmax())
    width_m = 2 * (offsets[outermost] - beyond_m)
    d.set("map", "width_m", lambda widths: [width_m] * len(widths), element_id="lane-0")
    return {name: rows[name][outermost].as_py() for name in ("rollout_id", "tick")}


@mutant("BD-MAP-005", at=_place("evidence", "lane_id"))
def lane_of_another_name(d: Draft) -> None:
    d.set("evidence", "lane_id", "far", **HERE)


@mutant("BD-MAP-005", at=_place("evidence", "lane_id"))
def lane_that_no_map_has(d: Draft) -> None:
    d.set("evidence", "lane_id", "nowhere", **HERE)


@mutant("BD-MAP-005", at=_place("evidence", "lane_id"))
def lane_left_out(d: Draft) -> None:
    d.set("evidence", "lane_id", None, **HERE)


@mutant("BD-MAP-005", at={"table": "evidence", "column": "lane_id"})
def centre_beyond_the_edge_and_its_slack(d: Draft) -> None:
    _narrow(d, 1.1 * SLACK_M)


@boundary("BD-MAP-005", "BD-MAP-006", "BD-MAP-007")
def centre_beyond_the_edge_within_the_slack(d: Draft) -> None:
    _narrow(d, 0.9 * SLACK_M)
    d.drop("map", element_id="ground-0")


@boundary("BD-MAP-005", "BD-MAP-006")
def centre_inside_the_edge_and_recorded_outside(d: Draft) -> None:
    here = _narrow(d, -0.9 * SLACK_M)
    d.drop("map", element_id="ground-0")
    d.set("evidence", "lane_id", None, **here)
    d.set("evidence", "on_road", False, **here)
    d.set("rollouts", "result_num_off_road_infractions", 1, rollout_id=here["rollout_id"])


@boundary("BD-MAP-005")
def either_of_two_lanes_that_overlap(d: Draft) -> None:
    d.duplicate("map", {"element_id": "over-0", "lane_id": "over"}, element_id="lane-0")
    d.set("evidence", "lane_id", "over", **HERE)


# BD-MAP-006


@mutant("BD-MAP-006", at=_place("evidence", "on_road"))
def road_left_out(d: Draft) -> None:
    d.set("evidence", "on_road", False, **HERE)


@mutant("BD-MAP-006", at={"table": "evidence", "column": "on_road"})
def road_where_no_surface_is(d: Draft) -> None:
    here = _narrow(d, 1.1 * SLACK_M)
    d.drop("map", element_id="ground-0")
    d.set("evidence", "lane_id", None, **here)


@boundary("BD-MAP-006")
def road_beside_the_lanes(d: Draft) -> None:
    here = _narrow(d, 1.1 * SLACK_M)
    d.set("evidence", "lane_id", None, **here)


# BD-MAP-007


@mutant("BD-MAP-007", at=_place("observations", "speed_limit_mps"))
def limit_of_no_lane(d: Draft) -> None:
    d.set("observations", "speed_limit_mps", 13.52, **HERE)


@boundary("BD-MAP-007")
def limit_rounded_to_two_decimals(d: Draft) -> None:
    d.set("observations", "speed_limit_mps", 13.509, **HERE)


@boundary("BD-MAP-007")
def limit_of_one_of_two_lanes(d: Draft) -> None:
    d.duplicate("map", {"element_id": "over-0", "lane_id": "over", "speed_limit_mps": 8.0}, element_id="lane-0")
    d.set("observations", "speed_limit_mps", 8.0, **HERE)


@boundary("BD-MAP-007")
def limit_of_a_lane_where_it_is_unknown(d: Draft) -> None:
    d.set("map", "speed_limit_mps", None, element_id="lane-0")
    d.set("observations", "speed_limit_mps", 25.0, **HERE)


# BD-MAP-008


def _wall(d: Draft, beyond_m: float) -> dict[str, Any]:
    """Put a wall across the outermost ego of a group, `beyond_m` from its centre and off the lane; that observation."""
    here = _narrow(d, -0.5)
    d.drop("map", element_id="ground-0")
    row = d.take("observations", **here)
    x_m, y_m = row["x_m"][0].as_py(), row["y_m"][0].as_py()
    across_m = y_m + np.sign(y_m) * beyond_m
    d.set("map", "x_m", [x_m - 0.2, x_m + 0.2, x_m + 0.2], town="Town12", element_id="far-wall")
    d.set("map", "y_m", [across_m, across_m, y_m + 9 * np.sign(y_m)], town="Town12", element_id="far-wall")
    return here


@mutant("BD-MAP-008", at={"table": "evidence", "column": "collision"})
def wall_that_nobody_feels(d: Draft) -> None:
    _wall(d, 0.75)


@boundary("BD-MAP-008")
def wall_beside_the_ego(d: Draft) -> None:
    _wall(d, 3.0)


@boundary("BD-MAP-008")
def wall_that_is_hit(d: Draft) -> None:
    here = _wall(d, 0.75)
    ticks = range(BRANCH_TICK + 5, BRANCH_TICK + 200, 5)
    d.set("evidence", "collision", True, rollout_id=here["rollout_id"], tick=ticks)
    d.set("rollouts", "result_num_static_collisions", 1, rollout_id=here["rollout_id"])


@boundary("BD-MAP-008")
def rail_of_a_bridge_over_the_road(d: Draft) -> None:
    d.set("map", "x_m", [60.0, 60.0, 61.0], town="Town12", element_id="far-wall")
    d.set("map", "y_m", [-50.0, 50.0, 50.0], town="Town12", element_id="far-wall")


@boundary("BD-MAP-008", status="skipped")
def towns_without_walls(d: Draft) -> None:
    d.drop("map", kind="wall")


# BD-MAP-009


@mutant("BD-MAP-009", base="map", at={"column": "traffic_light", "tick": 0}, findings=16)
def light_without_a_signal(d: Draft) -> None:
    d.drop("map", town=TOWN, element_id="far-signal")


@boundary("BD-MAP-009", base="map")
def town_without_signals_and_lights(d: Draft) -> None:
    d.drop("map", town=TOWN, element_id="far-signal")
    ids = d.take("rollouts", town=TOWN)["rollout_id"].to_pylist()
    d.set("evidence", "traffic_light_available", False, rollout_id=ids)
    d.set("evidence", "traffic_light", None, rollout_id=ids)
