"""Map rules: elements are whole, towns have maps, and what rollouts record of lanes, road and walls fits them.

Attempts in a town with a drivable surface that is not usable are no subjects of what is recomputed from surfaces.
Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds, spec_limits
from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.files.survey import Survey
from branchdrive.raw.lane_ends import lines_elsewhere, meetings
from branchdrive.raw.rules.responses import prevails
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import (
    POINTS,
    ground,
    is_surveyed,
    is_whole,
    lanes_under,
    least_vertices,
    shapes,
    walls_inside,
)
from branchdrive.tables.frame import repeated_rows

MIN_VEHICLES = 3
"""Vehicles below which a lane is not judged: one may overtake, and another may have lost its way."""


@rule("BD-MAP-001")
def elements_are_whole(view: ShardView) -> Iterator[Check]:
    """Lists of an element are equally long, with the vertices, widths and lane that its kind takes."""
    if "map" not in view:
        return
    elements, found = view.map, view.cached(shapes)

    def describe(row: int) -> tuple[str, str]:
        kind, counts = elements["kind"][row], found.counts[row]
        least, most = int(least_vertices(elements)[row]), spec_limits().max_route_vertices
        wanted = "1 vertex" if kind in POINTS else f"{least} .. {most} vertices, no two neighbours equal"
        needs = {"lane": " with widths and a lane_id", "shoulder": " with widths", "parking": " with widths"}
        names = (f"{n} {name}" for n, name in zip(counts.tolist(), ("x", "y", "z", "widths"), strict=True) if n >= 0)
        same = ", two neighbours equal" if found.repeats[row] else ""
        lane = "" if elements.valid("lane_id")[row] else ", no lane_id"
        return f"{kind}: {wanted}{needs.get(kind, '')}", f"{', '.join(names)}{same}{lane}"

    bad = np.flatnonzero(~view.cached(is_whole))
    yield Check.of_rows("map", "x_m", len(elements), bad, describe)


@rule("BD-MAP-002")
def elements_are_unique(view: ShardView) -> Iterator[Check]:
    """No element of a town twice."""
    if "map" not in view:
        return
    elements = view.map
    again = repeated_rows({name: elements[name] for name in ("town", "element_id")}, ("town", "element_id"))
    yield Check.of_rows("map", "element_id", len(elements), again, lambda _: ("one row of an element", "another row"))


@rule("BD-MAP-003")
def towns_have_maps(view: ShardView) -> Iterator[Check]:
    """The town of every rollout has a lane in the map of its shard."""
    if "map" not in view:
        return
    mapped = set(view.map["town"][view.map.equals("kind", "lane")])
    towns = view.rollouts["town"]
    bad = np.flatnonzero([town not in mapped for town in towns])
    yield Check.of_rows(
        "rollouts",
        "town",
        len(towns),
        bad,
        lambda row: ("a town with lanes in the map of the shard", quote(towns[row])),
    )


@rule("BD-MAP-004")
def towns_have_one_map(survey: Survey) -> Iterator[Check]:
    """The map of a town is the same in every shard that has it."""
    homes: dict[str, dict[str, str]] = {}
    num_shards = Counter(town for shard in survey.shards for town in shard.maps)
    for shard in survey.shards:
        for town, digest in shard.maps.items():
            homes.setdefault(town, {}).setdefault(digest, shard.folder)
    yield Check.of(
        sum(number > 1 for number in num_shards.values()),
        tuple(
            Mismatch({"table": "map", "town": town}, "one map in every shard", f"others in {', '.join(found.values())}")
            for town, found in homes.items()
            if len(found) > 1
        ),
    )


@rule("BD-MAP-010")
def lanes_run_as_they_are_driven(survey: Survey) -> Iterator[Check]:
    """Of the vehicles in a lane, nearly all do not drive against it."""
    use: dict[tuple[str, str], tuple[int, int]] = {}
    for shard in survey.shards:
        for lane, (along, against) in shard.lanes.items():
            known = use.get(lane, (0, 0))
            use[lane] = known[0] + along, known[1] + against
    judged = {lane: counts for lane, counts in use.items() if sum(counts) >= MIN_VEHICLES}
    yield Check.of(
        len(judged),
        [
            Mismatch(
                {"table": "map", "column": "x_m", "town": town, "lane_id": lane},
                "vertices in driving order",
                f"{against} of {along + against} vehicles that drive from its last vertex to its first",
            )
            for (town, lane), (along, against) in sorted(judged.items())
            if prevails(against, along + against, MIN_VEHICLES)
        ],
    )


@rule("BD-MAP-011")
def lanes_go_on_in_each_other(view: ShardView) -> Iterator[Check]:
    """No lane begins where another begins, or ends where another ends, head-on and without one that goes on."""
    if "map" not in view:
        return
    elements, found = view.map, view.cached(meetings)

    def describe(row: int) -> tuple[str, str]:
        other = quote(elements["element_id"][found.against[row]])
        return "an end at which another lane goes on in it", f"{other} alone, which is drawn against it"

    bad = np.flatnonzero(found.against >= 0)
    yield Check.of_rows("map", "x_m", int(found.compared.sum()), bad, describe)


@rule("BD-MAP-012")
def stop_lines_lie_at_their_lanes(view: ShardView) -> Iterator[Check]:
    """A vertex of a stop line lies near the centre line of a lane that it names."""
    if "map" not in view:
        return
    elements, (named, is_elsewhere) = view.map, view.cached(lines_elsewhere)
    text = f"a line within {physical_bounds().stop_line_m:g} m of the lane {{}}"
    yield Check.of_rows(
        "map", "lane_id", int(named.sum()), np.flatnonzero(is_elsewhere),
        lambda row: (text.format(quote(elements["lane_id"][row])), "no vertex that is so near"),
    )  # fmt: skip


def _at(marked: Mask, frame: NDArray[np.int64]) -> Mask:
    """Marks of observations by rows of evidence, off where a row has no observation."""
    return np.append(marked, False)[frame]


def _of_evidence(
    view: ShardView,
    subjects: Mask,
    column: str,
    compared: Mask,
    bad: Mask,
    describe: Callable[[int], tuple[str, str]],
) -> Check:
    """Check of attempts with evidence that is compared, by the rows of it that are bad, both ``[evidence]``."""
    evidence = view.stream("evidence")
    subjects = subjects & evidence.by_rollout(compared).any
    summary = evidence.by_rollout(compared & bad)

    def mismatch(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        place: dict[str, str | int] = {"table": "evidence", "column": column, "tick": int(evidence.tick[row])}
        return Mismatch(place, *describe(row), int(summary.count[i]))

    return Check.of_subjects(subjects, subjects & summary.any, mismatch, summary.stretch)


@rule("BD-MAP-005")
def lanes_recompute(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``lane_id`` is a lane under the ego's centre, and null only where there is none."""
    if "map" not in view or "evidence" not in view:
        return
    evidence, under = view.stream("evidence"), view.cached(ground)
    frame = view.observations.rows_of(evidence)
    named = evidence.valid("lane_id")
    bad = np.where(named, ~_at(under.fits_lane, frame), _at(under.has_lane, frame))

    def describe(row: int) -> tuple[str, str]:
        lanes = _names(view, lanes_under(view, int(frame[row])))
        return f"one of {lanes[:4]}" if lanes else "null: no lane is there", quote(evidence["lane_id"][row] or None)

    yield _of_evidence(view, subjects & view.cached(is_surveyed), "lane_id", frame >= 0, bad, describe)


