"""What a group is like, whatever its names, its place and its direction: a few numbers that tell near copies.

Source: spec/07-rules.md#response.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import FUTURE_OFFSETS, HISTORY_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.files.group_marks import Outlines
from branchdrive.files.identities import Identities
from branchdrive.raw.motion.response import Executed
from branchdrive.raw.shard_view import ShardView

__all__ = ["OUTLINE_OFFSETS", "outlines"]

Array = NDArray[np.float64]

OUTLINE_OFFSETS = (-75, -50, -25, 0, 25, 50)
"""Observations of the nominal whose pose and speed are part of an outline."""

_AT = [(PREDECESSOR_OFFSET, *HISTORY_OFFSETS, *FUTURE_OFFSETS).index(offset) for offset in OUTLINE_OFFSETS]
_AT_BRANCH = _AT[OUTLINE_OFFSETS.index(0)]


@np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
def outlines(view: ShardView, executed: Executed) -> Outlines:
    """Outline of each group with an intervention and with an actor at its branch.

    Places are seen from the nominal at the branch, metres ahead and to the left: of the nominal at `OUTLINE_OFFSETS`,
    with its speeds, ``[18]``; of each policy at the end, NaN where it was not executed, ``[2 policies]``; and the
    number of actors at the branch with the mean of their places ``[3]``.
    """
    if "actors" not in view:
        return Outlines.none()
    actors, num_policies = view.stream("actors"), len(view.descriptor.action_bank.policies)
    groups, first, member = np.unique(executed.group, return_index=True, return_inverse=True)
    reference = executed.reference[:, first]
    x_0, y_0, yaw, _ = reference[:, :, _AT_BRANCH]
    cos, sin = np.cos(yaw), np.sin(yaw)

    def seen(group: NDArray[np.intp], x_m: Array, y_m: Array) -> tuple[Array, Array]:
        dx, dy = x_m - x_0[group], y_m - y_0[group]
        return cos[group] * dx + sin[group] * dy, cos[group] * dy - sin[group] * dx

    every = np.arange(len(groups))
    own = [*(np.stack(seen(every, *reference[:2, :, at]), axis=1) for at in _AT), reference[3][:, _AT]]
    ends = np.full((len(groups), num_policies, 2), np.nan)
    ends[member, executed.policy] = np.stack(seen(member, *executed.state[:2, :, -1]), axis=1)
    nominal = executed.nominal[first]
    start, stop = actors.span(nominal, view.branch_tick[nominal])
    count = stop - start
    owner = np.repeat(every, count)
    row = np.arange(len(owner)) + np.repeat(start - np.cumsum(count) + count, count)
    places = seen(owner, *(actors[name][row].astype(np.float64) for name in ("x_m", "y_m")))
    means = [np.bincount(owner, place, len(groups)) / np.maximum(count, 1) for place in places]
    found = np.concatenate(
        [*own, ends.reshape(len(groups), ends.size // max(1, len(groups))), np.stack([count, *means], axis=1)], axis=1
    )
    has_actor = count > 0
    return Outlines(Identities(view.group_ids), groups[has_actor].astype(np.int32), found[has_actor])
