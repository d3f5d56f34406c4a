"""The maps of a shard's towns: which elements are whole, and what lies under and inside the ego in every observation.

A centre within 0.05 m of an edge may lie on either side of it. Lanes overlap in junctions: any lane that may hold
the centre may be the recorded one.
Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds, spec_limits
from branchdrive.contract.mismatch import Mask
from branchdrive.driving.box import Boxes
from branchdrive.driving.surface import Areas, Strips
from branchdrive.driving.wall import Walls
from branchdrive.raw.copies import Copies
from branchdrive.raw.known_map import once_per_map
from branchdrive.raw.map_work import within_limits
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.content import table_digest
from branchdrive.tables.view import TableView

__all__ = [
    "AREAS", "EDGE_SLACK_M", "POINTS", "Ground", "Shapes", "demand_strips", "ground", "held_by_strips", "home_towns",
    "is_surveyed", "is_usable", "is_whole", "lanes_along", "lanes_under", "least_vertices", "map_digests", "shapes",
    "walls_inside",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]

EDGE_SLACK_M = 0.05
"""An arc of 10 m radius, the tightest turn of a car, leaves the chord between vertices 2 m apart by this."""

LIMIT_SLACK_MPS = 0.01
"""Limits of whole km/h and mph, rounded to two decimals, agree within this."""

_LARGEST_M = 1e7
"""Positions end here."""

POINTS = ("signal", "stop_sign", "yield_sign")
AREAS = ("road_area", "crossing")
STRIPS = ("lane", "shoulder", "parking")
DRIVABLE = (*STRIPS, "road_area")


def _is_one_of(elements: TableView, kinds: tuple[str, ...]) -> Mask:
    return np.asarray(np.logical_or.reduce([elements.equals("kind", kind) for kind in kinds]))


@dataclass(frozen=True)
class Shapes:
    """Vertices of the elements of a shard.

    Attributes:
        counts: Number of x, y, heights and widths of each element; -1 for a null ``[elements, 4]``.
        is_even: Elements whose lists are equally long, nulls left out.
        repeats: Elements with two equal neighbours.
        is_finite: Elements whose numbers are in range.
    """

    counts: Index
    is_even: Mask
    repeats: Mask
    is_finite: Mask


def shapes(view: ShardView) -> Shapes:
    """Vertices of the elements of the shard's maps."""
    elements = view.map
    items = {name: elements.items(name) for name in ("x_m", "y_m", "z_m", "width_m")}
    counts = np.stack([np.where(elements.valid(name), lengths, -1) for name, (_, lengths) in items.items()], axis=1)
    is_even = ((counts == counts[:, :1]) | (counts < 0)).all(axis=1) & (counts[:, :2] >= 0).all(axis=1)
    owner = np.repeat(np.arange(len(elements)), np.where(is_even, counts[:, 0], 0))
    x, y = (_of(is_even, *items[name]) for name in ("x_m", "y_m"))
    same = (owner[1:] == owner[:-1]) & (x[1:] == x[:-1]) & (y[1:] == y[:-1])
    closes = _is_one_of(elements, AREAS) & is_even & (counts[:, 0] > 1)
    stop = np.cumsum(np.where(is_even, counts[:, 0], 0))[closes]
    start = stop - counts[closes, 0]
    repeats = np.zeros(len(elements), bool)
    repeats[owner[1:][same]] = True
    repeats[np.flatnonzero(closes)[(x[start] == x[stop - 1]) & (y[start] == y[stop - 1])]] = True
    is_finite = np.ones(len(elements), bool)
    is_finite[owner[~((np.abs(x) <= _LARGEST_M) & (np.abs(y) <= _LARGEST_M))]] = False
    width, lengths = items["width_m"]
    is_finite[np.repeat(np.arange(len(elements)), lengths)[~((width > 0) & (width <= _LARGEST_M))]] = False
    return Shapes(counts, is_even, repeats, is_finite)


def _of(chosen: Mask, values: Array, lengths: Index) -> Array:
    """Items of the chosen cells of a list column."""
    return values[np.repeat(chosen, lengths)]


def least_vertices(elements: TableView) -> Index:
    """Vertices that each element must have by its kind."""
    return np.where(_is_one_of(elements, POINTS), 1, np.where(_is_one_of(elements, AREAS), 3, 2))


