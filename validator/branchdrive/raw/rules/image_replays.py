"""Image replay rules: where replays are exact, attempts hold the images of their nominals, before the branch and after.

Source: spec/05-raw-streams.md#replay-noise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.raw.image_index import ImageIndex
from branchdrive.raw.rules.replays import comparable_replays, complete_interventions
from branchdrive.raw.shard_view import ShardView


@rule("BD-RPN-004")
def exact_images_are_equal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where replays are declared to be exact, an intervention holds the images of its nominal before the branch."""
    if "frames" in view:
        yield _images_of_nominals(view, complete_interventions(view, subjects), view.branch_tick)


@rule("BD-RPN-006")
def images_of_exact_replays_are_equal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where replays are declared to be exact, a nominal replay holds the images of its nominal."""
    if "frames" in view:
        always = np.full(view.num_rollouts, np.iinfo(np.int64).max)
        yield _images_of_nominals(view, comparable_replays(view, subjects), always)


def _images_of_nominals(view: ShardView, judged: Mask, last_tick: NDArray[np.int64]) -> Check:
    """Whether attempts hold the images of their nominals up to a tick, where both have one ``[rollouts]``."""
    frames, images = view.stream("frames"), view.cached(ImageIndex)
    if view.descriptor.collection.replay_noise.kind != "exact":
        judged = np.zeros_like(judged)
    rows = np.flatnonzero((frames.rollout >= 0) & np.append(judged, False)[frames.rollout])
    rows = rows[frames.tick[rows] <= last_tick[frames.rollout[rows]]]
    of_nominal = images.find(view.nominal[frames.rollout[rows]], images.camera[rows], frames.tick[rows])
    rows, of_nominal = rows[of_nominal >= 0], of_nominal[of_nominal >= 0]
    compared, differs = (np.zeros(len(frames), bool) for _ in range(2))
    compared[rows], differs[rows] = True, images.differ(rows, of_nominal)
    summary = frames.by_rollout(differs)
    judged = judged & frames.by_rollout(compared).any

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        name, tick = str(frames["camera"][row]), int(frames.tick[row])
        location: Location = {"table": "frames", "column": "checksum", "tick": tick, "camera": name}
        found = f"another image of {name}"
        return Mismatch(location, f"the image of {name} of the nominal", found, int(summary.count[i]))

    return Check.of_subjects(judged, judged & summary.any, describe, summary.stretch)
