"""One road of an ASAM OpenDRIVE file, as elements of a map.

Source: ASAM OpenDRIVE 1.8, chapters 9 to 14; spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.reference_line import (
    Cubic,
    Curve,
    ReferenceLine,
    clothoid,
    cubic_by_length,
    parametric_cubic,
    value,
)
from branchdrive.collector.town import crossing_element, lane_element, sign_element, stop_line_element
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import quote
from branchdrive.errors import UsageError

__all__ = ["MOST_VERTICES", "Road"]

Values = NDArray[np.float64]
Tag = ElementTree.Element

MOST_VERTICES = 5_000_000
"""Of all elements together."""

_MOST_LANES = 100
_MOST_M = 1e7
_MOST_TURN = 1000.0

_KINDS = {
    **dict.fromkeys(
        (
            "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "bidirectional", "bus",
            "taxi", "HOV",
        ),
        "lane",
    ),
    **dict.fromkeys(("shoulder", "stop", "border"), "shoulder"),
    "parking": "parking",
}  # fmt: skip
"""Types of lanes that a map has a kind for: motor vehicles may drive there, or it is paved and as high as the road."""

_CURVES = ("line", "arc", "spiral", "poly3", "paramPoly3")
_UNITS = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704}
_SIGNS = {"206": "stop_sign", "205": "yield_sign", "R1-1": "stop_sign", "R1-2": "yield_sign"}
_STOP_LINE = "294"
_LEAST_WIDTH_M = 0.01
_STRAIGHT_RAD, _EVEN_M = 1e-9, 1e-9


@dataclass(frozen=True)
class _Lane:
    """A lane between two places along the road.

    Attributes:
        name: Its identity.
        number: Positive to the left of the reference line.
        kind: Of the map.
        begin_m: Where its section begins.
        end_m: Where its section ends.
        tag: What the file says.
        runs_back: Whether it is driven against the reference line.
        inner: The lane between this one and lane 0; `None` where there is none.
    """

    name: str
    number: int
    kind: str | None
    begin_m: float
    end_m: float
    tag: Tag
    runs_back: bool
    inner: _Lane | None


class Road:
    """One road.

    Args:
        tag: What the file says.
        step_m: Largest distance of vertices.
    """

    def __init__(self, tag: Tag, step_m: float) -> None:
        self._tag, self._step_m = tag, step_m
        self._id = tag.get("id") or ""
        self._length_m = self._number(tag, "length", least=0.0)
        self._line = self._reference_line()
        self._offsets = self._cubics(tag.findall("lanes/laneOffset"), "s")
        self._lanes = list(self._all_lanes())

    def elements(self) -> Iterator[dict[str, Any]]:
        """Its elements of the map."""
        for lane in self._lanes:
            if lane.kind is not None:
                yield from self._strips(lane)
        for tag in self._tag.findall("signals/signal"):
            yield from self._signal(tag)
        for tag in self._tag.findall("objects/object"):
            yield from self._object(tag)

    def _number(self, tag: Tag, name: str, default: float | None = None, *, least: float = -_MOST_M) -> float:
        text = tag.get(name)
        if text is None and default is not None:
            return default
        try:
            number = float(text or "")
        except ValueError:
            number = np.nan
        if not least <= number <= _MOST_M:
            raise UsageError(
                f"road {quote(self._id)}: {name}={quote(text)} of <{tag.tag}> is no number that is possible"
            )
        return number

    def _cubic(self, tag: Tag, suffix: str = "") -> Cubic:
        a, b, c, d = (self._number(tag, f"{letter}{suffix}") for letter in "abcd")
        return a, b, c, d

    def _cubics(self, tags: Sequence[Tag], place: str, begin_m: float = 0.0) -> list[tuple[float, Cubic]]:
        """Cubics with where along the road each begins, in order."""
        return sorted((begin_m + self._number(tag, place), self._cubic(tag)) for tag in tags)

    def _reference_line(self) -> ReferenceLine:
        tags = sorted(self._tag.findall("planView/geometry"), key=lambda tag: self._number(tag, "s"))
        if not tags:
            raise UsageError(f"road {quote(self._id)} has no <geometry>")
        start = np.array([[self._number(tag, name) for name in ("s", "x", "y", "hdg")] for tag in tags])
        return ReferenceLine(start, tuple(map(self._curve, tags)))

    def _curve(self, tag: Tag) -> Curve:
        length_m = self._number(tag, "length", least=1e-9)
        kind = next((one for one in tag if one.tag in _CURVES), None)
        match None if kind is None else kind.tag:
            case "line":
                return clothoid(0.0, 0.0, length_m)
            case "arc" | "spiral" if kind is not None:
                names = ("curvature", "curvature") if kind.tag == "arc" else ("curvStart", "curvEnd")
                first, last = (self._number(kind, name) for name in names)
                if max(abs(first), abs(last)) * length_m > _MOST_TURN:
                    raise UsageError(f"road {quote(self._id)}: a curve turns by more than {_MOST_TURN:g} rad")
                return clothoid(first, last, length_m)
            case "paramPoly3" if kind is not None:
                scale = length_m if kind.get("pRange") == "normalized" else 1.0
                return parametric_cubic(self._cubic(kind, "U"), self._cubic(kind, "V"), scale)
            case "poly3" if kind is not None:
                return cubic_by_length(self._cubic(kind), length_m)
        raise UsageError(f"road {quote(self._id)}: a <geometry> is no line, arc, spiral, poly3 or paramPoly3")

    def _all_lanes(self) -> Iterator[_Lane]:
        sections = sorted(self._tag.findall("lanes/laneSection"), key=lambda tag: self._number(tag, "s"))
        begins = [self._number(tag, "s") for tag in sections]
        is_left_hand = self._tag.get("rule") == "LHT"
        for index, (section, begin_m, end_m) in enumerate(
            zip(sections, begins, [*begins[1:], self._length_m], strict=True)
        ):
            for side in ("left", "right"):
                tags = section.findall(f"{side}/lane")
                if len(tags) > _MOST_LANES:
                    raise UsageError(f"road {quote(self._id)} has more than {_MOST_LANES} lanes on a side")
                inner: _Lane | None = None
                for number, tag in sorted(((int(self._number(tag, "id")), tag) for tag in tags), key=_outwards):
                    if (number > 0) != (side == "left") or number == 0:
                        raise UsageError(f"road {quote(self._id)}: lane {number} is none of its {side}")
                    runs_back = ((number > 0) != is_left_hand) != (tag.get("direction") == "reversed")
                    name, kind = f"{self._id}.{index}.{number}", _KINDS.get(tag.get("type") or "")
                    inner = _Lane(name, number, kind, begin_m, end_m, tag, runs_back, inner)
                    yield inner

    def _width_m(self, lane: _Lane, s_m: Values) -> Values:
        cubics = self._cubics(lane.tag.findall("width"), "sOffset", lane.begin_m)
        if cubics:
            return _piecewise(cubics, s_m).clip(0.0)
        if borders := self._cubics(lane.tag.findall("border"), "sOffset", lane.begin_m):
            inside = np.abs(self._outer_m(lane.inner, s_m))
            return (np.abs(_piecewise(borders, s_m)) - inside).clip(0.0)
        return np.zeros(len(s_m))

    def _outer_m(self, lane: _Lane | None, s_m: Values) -> Values:
        """How far the outer border is to the left of lane 0, the border of which is that of no lane."""
        if lane is None:
            return np.zeros(len(s_m))
        width_m = self._width_m(lane, s_m)
        return self._outer_m(lane.inner, s_m) + (width_m if lane.number > 0 else -width_m)

    def _borders_m(self, lane: _Lane, s_m: Values) -> tuple[Values, Values]:
        """How far the inner and the outer border are to the left of the reference line."""
        offset = _piecewise(self._offsets, s_m)
        outer = self._outer_m(lane, s_m) + offset
        return outer - np.sign(lane.number) * self._width_m(lane, s_m), outer

    def _strips(self, lane: _Lane) -> Iterator[dict[str, Any]]:
        """A lane, in pieces where its limit changes or it has too many vertices."""
        limits = self._limits(lane)
        ends = [*(begin for begin, _ in limits[1:]), lane.end_m]
        piece = 0
        for (begin_m, limit), end_m in zip(limits, ends, strict=True):
            s_m = self._places(begin_m, end_m)
            inner, outer = self._borders_m(lane, s_m)
            width_m = np.abs(outer - inner)
            if len(s_m) < 2 or width_m.max() <= _LEAST_WIDTH_M:
                continue
            x_m, y_m = self._line.beside(s_m, (inner + outer) / 2)
            vertices = _thinned(np.stack([x_m, y_m, np.maximum(width_m, _LEAST_WIDTH_M)]))
            if lane.runs_back:
                vertices = vertices[:, ::-1]
            most = spec_limits().max_route_vertices
            for first in range(0, vertices.shape[1] - 1, most - 1):
                part = vertices[:, first : first + most]
                element = lane_element(lane.name, part[0], part[1], 1.0, limit)
                element |= {"element_id": f"{lane.name}.{piece}", "kind": lane.kind, "width_m": part[2]}
                yield element if lane.kind == "lane" else element | {"lane_id": None, "speed_limit_mps": None}
                piece += 1

    def _places(self, begin_m: float, end_m: float) -> Values:
        """Places along the road between two, as far apart as vertices may be."""
        count = int(np.ceil((end_m - begin_m) / self._step_m)) + 1
        if count > MOST_VERTICES:
            raise UsageError(f"road {quote(self._id)} has more than {MOST_VERTICES} vertices; choose a larger step_m")
        knots = self._line.start[:, 0]
        inside = knots[(knots > begin_m) & (knots < end_m)]
        return np.unique(np.concatenate([np.linspace(begin_m, end_m, max(count, 2)), inside]))

    def _limits(self, lane: _Lane) -> list[tuple[float, float | None]]:
        """Where along the lane which speed limit begins: that of the lane, or else that of the road."""
        own = [(lane.begin_m + self._number(tag, "sOffset", 0.0), tag) for tag in lane.tag.findall("speed")]
        of_road = [(self._number(tag, "s"), tag.find("speed")) for tag in self._tag.findall("type")]
        records: list[tuple[float, Tag | None]] = sorted(own or of_road, key=lambda record: record[0])
        found: list[tuple[float, float | None]] = [(lane.begin_m, None)]
        for begin_m, tag in records:
            if begin_m >= lane.end_m:
                break
            limit = None if tag is None else self._limit(tag)
            if begin_m <= lane.begin_m:
                found = [(lane.begin_m, limit)]
            elif limit != found[-1][1]:
                found.append((begin_m, limit))
        return found

    def _limit(self, tag: Tag) -> float | None:
        if tag.get("max") in ("no limit", "undefined"):
            return None
        limit = self._number(tag, "max", least=0.0) * _UNITS.get(tag.get("unit") or "m/s", np.nan)
        if not limit <= 200:
            raise UsageError(f"road {quote(self._id)}: the speed limit {quote(tag.get('max'))} is none")
        return limit

    def _governed(self, tag: Tag, s_m: float) -> list[_Lane]:
        """Lanes at a place that a signal is about: those that it names, or those of the direction that it faces."""
        here = [lane for lane in self._lanes if lane.kind == "lane" and lane.begin_m <= s_m <= lane.end_m]
        last = max((lane.begin_m for lane in here), default=0.0)
        here = [lane for lane in here if lane.begin_m == last]
        if spans := tag.findall("validity"):
            ends = [sorted((self._number(one, "fromLane"), self._number(one, "toLane"))) for one in spans]
            return [lane for lane in here if any(low <= lane.number <= high for low, high in ends)]
        facing = {"+": False, "-": True}.get(tag.get("orientation") or "")
        return [lane for lane in here if facing is None or lane.runs_back == facing]

    def _signal(self, tag: Tag) -> Iterator[dict[str, Any]]:
        s, t = np.array([self._number(tag, "s")]), np.array([self._number(tag, "t")])
        name, kind = f"{self._id}.signal.{tag.get('id')}", tag.get("type") or ""
        lanes = self._governed(tag, float(s[0]))
        if kind == _STOP_LINE:
            for lane in lanes:
                ends = np.concatenate(self._borders_m(lane, s))
                if ends[0] != ends[1]:
                    yield stop_line_element(
                        f"{name}.{lane.number}", *self._line.beside(np.repeat(s, 2), ends), lane.name, "solid"
                    )
            return
        sign: Any = "signal" if tag.get("dynamic") == "yes" else _SIGNS.get(kind)
        if sign is not None:
            x_m, y_m = self._line.beside(s, t)
            yield sign_element(sign, name, x_m[0], y_m[0], lanes[0].name if len(lanes) == 1 else None)

    def _object(self, tag: Tag) -> Iterator[dict[str, Any]]:
        kind = (tag.get("type") or "").lower()
        called = f"{tag.get('name') or ''} {tag.get('subtype') or ''}".lower().replace("_", "").replace("-", "")
        name = f"{self._id}.object.{tag.get('id')}"
        if kind == "crosswalk":
            outlines = tag.findall("outline") + tag.findall("outlines/outline")
            shapes = [self._corners(tag, outline) for outline in outlines] or [self._box(tag)]
            for number, shape in enumerate(shapes):
                x_m, y_m = _distinct(shape)
                if len(x_m) >= 3:
                    yield crossing_element(f"{name}.{number}", x_m, y_m)
        elif "stopline" in called.replace(" ", ""):
            box = self._box(tag)
            sides = [(box[:, one] + box[:, other]) / 2 for one, other in ((0, 1), (1, 2), (2, 3), (3, 0))]
            ends = max(((sides[0], sides[2]), (sides[1], sides[3])), key=lambda pair: np.hypot(*(pair[0] - pair[1])))
            if not np.array_equal(*ends):
                x_m, y_m = np.stack(ends, axis=1)
                yield stop_line_element(name, x_m, y_m, marking="solid")

    def _local(self, tag: Tag, u: Values, v: Values) -> Values:
        """Places in the frame of an object ``[2, points]``."""
        s, t = np.array([self._number(tag, "s")]), np.array([self._number(tag, "t")])
        x_m, y_m = self._line.beside(s, t)
        heading = self._line.at(s)[2] + self._number(tag, "hdg", 0.0)
        cos, sin = np.cos(heading), np.sin(heading)
        return np.stack([x_m + u * cos - v * sin, y_m + u * sin + v * cos])

    def _box(self, tag: Tag) -> Values:
        length, width = (self._number(tag, name, 0.0, least=0.0) / 2 for name in ("length", "width"))
        return self._local(tag, length * np.array([1, 1, -1, -1]), width * np.array([-1, 1, 1, -1]))

    def _corners(self, tag: Tag, outline: Tag) -> Values:
        local, of_road = outline.findall("cornerLocal"), outline.findall("cornerRoad")
        if local:
            u, v = (np.array([self._number(corner, name) for corner in local]) for name in "uv")
            return self._local(tag, u, v)
        s, t = (np.array([self._number(corner, name) for corner in of_road]) for name in "st")
        return np.stack(self._line.beside(s, t)) if of_road else np.empty((2, 0))


def _outwards(lane: tuple[int, Tag]) -> int:
    return abs(lane[0])


def _piecewise(cubics: Sequence[tuple[float, Cubic]], s_m: Values) -> Values:
    """The value of the cubic that begins last before each place, and 0 before the first."""
    found = np.zeros(len(s_m))
    for begin_m, cubic in cubics:
        here = s_m >= begin_m
        found[here] = value(cubic, s_m[here] - begin_m)
    return found


def _distinct(shape: Values) -> Values:
    """Vertices of an outline without those that are their predecessor, or the last where it is the first."""
    return shape[:, np.any(shape != np.roll(shape, 1, axis=1), axis=0)]


def _thinned(line: Values) -> Values:
    """Vertices ``[3, points]``, x, y and width, without those between which nothing bends or widens."""
    line = line[:, np.concatenate([np.ones(1, bool), np.hypot(*np.diff(line[:2])) > 0])]
    steps = np.diff(line)
    length_m = np.hypot(steps[0], steps[1])
    direction = np.unwrap(np.arctan2(steps[1], steps[0]))
    slope = steps[2] / length_m
    keeps = (np.abs(np.diff(direction)) > _STRAIGHT_RAD) | (np.abs(np.diff(slope)) * length_m[1:] > _EVEN_M)
    return line[:, np.concatenate([np.ones(1, bool), keeps, np.ones(1, bool)])]
