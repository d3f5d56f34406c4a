"""Defects and limits of lanes of maps: which way they run, and where stop lines lie."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from tests.validator.engine.rules.case import SHARD_0, SHARD_1, boundary, mutant
from tests.validator.engine.rules.cases.maps import ROAD, TOWN, edit, far
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import on_grid

ONCOMING_M = 3.5
"""How far to the left of their routes vehicles come along them."""


# BD-MAP-010: in the town of two groups, three vehicles drive along the wide lanes, and two of them against it.


def _reverse_lanes(rows: pa.Table) -> pa.Table:
    """The map with the lanes of the routes from their last vertex to their first."""
    elements = rows.to_pylist()
    for element in elements:
        if element["lane_id"] == ROAD:
            for column in ("x_m", "y_m", "width_m"):
                element[column].reverse()
    return pa.Table.from_pylist(elements, rows.schema)


def _with_oncoming_lanes(rows: pa.Table) -> pa.Table:
    """The map with lanes for those who come along the routes, so that the wide ones are the ego's alone."""
    elements = rows.to_pylist()
    for element in [one for one in elements if one["lane_id"] == ROAD]:
        x, y = (np.array(element[column]) for column in ("x_m", "y_m"))
        heading = np.arctan2(np.gradient(y), np.gradient(x))
        sides = {"x_m": x - ONCOMING_M * np.sin(heading), "y_m": y + ONCOMING_M * np.cos(heading)}
        lines = {column: on_grid(values[::-1]).tolist() for column, values in sides.items()}
        name = f"oncoming-{element['element_id']}"
        elements.append({**element, **lines, "element_id": name, "lane_id": name, "width_m": [3.0] * len(x)})
    return pa.Table.from_pylist(elements, rows.schema)


@mutant("BD-MAP-010", at={"table": "map", "town": "Town12", "lane_id": ROAD})
def lanes_from_their_end_to_their_begin(d: Draft) -> None:
    for folder in (SHARD_0, SHARD_1):
        d.map_table("map", lambda rows: _reverse_lanes(_with_oncoming_lanes(rows)), folder=folder)


@boundary("BD-MAP-010")
def lane_that_most_but_not_nearly_all_drive_against(d: Draft) -> None:
    for folder in (SHARD_0, SHARD_1):
        d.map_table("map", _reverse_lanes, folder=folder)


# BD-MAP-011: a lane that goes on straight from the far one, and another from where both meet.


def _lane(d: Draft, name: str, along_m: tuple[float, float], **columns: Any) -> None:
    """Add a lane along x behind the far one, from one place to another."""
    x = [5020.0 + along for along in along_m]
    changes = {"element_id": name, "lane_id": name, "x_m": x, "y_m": [1.0, 1.0], "width_m": [3.0, 3.0], **columns}
    d.duplicate("map", changes, town=TOWN, element_id="far-lane")


@mutant("BD-MAP-011", at=far("lane", column="x_m"), findings=2)
def lane_drawn_against_the_one_before(d: Draft) -> None:
    _lane(d, "next", (40.0, 0.4))


@boundary("BD-MAP-011")
def lane_that_goes_on(d: Draft) -> None:
    _lane(d, "next", (0.4, 40.0))


@boundary("BD-MAP-011")
def one_track_for_both_ways(d: Draft) -> None:
    """Two lanes on one line: where they meet the next two, one ends and one begins in each direction."""
    _lane(d, "next", (0.0, 40.0))
    _lane(d, "back", (40.0, 0.0))
    far = d.take("map", town=TOWN, element_id="far-lane").to_pylist()[0]
    back = {column: far[column][::-1] for column in ("x_m", "y_m", "width_m")}
    d.duplicate("map", {"element_id": "further", "lane_id": "further", **back}, town=TOWN, element_id="far-lane")


@boundary("BD-MAP-011")
def two_one_way_streets_that_end_at_a_third(d: Draft) -> None:
    _lane(d, "next", (40.0, 0.0))
    _lane(d, "aside", (0.0, 0.0), y_m=[1.0, 40.0])


@boundary("BD-MAP-011", status="skipped")
def lanes_that_end_a_metre_apart(d: Draft) -> None:
    _lane(d, "next", (40.0, 1.0))


# BD-MAP-012


def _stop_line(d: Draft, behind_m: float) -> None:
    """Draw a stop line across the way of the far lane, behind its end."""
    line = {"x_m": [5020.0 + behind_m] * 2, "y_m": [1.0, 2.5]}
    d.duplicate(
        "map", {"element_id": "line", "kind": "stop_line", "marking": None, **line}, town=TOWN, element_id="far-border"
    )


@mutant("BD-MAP-012", at={"table": "map", "town": TOWN, "element_id": "line", "column": "lane_id"})
def stop_line_far_behind_its_lane(d: Draft) -> None:
    _stop_line(d, 10.1)


@boundary("BD-MAP-012")
def stop_line_behind_its_lane(d: Draft) -> None:
    _stop_line(d, 9.9)


@boundary("BD-MAP-012", status="skipped")
def stop_line_of_no_lane_of_the_map(d: Draft) -> None:
    _stop_line(d, 10.1)
    edit(d, "line", lane_id="elsewhere")