def is_whole(view: ShardView) -> Mask:
    """Elements with the vertices, widths and lanes that their kind takes."""
    elements, found = view.map, view.cached(shapes)
    num_vertices, least = found.counts[:, 0], least_vertices(elements)
    is_point = _is_one_of(elements, POINTS)
    whole = found.is_even & ~found.repeats & (num_vertices >= least)
    whole &= num_vertices <= np.where(is_point, 1, spec_limits().max_route_vertices)
    whole &= elements.valid("width_m") | ~_is_one_of(elements, STRIPS)
    return whole & (elements.valid("lane_id") | ~elements.equals("kind", "lane"))


def is_usable(view: ShardView) -> Mask:
    """Elements that a point can be compared with; rules on values report the others."""
    return view.cached(is_whole) & view.cached(shapes).is_finite


def is_surveyed(view: ShardView) -> Mask:
    """Attempts in towns whose drivable surfaces are all usable ``[rollouts]``: what another holds is unknown."""
    lost = ~is_usable(view) & _is_one_of(view.map, DRIVABLE)
    towns = set(view.map["town"][lost])
    return np.array([town not in towns for town in view.rollouts["town"]], bool)


@dataclass(frozen=True)
class Ground:
    """What lies under the ego's centre in every observation, as far as rules need it ``[observations]``.

    Attributes:
        has_lane: A lane holds it, for certain; not looked for where the recorded lane fits.
        fits_lane: A lane that may hold it is the recorded one.
        is_on_road: A drivable surface holds it, for certain; not looked for where the recorded lane fits.
        may_be_on_road: A drivable surface may hold it.
        has_limit: A lane with a speed limit holds it, for certain; not looked for where the recorded lane fits.
        fits_limit: A lane that may hold it has the recorded limit, or none that is known.
        meets_limit: A lane that may hold it has a limit, and one is recorded.
    """

    has_lane: Mask
    fits_lane: Mask
    is_on_road: Mask
    may_be_on_road: Mask
    has_limit: Mask
    fits_limit: Mask
    meets_limit: Mask


