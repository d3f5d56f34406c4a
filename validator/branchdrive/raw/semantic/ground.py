"""Road and route of semantic maps against the map of the town and the polyline of the attempt, image by image.

What lies well inside a recorded strip is drivable, and more may be: sources know of ground that no lane holds. The
route shows where the recorded one goes on, and nowhere far from it. What lies beside the image, near its border or
beyond the range of the actors is compared with nothing.

Source: spec/05-raw-streams.md#images.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import PreconditionError
from branchdrive.contract.semantic_bev import ROUTE_WIDTH_M, SemanticChannel, classes_of
from branchdrive.driving.risk import RANGE_M
from branchdrive.driving.route import points_near
from branchdrive.raw.motion.route_state import routes
from branchdrive.raw.semantic.frame import TILE_M, SemanticFrame, SemanticFrames, near_pixels
from branchdrive.raw.town_map import EDGE_SLACK_M, held_by_strips

__all__ = ["SemanticGround"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Pixels = NDArray[np.uint8]
Text = tuple[str, str]

_TILES = 64
"""Squares whose points are held at once."""

_ROUTE_REACH_M = 64.0
"""Points of the route this near to the ego matter, and some further away."""

_MAX_ROUTE_POINTS = 20_000
"""Where more of them lie around the ego, the route is not compared: an honest one has few hundred."""

_LONGEST_STEP_M = 1.001
"""Neighbouring points of a route are this near to each other; others have left out what lies between them."""

_LEAST_LENGTH_M = 10.0
"""Less of a route says little of its width: its ends are as wide as it is."""

_LATTICE = 5
"""Points of whole metres ``x``, ``y`` with ``x - 2 y`` divisible by this: no lane along an axis lies between them."""

_DRIVABLE, _ROUTE = np.uint8(SemanticChannel.DRIVABLE_AREA), np.uint8(SemanticChannel.REMAINING_ROUTE)


class SemanticGround:
    """Recorded road and route around the ego at the moment of every semantic map.

    Args:
        frames: The maps of a shard.

    Attributes:
        is_judged: Whether an image is a map with an observation and a route or a claimed map ``[stored rows]``.
    """

    def __init__(self, frames: SemanticFrames) -> None:
        view, self._frames = frames.view, frames
        index = view.stream("frames")
        lines = view.cached(routes)
        self._polylines = lines.polylines
        self._route = np.append(lines.of_rollout, -1)[index.rollout]
        self._has_map = "map" in view
        self._town = np.append(view.rollouts.categories("town")[0], -1)[index.rollout]
        self.is_judged = frames.observation >= 0
        if not self._has_map:
            self.is_judged[index.position[self._route < 0]] = False
        self._road_points_of = lru_cache(_TILES)(self._road_points)
        self._route_points_of = lru_cache(_TILES)(self._route_points)

    @np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
    def __call__(self, stored_row: int, pixels: Pixels) -> Text | None:
        """What is expected and found otherwise on the judged map of a stored row of the index, where anything is."""
        frame = self._frames[stored_row]
        tile = math.floor(frame.x_m / TILE_M), math.floor(frame.y_m / TILE_M)
        town, route = int(self._town[frame.row]), int(self._route[frame.row])
        if self._has_map and town >= 0:
            depth_m = max(physical_bounds().bev_px / frame.camera.px_per_m, EDGE_SLACK_M)
            found = _against_road(frame, pixels, *self._road_points_of(town, depth_m, *tile))
            if found is not None:
                return found
        if route < 0:
            return None
        x_m, y_m = self._route_points_of(route, *tile)
        return None if len(x_m) > _MAX_ROUTE_POINTS else _against_route(frame, pixels, x_m, y_m)

    def _road_points(self, town: int, depth_m: float, column: int, row: int) -> tuple[Array, Array]:
        """Points of the lattice around a tile that strips hold."""
        reach = math.ceil(RANGE_M)
        x, y = np.meshgrid(*(np.arange(at * TILE_M - reach, (at + 1) * TILE_M + reach + 1) for at in (column, row)))
        chosen = (x - 2 * y) % _LATTICE == 0
        x_m, y_m = x[chosen].astype(np.float64), y[chosen].astype(np.float64)
        try:
            held = held_by_strips(self._frames.view, np.full(len(x_m), town), x_m, y_m, depth_m=depth_m)
        except PreconditionError:  # the rule says so
            held = np.zeros(len(x_m), bool)
        return x_m[held], y_m[held]

    def _route_points(self, route: int, column: int, row: int) -> tuple[Array, Array]:
        """Points of a route around a tile, in its order."""
        x_m, y_m = ((at + 0.5) * TILE_M for at in (column, row))
        reach_m = TILE_M / math.sqrt(2) + _ROUTE_REACH_M
        return points_near(x_m, y_m, *self._polylines[route], reach_m, most=_MAX_ROUTE_POINTS)


def _is_seen(frame: SemanticFrame, ahead_m: Array, left_m: Array, rows: Index, columns: Index) -> NDArray[np.bool_]:
    return (ahead_m**2 + left_m**2 < RANGE_M**2) & frame.is_well_inside(rows, columns)


def _against_road(frame: SemanticFrame, pixels: Pixels, x_m: Array, y_m: Array) -> Text | None:
    """What a map shows at points well inside of recorded strips."""
    places = frame.in_ego_frame(x_m, y_m)
    rows, columns = frame.pixels_at(*places)
    seen = _is_seen(frame, *places, rows, columns)
    values = pixels[rows[seen], columns[seen]]
    for name, shows in (("drivable area", (values & _DRIVABLE) != 0), ("a class of road", classes_of(values) != 0)):
        if found := _too_few(f"{name} at points inside recorded lanes", int(shows.sum()), len(values)):
            return found
    return None


def _too_few(what: str, num_shown: int, num_points: int) -> Text | None:
    share = physical_bounds().bev_share
    if num_points - num_shown <= share * num_points:
        return None
    return f"{what}: at {1 - share:.0%} of {num_points}", f"at {num_shown} of them"


def _against_route(frame: SemanticFrame, pixels: Pixels, x_m: Array, y_m: Array) -> Text | None:
    """Whether the route shows where it goes on, and nowhere else, and as a band of its width."""
    places = frame.in_ego_frame(x_m, y_m)
    distance_m = np.hypot(*places)
    near = np.flatnonzero(distance_m <= distance_m.min(initial=np.inf) + physical_bounds().bev_route_m)
    first, after = (int(near[0]), int(near[-1]) + 1) if len(near) else (0, 0)
    rows, columns = frame.pixels_at(*places)
    seen = after + np.flatnonzero(_is_seen(frame, *places, rows, columns)[after:])
    num_shown = int(_is_shown(pixels, rows[seen], columns[seen]).sum())
    if found := _too_few("the route at points that lie ahead", num_shown, len(seen)):
        return found
    own_rows, own_columns = np.divmod(np.flatnonzero((pixels & _ROUTE) != 0), pixels.shape[1])
    if (at := _off_route(frame, pixels.shape, own_rows, own_columns, rows[first:], columns[first:])) is not None:
        return "the route where it is recorded", f"it at row {at[0]}, column {at[1]} too"
    return _too_wide(frame, own_rows, own_columns, *(place[first:] for place in places))


def _too_wide(frame: SemanticFrame, own_rows: Index, own_columns: Index, ahead_m: Array, left_m: Array) -> Text | None:
    """What the area of the route says, against the length of what goes on in the same ring around the ego."""
    bounds, scale = physical_bounds(), frame.camera.px_per_m
    least_m, most_m = bounds.bev_route_m, RANGE_M - bounds.bev_px / scale
    step_m = np.hypot(np.diff(ahead_m), np.diff(left_m))
    middle_m = np.hypot(ahead_m[1:] + ahead_m[:-1], left_m[1:] + left_m[:-1]) / 2
    is_counted = (step_m <= _LONGEST_STEP_M) & (middle_m > least_m) & (middle_m < most_m)
    length_m = float(step_m[is_counted].sum())
    away_m = np.hypot(*frame.centres_of(own_rows, own_columns))
    area_m2 = ((away_m > least_m) & (away_m < most_m)).sum() / scale**2
    width_m = ROUTE_WIDTH_M + 2 * bounds.bev_px / scale
    if length_m < _LEAST_LENGTH_M or area_m2 <= width_m * length_m:
        return None
    expected = f"a route {ROUTE_WIDTH_M:g} m wide, at most {width_m:g} m as pixels show it"
    return expected, f"{area_m2 / length_m:.2g} m, {area_m2:.0f} m2 over {length_m:.0f} m"


def _is_shown(pixels: Pixels, rows: Index, columns: Index) -> NDArray[np.bool_]:
    """Whether a pixel of the route lies within `bev_px` of each of some pixels."""
    shown: NDArray[np.bool_] = (pixels[rows, columns] & _ROUTE) != 0
    rest = np.flatnonzero(~shown)
    slack = int(physical_bounds().bev_px)
    around = np.arange(-slack, slack + 1)
    window = pixels[rows[rest][:, None, None] + around[:, None], columns[rest][:, None, None] + around]
    shown[rest] = ((window & _ROUTE) != 0).any(axis=(1, 2))
    return shown


def _off_route(
    frame: SemanticFrame, shape: tuple[int, ...], own_rows: Index, own_columns: Index, rows: Index, columns: Index
) -> tuple[int, int] | None:
    """Row and column of a pixel of the route, in range, that lies near none of some pixels."""
    camera, bounds = frame.camera, physical_bounds()
    reach = max(int(bounds.bev_route_m * camera.px_per_m), int(bounds.bev_px))
    rest = np.flatnonzero(~_in_same_cells(own_rows, own_columns, rows, columns, shape, reach // 2))
    if not len(rest):
        return None
    own_rows, own_columns = own_rows[rest], own_columns[rest]
    is_off = np.hypot(*frame.centres_of(own_rows, own_columns)) < RANGE_M - bounds.bev_px / camera.px_per_m
    is_off &= ~near_pixels(rows, columns, shape, reach)[own_rows, own_columns]
    found = np.flatnonzero(is_off)
    return (int(own_rows[found[0]]), int(own_columns[found[0]])) if len(found) else None


def _in_same_cells(
    rows: Index, columns: Index, of_rows: Index, of_columns: Index, shape: tuple[int, ...], side: int
) -> NDArray[np.bool_]:
    """Pixels in cells that hold one of other pixels, or touch such a cell: at most two sides away from it."""
    height, width = (size // side + 3 for size in shape)
    cell_row, cell_column = of_rows // side + 1, of_columns // side + 1
    inside = (cell_row >= 0) & (cell_row < height) & (cell_column >= 0) & (cell_column < width)
    marked = np.zeros((height, width), bool)
    marked[cell_row[inside], cell_column[inside]] = True
    for grid in (marked, marked.T):  # a cell and its neighbours
        grid[1:] |= grid[:-1].copy()
        grid[:-1] |= grid[1:].copy()
    return np.asarray(marked[rows // side + 1, columns // side + 1])
