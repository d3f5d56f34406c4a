"""Coverage rules: over the whole dataset, rows of actors begin and end where actors come into range and leave it.

Source: spec/05-raw-streams.md#completeness.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.driving.risk import RANGE_M
from branchdrive.driving.track_end import CLASSES, MEASURES, TrackEnds
from branchdrive.files.survey import Survey
from branchdrive.raw.rules.responses import MIN_EQUAL, MIN_INTERVENTIONS, prevails

_ROWS: Location = {"table": "actors", "column": "x_m"}


def _ends(survey: Survey) -> TrackEnds:
    return TrackEnds.of_all(shard.track_ends for shard in survey.shards)


def _of_enough_groups(ends: TrackEnds, chosen: Mask) -> bool:
    """Whether there are enough of these ends, in three groups or more: attempts of a group are alike."""
    return int(chosen.sum()) >= MIN_INTERVENTIONS and len(np.unique(ends.group[chosen])) >= MIN_EQUAL


@rule("BD-ACT-006")
def actors_come_and_go_beyond_the_range(survey: Survey) -> Iterator[Check]:
    """No distance below the range is one at which actors come and go, and beyond which nobody has a row."""
    ends, edge_m, examined = _ends(survey), physical_bounds().edge_m, 0
    found: list[Mismatch] = []
    kinds = {"actors": np.ones(len(ends.kind), bool)} | {name: ends.kind == i for i, name in enumerate(CLASSES)}
    for name, own in kinds.items():
        farthest_m = ends.farthest_m if name == "actors" else ends.farthest_m[[CLASSES.index(name)]]
        examined += _of_enough_groups(ends, own)
        near = own & ends.in_range
        for measure, text in enumerate(MEASURES):
            limit_m = float(farthest_m[:, measure].max())
            at_edge = near & (ends.beyond_m[:, measure] >= limit_m - edge_m)
            both = min((at_edge & ends.is_begin).sum(), (at_edge & ~ends.is_begin).sum()) >= MIN_EQUAL
            if not found and both and _of_enough_groups(ends, near) and prevails(at_edge.sum(), near.sum()):
                expected = f"rows of {name} up to {RANGE_M:g} m from the ego, and as they come and go"
                most = f"none further than {limit_m:.1f} m {text}"
                found.append(
                    Mismatch({**_ROWS}, expected, f"{most}, where {at_edge.sum()} of {near.sum()} tracks begin or end")
                )
    yield Check.of(examined, found)


@rule("BD-ACT-007")
def tracks_begin_and_end_at_the_range(survey: Survey) -> Iterator[Check]:
    """Of the tracks that begin between two observations, and of those that end there, not nearly all do so in range."""
    ends, found, examined = _ends(survey), [], 0
    for own, text in ((ends.is_begin, "begin"), (~ends.is_begin, "end")):
        near = own & ends.in_range
        examined += _of_enough_groups(ends, own)
        if _of_enough_groups(ends, own) and prevails(near.sum(), own.sum()):
            expected = f"tracks that {text} where actors {'come into' if text == 'begin' else 'leave'} the range"
            found.append(
                Mismatch({**_ROWS}, expected, f"{near.sum()} of {own.sum()} tracks that {text} well within it")
            )
    yield Check.of(examined, found)
