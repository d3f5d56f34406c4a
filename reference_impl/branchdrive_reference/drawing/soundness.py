"""Whether what was read of a group can be drawn: texts of bounded length, numbers that are numbers, whole routes.

A picture is no judgement of a dataset, so the bounds are wide: within them everything draws.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.timing import ACTIVE_TICKS
from branchdrive.errors import UsageError
from branchdrive_reference.study.label import MAX_TEXT_CHARACTERS, label

if TYPE_CHECKING:
    from branchdrive_reference.drawing.scene import Actor, Candidate, Scene

__all__ = ["check_scene"]

_LARGEST = 1e7
"""No number of a picture is larger; the format ends positions here, in metres."""

_LARGEST_BOX_M = 100.0

_TEXTS = ("group_id", "scenario_type", "town", "route_id", "environment", "trigger_signal")
_NUMBERS = ("branch_tick", "trigger_tick", "trigger_value", "trigger_threshold", "trigger_confidence")


def check_scene(scene: Scene) -> None:
    """Refuse a scene that holds what cannot be drawn.

    Raises:
        UsageError: With the group and the first fault.
    """
    fault = next(_faults(scene), None)
    if fault is not None:
        raise UsageError(
            f"group '{label(scene.record['group_id'])}' cannot be drawn: {fault}; run `branchdrive-validate`"
        )


def _faults(scene: Scene) -> Iterator[str]:
    record = scene.record
    for name in _TEXTS:
        if not isinstance(record[name], str):
            yield f"`{name}` is absent"
        elif len(record[name]) > MAX_TEXT_CHARACTERS:
            yield f"`{name}` has {len(record[name]):,} characters and may have {MAX_TEXT_CHARACTERS:,}"
    for name in _NUMBERS:
        if record[name] is None or not _are_numbers(record[name]):
            yield f"`{name}` is {'absent' if record[name] is None else record[name]}"
    for name in ("ego_length_m", "ego_width_m"):
        if not _is_extent(record[name]):
            yield f"`{name}` is {record[name]}"
    yield from _route_faults(record)
    for candidate in scene.candidates:
        yield from _candidate_faults(candidate)
    for actor in scene.actors:
        yield from _actor_faults(actor)


def _are_numbers(values: Any) -> bool:
    """Whether all of some numbers are finite and not enormous."""
    return bool((np.abs(np.asarray(values, np.float64)) <= _LARGEST).all())


def _is_extent(value_m: float) -> bool:
    return 0.0 < value_m <= _LARGEST_BOX_M


def _route_faults(record: dict[str, Any]) -> Iterator[str]:
    x_m, y_m = record["route_x_m"], record["route_y_m"]
    most = spec_limits().max_route_vertices
    if len(x_m) != len(y_m) or not 2 <= len(x_m) <= most:
        yield f"its route has {len(x_m):,} x and {len(y_m):,} y values, not both the same 2 .. {most:,}"
    elif not _are_numbers([x_m, y_m]):
        yield "its route has a vertex that is no place"


def _candidate_faults(candidate: Candidate) -> Iterator[str]:
    whose = f"of candidate {candidate.policy.key!r}"
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps"):
        if not _are_numbers(getattr(candidate, name)):
            yield f"`{name}` {whose} is no number at some tick"
    if (candidate.separation_m < 0).any() or np.isinf(candidate.separation_m).any():
        yield f"`separation_m` {whose} is no distance at some tick"


def _actor_faults(actor: Actor) -> Iterator[str]:
    for name in ("x_m", "y_m", "yaw_rad", "vel_x_mps", "vel_y_mps"):
        if not _are_numbers(getattr(actor, name)):
            yield f"`{name}` of actor {actor.actor_id} is no number at some tick"
    if len(actor.x_m) > ACTIVE_TICKS + 1:
        yield f"actor {actor.actor_id} has {len(actor.x_m):,} poses in a future of {ACTIVE_TICKS} ticks"
    for name in ("length_m", "width_m"):
        if not _is_extent(getattr(actor, name)):
            yield f"`{name}` of actor {actor.actor_id} is {getattr(actor, name)}"