def _names(view: ShardView, lanes: list[int]) -> list[str]:
    return sorted({str(view.map["lane_id"][lane]) for lane in lanes})


@rule("BD-MAP-006")
def road_recomputes(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``on_road`` holds exactly where a lane, shoulder, parking strip or road area lies under the ego's centre."""
    if "map" not in view or "evidence" not in view:
        return
    evidence, under = view.stream("evidence"), view.cached(ground)
    frame = view.observations.rows_of(evidence)
    recorded = evidence["on_road"].astype(bool)
    bad = np.where(recorded, ~_at(under.may_be_on_road, frame), _at(under.is_on_road, frame))
    yield _of_evidence(
        view,
        subjects & view.cached(is_surveyed),
        "on_road",
        frame >= 0,
        bad,
        lambda row: (
            ("false: no drivable surface is there", "true")
            if recorded[row]
            else ("true: a drivable surface is there", "false")
        ),
    )


@rule("BD-MAP-009")
def lights_are_of_signals(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``traffic_light`` is unavailable in towns whose map holds no signal."""
    if "map" not in view or "evidence" not in view:
        return
    evidence = view.stream("evidence")
    with_signals = set(view.map["town"][view.map.equals("kind", "signal")])
    lacks_one = np.array([*(town not in with_signals for town in view.rollouts["town"]), False], bool)
    compared, shows_one = lacks_one[evidence.rollout], evidence["traffic_light_available"].astype(bool)

    def describe(row: int) -> tuple[str, str]:
        return "unavailable: the map of the town holds no signal", quote(str(evidence["traffic_light"][row]))

    yield _of_evidence(view, subjects, "traffic_light", compared, shows_one, describe)


@rule("BD-MAP-007")
def speed_limits_recompute(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``speed_limit_mps`` is that of a lane under the ego's centre, where both are known."""
    if "map" not in view:
        return
    observations, under = view.observations, view.cached(ground)
    subjects = subjects & view.cached(is_surveyed) & observations.by_rollout(under.meets_limit).any
    summary = observations.by_rollout(under.has_limit & ~under.fits_limit)

    def mismatch(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        lanes = lanes_under(view, row)
        limits = sorted({round(float(view.map["speed_limit_mps"][lane]), 2) for lane in lanes})
        expected = f"{' or '.join(map(quote, limits))} of {_names(view, lanes)[:4]}"
        place: dict[str, str | int] = {
            "table": "observations", "column": "speed_limit_mps", "tick": int(observations.tick[row]),
        }  # fmt: skip
        return Mismatch(place, expected, quote(observations["speed_limit_mps"][row]), int(summary.count[i]))

    yield Check.of_subjects(subjects, subjects & summary.any, mismatch, summary.stretch)


@rule("BD-MAP-008")
def wall_contacts_are_recorded(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``collision`` holds where a wall reaches into the ego's box; attempts in towns without walls are no subjects."""
    if "map" not in view or "evidence" not in view:
        return
    walled = set(view.map["town"][view.map.equals("kind", "wall")])
    subjects = subjects & np.array([town in walled for town in view.rollouts["town"]], bool) & view.cached(is_surveyed)
    evidence = view.stream("evidence")
    frame, wall = view.observations.rows_of(evidence), walls_inside(view)
    bad = _at(wall >= 0, frame) & ~evidence["collision"].astype(bool)

    def describe(row: int) -> tuple[str, str]:
        name = quote(view.map["element_id"][wall[frame[row]]])
        return f"true: the wall {name} reaches into the box of the ego", "false"

    yield _of_evidence(view, subjects, "collision", frame >= 0, bad, describe)
