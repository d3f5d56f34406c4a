"""Flows: vehicles that pass a point of a track one after the other, timed to the ego's arrival."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import Scene
from branchdrive_reference.town.track import EGO_TRACK, Role, RouteTracks
from branchdrive_reference.world.body import VEHICLES, Body

__all__ = ["arrive_with_ego", "flow", "rival_tracks", "side_tracks"]

_FIRST_DRAW = 200
_RELAX_S = 0.8


def rival_tracks(road: EmptyRoad, *, ego_yields: bool) -> list[int]:
    """Tracks whose traffic meets the ego's: those that the ego yields to, or those that yield to the ego."""
    rows = road.tables.conflicts
    own, other = ("track", "other") if ego_yields else ("other", "track")
    found = rows[(rows[own] == EGO_TRACK) & (rows["yields"] == 1)]
    return sorted({int(track) for track in found[other]})


def side_tracks(tables: RouteTracks) -> list[int]:
    """Tracks that come from the sides of the route's junction and cross the route."""
    met = set(tables.conflicts["other"][tables.conflicts["track"] == EGO_TRACK].tolist())
    sides = (tables.roles.get(Role.FROM_LEFT), tables.roles.get(Role.FROM_RIGHT))
    return [track for track in sides if track is not None and track in met]


def flow(
    road: EmptyRoad, track: int, at_m: float, first_s: float, count: int, headway_s: tuple[float, float],
    *, eagerness: float = 1.0,
) -> list[Body]:  # fmt: skip
    """`count` vehicles of a track, the first of which is at `at_m` after `first_s`, the others a headway later each."""
    bodies, time_s = [], first_s
    for index in range(_FIRST_DRAW, _FIRST_DRAW + count):
        size = road.pick(VEHICLES, Purpose.TRAFFIC_BODY, index)
        arc_m = road.arc_before(track, at_m, time_s, eagerness)
        own_headway_s = road.draw(0.9, 1.3, Purpose.TRAFFIC_HEADWAY, index)
        bodies.append(road.vehicle(size, arc_m, track, eagerness=eagerness, headway_s=own_headway_s))
        time_s += road.draw(*headway_s, Purpose.TRAFFIC_GAP, index)
    return bodies


def arrive_with_ego(scene: Scene, row: int, ego_at_m: float, at_m: float, late_s: float) -> None:
    """Command body `row` so that its front is at `at_m` of its track `late_s` after the ego's is at `ego_at_m`."""
    body = scene.bodies[row]
    way_m = at_m - float(body["arc_m"]) - 0.5 * float(body["length_m"])
    time_s = max(scene.time_to_s(ego_at_m) + late_s, 0.5)
    wanted = max(way_m, 0.0) / time_s
    scene.command(row, (wanted - float(body["speed_mps"])) / _RELAX_S)
