"""Signals and stop signs of semantic maps against those of the map of the town, image by image.

The evidence says which colour the signal of the ego's lane has, the map where it stands and where vehicles wait at it.
What other signals show is not recorded, so that they may show anything, but not far from where one is.

Source: spec/05-raw-streams.md#images.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.semantic_bev import SemanticClass, classes_of
from branchdrive.driving.risk import RANGE_M
from branchdrive.raw.semantic.frame import TILE_M, SemanticFrame, SemanticFrames, near_pixels
from branchdrive.raw.town_map import home_towns, is_usable

__all__ = ["SemanticSigns"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Pixels = NDArray[np.uint8]
Text = tuple[str, str]

_TILES = 64
"""Squares of the world whose places are held at once."""

_MAX_PLACES = 20_000
"""Where more of them lie around the ego, signs are not compared: an honest map has few hundred."""

_LONGEST_PIECE_M = 1e6
"""Longer pieces of stop lines count as this long."""

_LIGHTS = {
    "red": SemanticClass.RED_LIGHT,
    "yellow": SemanticClass.YELLOW_LIGHT,
    "green": SemanticClass.GREEN_LIGHT,
}
_SIGNAL, _STOP_SIGN, _STOP_LINE = range(3)
_KINDS = ("signal", "stop_sign", "stop_line")


class _Places(NamedTuple):
    """Where signals and signs stand, and points of lines at which vehicles wait, world frame, each ``[places]``.

    Attributes:
        x_m: World frame.
        y_m: The same, y.
        kind: Signal, stop sign or stop line.
        lane: Number of its lane among those of the places, the last one where it has none.
        lanes: Lanes of the places, as indices into those of the map ``[lanes]``.
        complete: For signals and for stop signs, places of lanes that have both one of them and a stop line.
    """

    x_m: Array
    y_m: Array
    kind: Index
    lane: Index
    lanes: Index
    complete: tuple[Index, Index]


class _Pieces(NamedTuple):
    """Straight pieces of stop lines, and signals and signs as pieces of no length, by their town, each ``[pieces]``."""

    start_x_m: Array
    start_y_m: Array
    end_x_m: Array
    end_y_m: Array
    kind: Index
    lane: Index
    town: Index


class SemanticSigns:
    """Recorded signals, stop signs and stop lines around the ego at the moment of every semantic map.

    Args:
        frames: The maps of a shard.

    Attributes:
        is_judged: Whether an image is a map with an observation, in a town whose signals, signs and stop lines are all
            whole ``[stored rows]``.
    """

    def __init__(self, frames: SemanticFrames) -> None:
        view, self._frames = frames.view, frames
        self.is_judged = frames.observation >= 0
        if "map" not in view:
            self.is_judged[:] = False
            return
        index = view.stream("frames")
        self._town = np.append(view.rollouts.categories("town")[0], -1)[index.rollout]
        self._pieces, lost = _pieces(frames)
        self.is_judged[index.position[(self._town < 0) | np.isin(self._town, lost)]] = False
        self._lanes = view.map.categories("lane_id")[1]
        self._light, self._lane = (np.full(len(index), -1, np.int64) for _ in range(2))
        if "evidence" in view:
            evidence = view.stream("evidence")
            row = evidence.find(index.rollout, index.tick)
            for column, known, found in (
                ("traffic_light", [*_LIGHTS], self._light),
                ("lane_id", self._lanes, self._lane),
            ):
                codes, names = evidence.categories(column)
                place = {name: code for code, name in enumerate(known)}
                known_codes = np.array([*(place.get(name, -1) for name in names), -1], np.int64)
                found[row >= 0] = known_codes[codes[row[row >= 0]]]
        self._places_of = lru_cache(_TILES)(self._places)

    @np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
    def __call__(self, stored_row: int, pixels: Pixels) -> Text | None:
        """What is expected and found otherwise on the judged map of a stored row of the index, where anything is."""
        frame = self._frames[stored_row]
        tile = math.floor(frame.x_m / TILE_M), math.floor(frame.y_m / TILE_M)
        places = self._places_of(int(self._town[frame.row]), *tile)
        if places is None:
            return None
        look = _Look(frame, classes_of(pixels), places)
        for sign in (_SIGNAL, _STOP_SIGN):
            if (at := look.invented(sign)) is not None:
                expected = f"nothing of a {_KINDS[sign]} far from one and from stop lines"
                return expected, f"a {_name(at[2])} at row {at[0]}, column {at[1]}"
        wanted = [(_STOP_SIGN, places.complete[_STOP_SIGN], SemanticClass.STOP_SIGN)]
        light, lane = int(self._light[frame.row]), int(self._lane[frame.row])
        if light >= 0 <= lane:
            at_signals = places.complete[_SIGNAL]
            is_own = places.lanes[places.lane[at_signals]] == lane
            wanted.append((_SIGNAL, at_signals[is_own], [*_LIGHTS.values()][light]))
        for sign, of_lanes, kind in wanted:
            if (missing := look.missing(of_lanes, kind)) is not None:
                return f"a {_name(kind)} at the {_KINDS[sign]} or stop line of lane {self._lanes[missing]!r}", "none"
        return None

    def _places(self, town: int, column: int, row: int) -> _Places | None:
        """Places around a tile; ``None`` where they are too many."""
        pieces, reach_m = self._pieces, RANGE_M + physical_bounds().bev_junction_m
        near = pieces.town == town
        for start, end, cell in (
            (pieces.start_x_m, pieces.end_x_m, column),
            (pieces.start_y_m, pieces.end_y_m, row),
        ):
            near &= (np.maximum(start, end) >= cell * TILE_M - reach_m) & (
                np.minimum(start, end) <= (cell + 1) * TILE_M + reach_m
            )
        start_x, start_y, end_x, end_y, kind, lane, _ = (values[near] for values in pieces)
        length_m = np.hypot(end_x - start_x, end_y - start_y)
        count = np.ceil(np.minimum(length_m, _LONGEST_PIECE_M)).astype(np.int64) + 1
        if count.sum() > _MAX_PLACES:
            return None
        piece = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
        share = step / np.maximum(count - 1, 1)[piece]
        x, y = ((start + share * (end - start)) for start, end in (
            (start_x[piece], end_x[piece]), (start_y[piece], end_y[piece])
        ))  # fmt: skip
        lanes, lane = np.unique(lane[lane >= 0]), lane[piece]
        lane = np.where(lane >= 0, np.searchsorted(lanes, lane), len(lanes))
        kind = kind[piece]
        return _Places(
            x,
            y,
            kind,
            lane,
            lanes,
            (_complete(kind, lane, len(lanes), _SIGNAL), _complete(kind, lane, len(lanes), _STOP_SIGN)),
        )


def _complete(kind: Index, lane: Index, num_lanes: int, sign: int) -> Index:
    """Places of one kind and of stop lines, of lanes that have both."""
    has_sign, has_line = (np.bincount(lane[kind == one], minlength=num_lanes + 1) > 0 for one in (sign, _STOP_LINE))
    is_of_kind = (kind == sign) | (kind == _STOP_LINE)
    return np.flatnonzero(is_of_kind & (has_sign & has_line)[lane] & (lane < num_lanes))


def _name(kind: int) -> str:
    return SemanticClass(kind).name.lower().replace("_", " ")


def _pieces(frames: SemanticFrames) -> tuple[_Pieces, Index]:
    """Signals, signs and stop lines of the towns of the rollouts; and towns some of whose are not whole."""
    elements, usable, homes = frames.view.map, is_usable(frames.view), home_towns(frames.view)
    kind = np.full(len(elements), -1, np.int64)
    for code, name in enumerate(_KINDS):
        kind[elements.equals("kind", name)] = code
    is_sign = (kind >= 0) & (homes >= 0)
    chosen = is_sign & usable
    (x, counts), (y, _) = (
        (values[np.repeat(chosen, lengths)], lengths[chosen])
        for values, lengths in (elements.items(axis) for axis in ("x_m", "y_m"))
    )
    owner = np.repeat(np.flatnonzero(chosen), counts)
    is_joined = np.append(owner[1:] == owner[:-1], False) if len(owner) else np.zeros(0, bool)
    start = np.flatnonzero(is_joined | (np.repeat(counts, counts) == 1))
    end = start + is_joined[start]
    lane = elements.categories("lane_id")[0].astype(np.int64)
    own = owner[start]
    return _Pieces(x[start], y[start], x[end], y[end], kind[own], lane[own], homes[own]), homes[is_sign & ~usable]


class _Look:
    """What one map shows at some places.

    Args:
        frame: The map.
        classes: Class of every pixel.
        places: Recorded places around it.
    """

    def __init__(self, frame: SemanticFrame, classes: Pixels, places: _Places) -> None:
        self._frame, self._classes, self._places = frame, classes, places
        at = frame.in_ego_frame(places.x_m, places.y_m)
        self._rows, self._columns = frame.pixels_at(*at)
        self._is_seen = (np.hypot(*at) < RANGE_M) & frame.is_well_inside(self._rows, self._columns)
        shown = np.flatnonzero((classes >= SemanticClass.STOP_SIGN) & (classes <= SemanticClass.GREEN_LIGHT))
        self._sign_rows, self._sign_columns = np.divmod(shown, classes.shape[1])
        self._sign_class = classes[self._sign_rows, self._sign_columns]

    def invented(self, sign: int) -> tuple[int, int, int] | None:
        """Row, column and class of a pixel of a signal or stop sign that is far from all places where one may be."""
        chosen = (self._sign_class == SemanticClass.STOP_SIGN) == (sign == _STOP_SIGN)
        if not chosen.any():
            return None
        rows, columns = self._sign_rows[chosen], self._sign_columns[chosen]
        may = (self._places.kind == sign) | (self._places.kind == _STOP_LINE)
        near = self._near(self._rows[may], self._columns[may], physical_bounds().bev_junction_m)
        slack_m = physical_bounds().bev_px / self._frame.camera.px_per_m
        is_far = (np.hypot(*self._frame.centres_of(rows, columns)) < RANGE_M - slack_m) & ~near[rows, columns]
        found = np.flatnonzero(is_far)
        if not len(found):
            return None
        row, column = int(rows[found[0]]), int(columns[found[0]])
        return row, column, int(self._classes[row, column])

    def missing(self, of_lanes: Index, kind: SemanticClass) -> int | None:
        """The first lane, of those of some places that are all in view, that shows a class nowhere, nor what covers it.

        Args:
            of_lanes: Places of signs and stop lines of lanes that have both.
            kind: The class.
        """
        seen = self._of_other_lanes(of_lanes, ~self._is_seen[of_lanes])
        if not len(seen):
            return None
        own = self._sign_class == kind
        shown = self._near(self._sign_rows[own], self._sign_columns[own], physical_bounds().bev_light_m)
        if len(rest := self._of_other_lanes(seen, self._is_in(shown, seen))):
            bodies = np.divmod(np.flatnonzero(self._classes >= SemanticClass.VEHICLE), self._classes.shape[1])
            rest = self._of_other_lanes(rest, self._is_in(self._near(*bodies, 0.0), rest))
        return int(self._places.lanes[self._places.lane[rest[0]]]) if len(rest) else None

    def _is_in(self, marked: Mask, at: Index) -> Mask:
        """Which of some places lie on a marked pixel."""
        return np.asarray(marked[self._rows[at], self._columns[at]])

    def _of_other_lanes(self, at: Index, which: Mask) -> Index:
        """Those of some places whose lane has none of which something holds."""
        lane = self._places.lane[at]
        holds = np.zeros(len(self._places.lanes), bool)
        holds[lane[which]] = True
        return at[~holds[lane]]

    def _near(self, rows: Index, columns: Index, reach_m: float) -> Mask:
        """Pixels within a reach of one of some pixels, or within `bev_px` where this is more ``[height, width]``."""
        reach = max(int(reach_m * self._frame.camera.px_per_m), int(physical_bounds().bev_px))
        return near_pixels(rows, columns, self._classes.shape, reach)