def ground(view: ShardView) -> Ground:
    """What lies under the ego in every observation.

    Most often that is the recorded lane, with its limit: other strips and areas are compared with the rest.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    observations = view.observations
    x, y = observations["x_m"], observations["y_m"]
    copied = view.cached(Copies).at_moments("observations")
    is_judged = (observations.rollout >= 0) & copied.judged(len(observations))
    rows = np.flatnonzero(is_judged & (np.abs(x) <= _LARGEST_M) & (np.abs(y) <= _LARGEST_M))
    found = Ground(*(np.zeros(len(observations), bool) for _ in fields(Ground)))
    recorded, off_road = view.cached(_recorded)
    named = rows[recorded[rows] >= 0]
    _look(view, named, found, recorded)
    settled = found.fits_lane & found.fits_limit & ~off_road
    rest = rows[~settled[rows]]
    _look(view, rest, found)
    beside = rest[~found.is_on_road[rest]]
    towns = _town_of(view, beside)
    with within_limits(view) as work:
        for point, excess_m in _outlined(view).near(towns, x[beside], y[beside], work, slack_m=EDGE_SLACK_M):
            found.is_on_road[beside[point[excess_m <= -EDGE_SLACK_M]]] = True
            found.may_be_on_road[beside[point[excess_m <= EDGE_SLACK_M]]] = True
    copied.fill(*(getattr(found, field.name) for field in fields(Ground)))
    return found


def _look(view: ShardView, rows: Index, found: Ground, wanted: Index | None = None) -> None:
    """Note what strips say of observations, or only the lanes that are `wanted` of each."""
    elements, observations = view.map, view.observations
    strips, filed = view.cached(_filed)
    recorded, _ = view.cached(_recorded) if wanted is None else (wanted, None)
    limit, knows_limit = observations["speed_limit_mps"], observations.valid("speed_limit_mps")
    lane = _lane_codes(view)[strips]
    lane_limit = np.where(elements.valid("speed_limit_mps"), elements["speed_limit_mps"], np.nan)[strips]
    labels = None if wanted is None else (lane, wanted[rows])
    x, y = observations["x_m"][rows], observations["y_m"][rows]
    with within_limits(view) as work:
        for point, strip, excess_m, is_end in filed.near(_town_of(view, rows), x, y, work, labels):
            at = rows[point]
            may, certain = excess_m <= EDGE_SLACK_M, (excess_m <= -EDGE_SLACK_M) & ~is_end
            is_lane, of_strip = lane[strip] >= 0, lane_limit[strip]
            agrees = ~(np.abs(of_strip - limit[at]) > LIMIT_SLACK_MPS)
            both_limited = knows_limit[at] & np.isfinite(of_strip)
            found.fits_lane[at[may & is_lane & (lane[strip] == recorded[at])]] = True
            found.may_be_on_road[at[may]] = True
            found.fits_limit[at[may & is_lane & agrees]] = True
            found.meets_limit[at[may & is_lane & both_limited]] = True
            if wanted is None:
                found.has_lane[at[certain & is_lane]] = True
                found.is_on_road[at[certain]] = True
                found.has_limit[at[certain & both_limited]] = True


def _town_of(view: ShardView, rows: Index) -> Index:
    """Town of observations, as an index into the towns of the rollouts."""
    return view.rollouts.categories("town")[0].astype(np.int64)[view.observations.rollout[rows]]


def home_towns(view: ShardView) -> Index:
    """Town of each element, as an index into the towns of the rollouts; -1 where nobody drives there."""
    place = {name: code for code, name in enumerate(view.rollouts.categories("town")[1])}
    codes, towns = view.map.categories("town")
    return np.array([*(place.get(name, -1) for name in towns), -1], np.int64)[codes]


def _filed(view: ShardView) -> tuple[Index, Strips]:
    """Elements that are strips of the towns of the rollouts, and their segments."""
    return once_per_map(view, _file, *view.rollouts.categories("town")[1])


def _file(view: ShardView) -> tuple[Index, Strips]:
    elements, homes = view.map, home_towns(view)
    chosen = is_usable(view) & _is_one_of(elements, STRIPS) & (homes >= 0)
    strips = np.flatnonzero(chosen)
    x, y, width = (_of(chosen, *elements.items(name)) for name in ("x_m", "y_m", "width_m"))
    with within_limits(view):
        filed = Strips(
            homes[strips], view.cached(shapes).counts[strips, 0], x, y, width, slack_m=EDGE_SLACK_M,
            most_squares=spec_limits().max_map_squares,
        )  # fmt: skip
    return strips, filed


def _outlined(view: ShardView) -> Areas:
    """Road areas of the towns of the rollouts."""
    return once_per_map(view, _outline, *view.rollouts.categories("town")[1])


def _outline(view: ShardView) -> Areas:
    elements, homes = view.map, home_towns(view)
    paved = np.flatnonzero(is_usable(view) & elements.equals("kind", "road_area") & (homes >= 0))
    x, y = (elements[name][paved] for name in ("x_m", "y_m"))
    return Areas(homes[paved], tuple(np.stack(outline, axis=1) for outline in zip(x, y, strict=True)))


def _lane_codes(view: ShardView) -> Index:
    """Lane of each lane element, as an index into the lanes of the evidence or beyond; -1 for other elements."""
    elements = view.map
    names = view["evidence"].categories("lane_id")[1] if "evidence" in view else []
    known = {name: code for code, name in enumerate(names)}
    codes, lanes = elements.categories("lane_id")
    of_lane = np.array([*(known.get(name, len(known)) for name in lanes), -1], np.int64)[codes]
    return np.where(elements.equals("kind", "lane"), of_lane, -1)


def _recorded(view: ShardView) -> tuple[Index, Mask]:
    """Recorded lane of each observation, as an index into the lanes of the evidence or -2; whether it is off road."""
    recorded, off_road = np.full(len(view.observations), -2, np.int64), np.zeros(len(view.observations), bool)
    if "evidence" in view:
        evidence = view.stream("evidence")
        frame = view.observations.rows_of(evidence)
        codes, _ = evidence.categories("lane_id")
        named = (frame >= 0) & (codes >= 0)
        recorded[frame[named]] = codes[named]
        off_road[frame[(frame >= 0) & ~evidence["on_road"].astype(bool)]] = True
    return recorded, off_road


def walls_inside(view: ShardView) -> Index:
    """Wall that reaches into the ego in every observation, as a row of the map ``[observations]``; -1 where none does.

    What lies on a drivable surface in the plane may be of another level, and does not count.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    elements, homes = view.map, home_towns(view)
    observations, found = view.observations, np.full(len(view.observations), -1, np.int64)
    chosen = is_usable(view) & elements.equals("kind", "wall") & (homes >= 0)
    if not chosen.any():
        return found
    walls = np.flatnonzero(chosen)
    x, y, yaw = (observations[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad"))
    rows = np.flatnonzero((observations.rollout >= 0) & (np.abs(x) <= _LARGEST_M) & (np.abs(y) <= _LARGEST_M))
    owner, margin_m = observations.rollout[rows], 2 * physical_bounds().wall_margin_m
    length, width = (np.maximum(view.rollouts[f"ego_{name}_m"][owner] - margin_m, 0.0) for name in ("length", "width"))
    boxes, towns = Boxes(x[rows], y[rows], yaw[rows], length, width), _town_of(view, rows)
    vertices = (_of(chosen, *elements.items(name)) for name in ("x_m", "y_m"))
    with within_limits(view) as work:
        reach_m = float(np.hypot(length, width).max(initial=0)) / 2
        lengths, most = view.cached(shapes).counts[walls, 0], spec_limits().max_map_squares
        filed = Walls(homes[walls], lengths, *vertices, reach_m=reach_m, most_squares=most)
        for part in filed.inside(towns, boxes, work):
            is_level = np.flatnonzero(~_is_on_ground(view, towns[part.box], part.x_m, part.y_m))
            found[rows[part.box[is_level]]] = walls[part.wall[is_level]]
    return found


def demand_strips(view: ShardView) -> None:
    """Let a rule end here where strips cannot be looked through.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    view.cached(_filed)


def held_by_strips(view: ShardView, towns: Index, x_m: Array, y_m: Array, *, depth_m: float) -> Mask:
    """Points that a lane, shoulder or parking strip holds, this far inside of its edges.

    Args:
        view: The shard, with maps.
        towns: Town of each point, as an index into the towns of the rollouts ``[points]``.
        x_m: World frame, within 1e7 m.
        y_m: The same, y.
        depth_m: Least distance from the edge.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    held = np.zeros(len(towns), bool)
    _, strips = view.cached(_filed)
    with within_limits(view) as work:
        for point, _, excess_m, is_end in strips.near(towns, x_m, y_m, work):
            held[point[(excess_m <= -depth_m) & ~is_end]] = True
    return held


def lanes_along(view: ShardView, towns: Index, x_m: Array, y_m: Array) -> tuple[Index, Index, Array]:
    """Points that one lane alone may hold, its row of the map, and its heading there in radians.

    Args:
        view: The shard, with maps.
        towns: Town of each point, as an index into the towns of the rollouts ``[points]``.
        x_m: World frame, within 1e7 m.
        y_m: The same, y.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    strips, filed = view.cached(_filed)
    pairs = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((3, 0)))]
    with within_limits(view) as work:
        for point, strip, excess_m, is_end, heading_rad in filed.along(towns, x_m, y_m, work):
            kept = (excess_m <= EDGE_SLACK_M) & view.map.equals("kind", "lane")[strips[strip]]
            pairs.append((point[kept], strips[strip[kept]], np.stack([excess_m, is_end, heading_rad])[:, kept]))
    point, lane = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
    excess_m, is_end, heading_rad = np.concatenate([pair[2] for pair in pairs], axis=1)
    order = np.lexsort((excess_m, point))  # the nearest first
    point, lane = point[order], lane[order]
    first = np.unique(point, return_index=True)[1]
    nearest = np.repeat(lane[first], np.diff(np.append(first, len(point))))
    is_shared = np.bincount(point[lane != nearest], minlength=len(towns)) > 0
    at = order[first]
    alone = ~is_shared[point[first]] & (excess_m[at] <= -EDGE_SLACK_M) & (is_end[at] == 0)
    return point[first][alone], lane[first][alone], heading_rad[at][alone]


def _is_on_ground(view: ShardView, towns: Index, x_m: Array, y_m: Array) -> Mask:
    """Points that a drivable surface holds, for certain."""
    held = held_by_strips(view, towns, x_m, y_m, depth_m=EDGE_SLACK_M)
    with within_limits(view) as work:
        for point, excess_m in _outlined(view).near(towns, x_m, y_m, work, slack_m=0.0):
            held[point[excess_m <= -EDGE_SLACK_M]] = True
    return held


def lanes_under(view: ShardView, row: int) -> list[int]:
    """Lane elements that may hold the ego's centre in an observation."""
    elements, observations = view.map, view.observations
    strips, filed = view.cached(_filed)
    place = _town_of(view, np.array([row])), observations["x_m"][[row]], observations["y_m"][[row]]
    with within_limits(view) as work:
        found = [strips[strip[excess_m <= EDGE_SLACK_M]] for _, strip, excess_m, _ in filed.near(*place, work)]
    under = np.unique(np.concatenate([np.zeros(0, np.int64), *found]))
    return [int(element) for element in under[elements.equals("kind", "lane")[under]]]


def map_digests(view: ShardView) -> dict[str, str]:
    """Digest of the map of each town, whatever the order of its elements; none where the shard has no maps."""
    return once_per_map(view, _digests_of_towns) if "map" in view else {}


def _digests_of_towns(view: ShardView) -> dict[str, str]:
    elements = view.map
    towns = [town for town in elements.categories("town")[1] if town]
    return {town: table_digest("map", elements.arrow.filter(elements.equals("town", town))) for town in towns}
