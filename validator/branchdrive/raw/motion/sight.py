"""What the images of each camera show of the responses of interventions, where replays are exact.

Source: spec/07-rules.md#response.
"""

from __future__ import annotations

import numpy as np

from branchdrive.contract.timing import FUTURE_OFFSETS
from branchdrive.driving.response import NO_RESPONSE, Responses, Sights
from branchdrive.raw.image_index import ImageIndex
from branchdrive.raw.motion.response import Executed
from branchdrive.raw.shard_view import ShardView

__all__ = ["sights"]

_OFFSETS = np.array((0, *FUTURE_OFFSETS))


@np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
def sights(view: ShardView, executed: Executed, found: Responses) -> dict[str, Sights]:
    """What each camera shows of the interventions that respond after the branch and have an image of that observation.

    Args:
        view: The shard.
        executed: Its interventions.
        found: What they do, in the same order.
    """
    if "frames" not in view:
        return {}
    images = view.cached(ImageIndex)
    kept = np.flatnonzero(found.is_commanded & (found.first > 0) & (found.first != NO_RESPONSE))
    away_m = np.hypot(*(executed.state - executed.reference)[:2, kept, -len(_OFFSETS) :])
    own, nominal = executed.own[kept], executed.nominal[kept]
    ticks, at, every = view.branch_tick[own][:, None] + _OFFSETS, found.first[kept], np.arange(len(kept))
    seen = {}
    for code, camera in enumerate(images.cameras):
        rows, others = (images.find(one[:, None], code, ticks) for one in (own, nominal))
        has_both = (rows >= 0) & (others >= 0)
        differs = has_both & images.differ(rows, others)
        shown_m = np.where(differs.any(axis=1), away_m[every, differs.argmax(axis=1)], np.nan)
        counts = has_both[every, at]
        seen[camera] = Sights(away_m[every, at][counts], ~differs[every, at][counts], shown_m[counts])
    return seen
