"""Extent rules: every ego and road user is as large as its class can be, and most vehicles as wide as road vehicles.

Source: spec/05-raw-streams.md#plausible-extents.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.files.survey import Survey
from branchdrive.raw.motion.extent import most_m
from branchdrive.raw.motion.tracks import tracks
from branchdrive.raw.rules.responses import MIN_INTERVENTIONS, prevails
from branchdrive.raw.shard_view import ShardView

_EXTENTS = ("length_m", "width_m", "height_m")


def _described(place: Location, class_name: str, extent: int, found_m: float, num_rows: int = 1) -> Mismatch:
    least = f"{physical_bounds().body_m:g} to " if extent < 2 else "up to "
    return Mismatch(place, f"{class_name}: {least}{most_m(class_name)[extent]:g} m", f"{found_m:.3g} m", num_rows)


@rule("BD-BOX-002")
def extents_fit_their_class(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No road user is thinner than a hand, longer than a road train, or larger than its class can be."""
    checks, least_m = [], (physical_bounds().body_m, physical_bounds().body_m, 0.0)
    for k, name in enumerate(_EXTENTS):
        column = f"ego_{name}"
        extent_m = view.rollouts[column]
        beyond = view.rollouts.valid(column) & ~((extent_m >= least_m[k]) & (extent_m <= most_m("vehicle")[k]))

        def of_ego(i: int, k: int = k, column: str = column, extent_m: NDArray[np.float32] = extent_m) -> Mismatch:
            return _described({"table": "rollouts", "column": column}, "vehicle", k, float(extent_m[i]))

        checks.append(Check.of_subjects(subjects, subjects & beyond, of_ego))
    if "actors" in view:
        checks += [_of_actors(view, subjects, k, least_m[k]) for k in range(len(_EXTENTS))]
    yield Check.of_any(*checks)


def _of_actors(view: ShardView, subjects: Mask, k: int, least_m: float) -> Check:
    """Check of attempts by one extent of their tracks, at the rows that begin them: extents are those of a track."""
    stream, name = view.stream("actors"), _EXTENTS[k]
    row, previous, *_ = view.cached(tracks)
    rows = row[previous < 0]
    codes, classes = stream.categories("actor_class")
    most = np.array([*(most_m(each)[k] for each in classes), np.inf])[codes[rows]]
    least = np.array([*(least_m if np.isfinite(most_m(each)[k]) else 0.0 for each in classes), 0.0])[codes[rows]]
    extent_m = stream[name][rows]
    marked = np.zeros(len(stream), bool)
    marked[rows[stream.valid(name)[rows] & ~((extent_m >= least) & (extent_m <= most))]] = True
    summary = stream.by_rollout(marked)

    def describe(i: int) -> Mismatch:
        at = int(summary.first_row[i])
        place: Location = {
            "table": "actors", "column": name, "tick": int(stream["tick"][at]), "actor_id": int(stream["actor_id"][at]),
        }  # fmt: skip
        return _described(place, str(stream["actor_class"][at]), k, float(stream[name][at]), int(summary.count[i]))

    return Check.of_subjects(subjects, subjects & summary.any, describe, summary.stretch)


@rule("BD-BOX-003")
def vehicles_are_as_wide_as_vehicles(survey: Survey) -> Iterator[Check]:
    """Where nearly all egos or vehicles are too narrow or too wide for the road, extents are halved or swapped."""
    bounds, found, examined = physical_bounds(), [], 0
    for table, column in (("rollouts", "ego_width_m"), ("actors", "width_m")):
        widths = [shard.widths[table] for shard in survey.shards if table in shard.widths]
        num_narrow, num_wide, num_all = (sum(counts) for counts in zip(*widths, strict=True)) if widths else (0, 0, 0)
        examined += num_all >= MIN_INTERVENTIONS
        for count, text in ((num_narrow, "narrower"), (num_wide, "wider")):
            if prevails(count, num_all):
                expected = f"widths of {bounds.narrow_vehicle_m:g} to {bounds.wide_vehicle_m:g} m of most vehicles"
                place: Location = {"table": table, "column": column}
                found.append(Mismatch(place, expected, f"{count} of {num_all} that are {text}"))
    yield Check.of(examined, found)
