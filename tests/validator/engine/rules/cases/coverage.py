"""Defects and limits of how completely actors have rows, over the whole dataset."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
from tests.synthetic import BRANCH_TICK, to_table
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.responses import seen_again
from tests.validator.engine.rules.draft import Draft

FIRST = BRANCH_TICK - 75


POST_M = (0.5, 0.5, 0.75)


PLACE = {"table": "actors", "column": "x_m"}


def _posts(d: Draft) -> None:
    """Put posts along both sides of every route, 20 m beside it and so in nobody's way."""
    for folder, shard in d.tables.items():
        routes = {row["rollout_id"]: row for row in shard["rollouts"].to_pylist()}
        for row in shard["observations"].select(["rollout_id", "tick"]).to_pylist():
            route = routes[row["rollout_id"]]
            route.setdefault("ticks", []).append(row["tick"])
        columns: dict[str, list[object]] = {name: [] for name in shard["actors"].column_names}
        for rollout_id, route in routes.items():
            places = _beside(*(np.array(route[f"route_{axis}_m"]) for axis in "xy"))
            for number, (x, y) in enumerate(places):
                box = dict(zip(("length_m", "width_m", "height_m"), POST_M, strict=True))
                for tick in route["ticks"]:
                    row = {
                        "rollout_id": rollout_id, "tick": tick, "actor_id": 100 + number, "actor_class": "static",
                        "x_m": x, "y_m": y, "yaw_rad": 0.0, "vel_x_mps": 0.0, "vel_y_mps": 0.0, **box,
                    }  # fmt: skip
                    for name, value in row.items():
                        columns[name].append(value)
        d.append("actors", to_table("actors", columns), folder=folder)


def _beside(x: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
    """Places 20 m to either side of a line, from 60 m before its start on."""
    along = np.array([x[1] - x[0], y[1] - y[0]])
    along /= np.hypot(*along)
    left = np.array([-along[1], along[0]])
    start = np.array([x[0], y[0]])
    places = [start + s * along + side * 20.0 * left for s in range(-60, 120, 12) for side in (-1, 1)]
    return [(float(place[0]), float(place[1])) for place in places]


def _keep(d: Draft, is_kept: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]) -> None:
    """Leave rows of actors out by their distance from the ego, their tick and the tick at which their track begins."""

    def change() -> None:
        for shard in d.tables.values():
            actors, rows = shard["actors"], shard["observations"].to_pylist()
            ego = {(row["rollout_id"], row["tick"]): (row["x_m"], row["y_m"]) for row in rows}
            keys = list(zip(actors["rollout_id"].to_pylist(), actors["tick"].to_pylist(), strict=True))
            x, y = np.array([ego[key] for key in keys]).T
            away = np.hypot(actors["x_m"].to_numpy() - x, actors["y_m"].to_numpy() - y)
            tick, ids = actors["tick"].to_numpy(), actors["actor_id"].to_pylist()
            begins: dict[tuple[str, int], int] = {}
            for (rollout_id, moment), actor_id, distance in zip(keys, ids, away.tolist(), strict=True):
                if distance <= 45.0 and moment >= FIRST:
                    begins.setdefault((rollout_id, actor_id), moment)
            begin = np.array([begins.get((k[0], i), 10**6) for k, i in zip(keys, ids, strict=True)])
            shard["actors"] = actors.filter(pa.array(is_kept(away, tick, begin)))

    seen_again(d, change)


# BD-ACT-006


@mutant("BD-ACT-006", at=PLACE)
def rows_up_to_thirty_metres(d: Draft) -> None:
    _posts(d)
    _keep(d, lambda away, *_: away <= 30.0)


@mutant("BD-ACT-006", at=PLACE)
def range_between_centres(d: Draft) -> None:
    """Boxes are nearer to each other by half their lengths."""
    _posts(d)
    _keep(d, lambda away, *_: away <= 48.0)


@boundary("BD-ACT-006", "BD-ACT-007")
def rows_up_to_the_range(d: Draft) -> None:
    _posts(d)
    _keep(d, lambda away, *_: away <= 53.5)


# BD-ACT-007


@mutant("BD-ACT-007", at=PLACE)
def tracks_without_their_first_second(d: Draft) -> None:
    _posts(d)
    _keep(d, lambda away, tick, begin: (away <= 53.5) & (tick >= begin + 20 * (begin > FIRST)))
