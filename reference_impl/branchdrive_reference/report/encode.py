"""A scene as the player reads it: a small document, and all series of it as one text.

`decode.js` takes the series in the order in which they are packed here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from branchdrive_reference.drawing.scene import HISTORY_TICKS
from branchdrive_reference.report.packing import Packer, quantised
from branchdrive_reference.report.scene import Future, Scene, Track

__all__ = ["STEPS", "encoded_scene"]

STEPS = {"place_m": 0.02, "yaw_rad": 0.005, "speed_mps": 0.02, "gap_m": 0.02, "control": 0.01}
"""How finely series are kept, by what they are."""

_CLASSES = ("vehicle", "cycle", "pedestrian", "static")


def encoded_scene(scene: Scene) -> dict[str, Any]:
    """The scene as a document.

    Futures whose history looks like that of the nominal name it instead of a copy; so do actors that move as they do
    beside the nominal.
    """
    packer = Packer()
    nominal = scene.futures[0]
    _pack_places(packer, *scene.route, scene.origin)
    return {
        "box": [round(size, 3) for size in scene.box_m],
        "heading": round(scene.origin[2], 5),
        "branch": nominal.branch_tick,
        "route": len(scene.route[0]),
        "futures": [_future(packer, future, nominal, scene.origin) for future in scene.futures],
        "data": packer.text(),
    }


def _future(packer: Packer, future: Future, nominal: Future, origin: tuple[float, float, float]) -> dict[str, Any]:
    shares = future is not nominal and _shares_history(future, nominal)
    if not (shares or future is nominal or future.is_marked):
        future = future.since(-HISTORY_TICKS)
    rows = future.tick > 0 if shares else np.ones(len(future.tick), bool)
    commands = future.control_tick >= 0 if shares else np.ones(len(future.control_tick), bool)
    packer.add(future.tick[rows], order=2)
    _pack_places(packer, future.x_m[rows], future.y_m[rows], origin)
    packer.add(quantised(future.yaw_rad[rows], STEPS["yaw_rad"]), order=2)
    packer.add(quantised(future.speed_mps[rows], STEPS["speed_mps"]))
    packer.add(quantised(future.gap_m[rows], STEPS["gap_m"]))
    packer.add(future.touched[rows].astype(np.int64))
    packer.add(future.control_tick[commands], order=2)
    for command in future.controls[:, commands]:
        packer.add(quantised(command, STEPS["control"]))
    actors = []
    for actor_id, track in future.tracks.items():
        kept = track.only(track.tick > 0) if shares else track
        other = nominal.tracks.get(actor_id) if future is not nominal else None
        entry: list[int] = [actor_id]
        if other is not None and _moves_alike(kept, other):
            entry += [-1, int(kept.tick[0]), int(kept.tick[-1])]
        else:
            entry += [len(kept.tick), _class(track), round(100 * track.length_m), round(100 * track.width_m)]
            packer.add(kept.tick, order=2)
            _pack_places(packer, kept.x_m, kept.y_m, origin)
            packer.add(quantised(kept.yaw_rad, STEPS["yaw_rad"]), order=2)
        actors.append(entry)
    other_branch = {} if future.branch_tick == nominal.branch_tick else {"branch": future.branch_tick}
    return other_branch | {
        "key": future.policy.key,
        "shares": shares,
        "rows": int(rows.sum()),
        "commands": int(commands.sum()),
        "actors": actors,
    }


def _pack_places(packer: Packer, x_m: Any, y_m: Any, origin: tuple[float, float, float]) -> None:
    packer.add(quantised(x_m - origin[0], STEPS["place_m"]), order=2)
    packer.add(quantised(y_m - origin[1], STEPS["place_m"]), order=2)


def _class(track: Track) -> int:
    return _CLASSES.index(track.actor_class) if track.actor_class in _CLASSES else len(_CLASSES)


def _shares_history(future: Future, nominal: Future) -> bool:
    """Whether everything before the branch, and the observation of the branch, looks like that of the nominal."""

    def before(one: Future) -> list[tuple[Any, float]]:
        rows, commands = one.tick <= 0, one.control_tick < 0
        return [
            (one.tick[rows], 0.0),
            *((values[rows], STEPS["place_m"]) for values in (one.x_m, one.y_m)),
            (one.yaw_rad[rows], STEPS["yaw_rad"]),
            (one.speed_mps[rows], STEPS["speed_mps"]),
            (one.gap_m[rows], STEPS["gap_m"]),
            (one.touched[rows].astype(np.int64), 0.0),
            (one.control_tick[commands], 0.0),
            *((command[commands], STEPS["control"]) for command in one.controls),
        ]

    pairs = zip(before(future), before(nominal), strict=True)
    if not all(_alike(values, others, step) for (values, step), (others, _) in pairs):
        return False
    own, other = _began(future), _began(nominal)
    return own.keys() == other.keys() and all(_look_alike(own[name], other[name]) for name in own)


def _alike(values: Any, others: Any, step: float) -> bool:
    """Whether two series differ by half a step at most, which cannot be seen."""
    if len(values) != len(others):
        return False
    with np.errstate(all="ignore"):
        is_close = np.abs(values - others) <= step / 2
    return bool((is_close | ((values != values) & (others != others))).all())


def _began(future: Future) -> dict[int, Track]:
    """What is recorded of the actors up to the branch."""
    parts = {name: track.only(track.tick <= 0) for name, track in future.tracks.items()}
    return {name: track for name, track in parts.items() if len(track.tick)}


def _moves_alike(track: Track, other: Track) -> bool:
    """Whether another track holds this one between its first and its last tick."""
    if not len(track.tick):
        return False
    return _look_alike(track, other.only((other.tick >= track.tick[0]) & (other.tick <= track.tick[-1])))


def _look_alike(track: Track, other: Track) -> bool:
    sizes = (track.actor_class, track.length_m, track.width_m), (other.actor_class, other.length_m, other.width_m)
    return (
        sizes[0] == sizes[1]
        and _alike(track.tick, other.tick, 0.0)
        and _alike(track.x_m, other.x_m, STEPS["place_m"])
        and _alike(track.y_m, other.y_m, STEPS["place_m"])
        and _alike(track.yaw_rad, other.yaw_rad, STEPS["yaw_rad"])
    )
