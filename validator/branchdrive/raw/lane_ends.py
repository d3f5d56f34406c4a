"""Where the lanes of a shard's maps end: which of them meet head-on, and which stop lines lie elsewhere.

Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds, spec_limits
from branchdrive.contract.mismatch import Mask
from branchdrive.driving.neighbour import Points, neighbours
from branchdrive.driving.surface import Strips
from branchdrive.raw.known_map import once_per_map
from branchdrive.raw.map_work import within_limits
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import home_towns, is_usable

__all__ = ["Meetings", "lines_elsewhere", "meetings"]

Index = NDArray[np.int64]

MIN_COSINE = -np.sqrt(0.5)
"""Of the angle between lanes that go on in each other: they turn by 135 degrees at most."""


class Meetings(NamedTuple):
    """Lanes of the towns of the rollouts that meet others.

    Attributes:
        compared: Those with an end at an end of another lane ``[elements]``.
        against: Another lane that begins where they begin, or ends where they end, head-on, and none goes on in
            them, as a row of the map; -1 where there is none ``[elements]``.
    """

    compared: Mask
    against: Index


def meetings(view: ShardView) -> Meetings:
    """Lanes that meet others.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    return once_per_map(view, _meetings, *view.rollouts.categories("town")[1])


def _meetings(view: ShardView) -> Meetings:
    elements, homes = view.map, home_towns(view)
    lanes = np.flatnonzero(is_usable(view) & elements.equals("kind", "lane") & (homes >= 0))
    (x, lengths), (y, _) = (_vertices(view, lanes, name) for name in ("x_m", "y_m"))
    stop = np.cumsum(lengths)
    # Ends at which lanes begin, then those at which they end; of each its lane, in the order of names.
    at, back = np.concatenate([stop - lengths, stop - 1]), np.concatenate([stop - lengths, stop - 2])
    order = np.argsort(elements["element_id"][lanes], kind="stable")
    rank = np.argsort(order)
    own, is_last = np.tile(rank, 2), np.arange(2 * len(lanes)) >= len(lanes)
    heading = np.arctan2(y[back + 1] - y[back], x[back + 1] - x[back])
    points = Points(np.tile(homes[lanes], 2), x[at], y[at])
    meets, goes_on = np.zeros(len(own), bool), np.zeros(len(own), bool)
    other = np.full(len(own), len(lanes))
    with within_limits(view) as work:
        for one, two in neighbours(points, points, physical_bounds().meeting_m, work):
            is_other = own[one] != own[two]
            one, two = one[is_other], two[is_other]
            meets[one] = True
            is_along, is_same = np.cos(heading[one] - heading[two]) >= MIN_COSINE, is_last[one] == is_last[two]
            goes_on[one[is_along & ~is_same]] = True
            is_contrary = ~is_along & is_same
            np.minimum.at(other, one[is_contrary], own[two[is_contrary]])
    compared, against = np.zeros(len(elements), bool), np.full(len(elements), -1)
    compared[lanes] = meets.reshape(2, -1).any(axis=0)
    least = np.where(goes_on, len(lanes), other).reshape(2, -1).min(axis=0, initial=len(lanes))
    faulty = least < len(lanes)
    against[lanes[faulty]] = lanes[order][least[faulty]]
    return Meetings(compared, against)


def lines_elsewhere(view: ShardView) -> tuple[Mask, Mask]:
    """Stop lines that name usable lanes of their town, and those of them that lie elsewhere, each ``[elements]``.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    return once_per_map(view, _lines_elsewhere, *view.rollouts.categories("town")[1])


def _lines_elsewhere(view: ShardView) -> tuple[Mask, Mask]:
    elements, homes, usable = view.map, home_towns(view), is_usable(view)
    is_lane, (codes, names) = elements.equals("kind", "lane"), elements.categories("lane_id")
    label = np.where(codes >= 0, homes * len(names) + codes, -1)
    known = np.setdiff1d(label[is_lane & usable & (homes >= 0)], label[is_lane & ~usable])
    named = elements.equals("kind", "stop_line") & usable & np.isin(label, known)
    lanes = np.flatnonzero(is_lane & np.isin(label, label[named]))
    if not len(lanes):
        return named, named
    reach_m = physical_bounds().stop_line_m
    (x, lengths), (y, _) = (_vertices(view, lanes, name) for name in ("x_m", "y_m"))
    (line_x, counts), (line_y, _) = (_vertices(view, np.flatnonzero(named), name) for name in ("x_m", "y_m"))
    owner, is_near = np.repeat(np.flatnonzero(named), counts), np.zeros(len(elements), bool)
    with within_limits(view) as work:
        strips = Strips(
            homes[lanes], lengths, x, y, np.full(len(x), 2 * reach_m), slack_m=0.0,
            most_squares=spec_limits().max_map_squares,
        )  # fmt: skip
        for point, _, excess_m, _ in strips.near(homes[owner], line_x, line_y, work, (label[lanes], label[owner])):
            is_near[owner[point[excess_m <= 0]]] = True
    return named, named & ~is_near


def _vertices(view: ShardView, rows: Index, column: str) -> tuple[NDArray[np.float64], Index]:
    """Vertices of elements, one element after the other, and how many each has."""
    values, lengths = view.map.items(column)
    chosen = np.zeros(len(lengths), bool)
    chosen[rows] = True
    return values[np.repeat(chosen, lengths)], lengths[chosen]
