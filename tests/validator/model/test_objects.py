"""Objects of the model layer, computed again from raw tables by loops over their rows, with another library's boxes."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pandas as pd
import shapely
from shapely import affinity
from tests import synthetic_release
from tests.validator.engine.rules.release import built

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.object_sensor import POSITION_SD_M, VELOCITY_SD_MPS, YAW_SD_RAD

NOISE = {"x_m": POSITION_SD_M, "y_m": POSITION_SD_M, "vel_x_mps": VELOCITY_SD_MPS, "vel_y_mps": VELOCITY_SD_MPS}


@cache
def objects() -> pd.DataFrame:
    return pd.DataFrame({name: np.ma.getdata(values) for name, values in built().rows["objects"].items()})


@cache
def expected() -> pd.DataFrame:
    """Objects without noise, with the tick and the actor that each was measured of."""
    rows = []
    candidates = built().rows["candidates"]
    chosen = candidates["rollout_id"][candidates["action_key"] == "nominal"]
    for shard in synthetic_release.RELEASE_SHARDS:
        tables = synthetic_release.raw_tables()[shard]
        raw = {name: tables[name].to_pandas() for name in ("rollouts", "observations", "actors")}
        for _, nominal in raw["rollouts"][raw["rollouts"]["rollout_id"].isin(chosen)].iterrows():
            own = {name: raw[name][raw[name]["rollout_id"] == nominal["rollout_id"]] for name in raw}
            numbers: dict[int, int] = {}
            for offset in HISTORY_OFFSETS:
                tick = nominal["branch_tick"] + offset
                (ego,) = own["observations"][own["observations"]["tick"] == tick].itertuples()
                key = {"group_id": nominal["group_id"], "offset_ticks": offset}
                rows += [
                    {**key, "object_index": numbers.setdefault(one.actor_id, len(numbers)), **_measured(ego, one)}
                    for one in _seen(ego, own["actors"][own["actors"]["tick"] == tick])
                ]
    return pd.DataFrame(rows)


def _seen(ego, actors):  # type: ignore[no-untyped-def]
    """Actors in range and in sight, the nearest first."""
    far = np.hypot(actors["x_m"] - ego.x_m, actors["y_m"] - ego.y_m)
    near = actors.assign(far=far)[far <= 50].sort_values(["far", "actor_id"]).head(32)
    boxes = {
        one.actor_id: affinity.translate(
            affinity.rotate(
                shapely.box(-one.length_m / 2, -one.width_m / 2, one.length_m / 2, one.width_m / 2),
                one.yaw_rad,
                use_radians=True,
            ),
            one.x_m,
            one.y_m,
        )
        for one in near.itertuples()
    }
    for one in near.itertuples():
        own = boxes[one.actor_id]
        ways = [
            shapely.LineString([(ego.x_m, ego.y_m), point])
            for point in (own.centroid.coords[0], *own.exterior.coords[:4])
        ]
        others = [box for name, box in boxes.items() if name != one.actor_id]
        if any(all(way.intersection(box).length == 0 for box in others) for way in ways):
            yield one


def _measured(ego, actor):  # type: ignore[no-untyped-def]
    turn = complex(math.cos(ego.yaw_rad), -math.sin(ego.yaw_rad))
    place = turn * complex(actor.x_m - ego.x_m, actor.y_m - ego.y_m)
    velocity = turn * complex(actor.vel_x_mps, actor.vel_y_mps)
    return {
        "object_class": actor.actor_class,
        "x_m": place.real, "y_m": place.imag, "vel_x_mps": velocity.real, "vel_y_mps": velocity.imag,
        "yaw_rad": actor.yaw_rad - ego.yaw_rad, "length_m": actor.length_m, "width_m": actor.width_m,
    }  # fmt: skip


def test_objects_are_those_that_loops_over_raw_rows_find() -> None:
    key = [*LAYER_TABLES["objects"].key, "object_class"]
    found, wanted = (frame[key].sort_values(key).to_numpy().tolist() for frame in (objects(), expected()))
    assert found == wanted
    assert len(objects()) > 500
    assert len({*objects()["object_class"]}) > 2


def test_noise_has_the_declared_deviations_and_no_bias() -> None:
    key = list(LAYER_TABLES["objects"].key)
    both = objects().merge(expected(), on=key, suffixes=("", "_true"))
    assert len(both) == len(objects())
    deviations = {name: (both[name] - both[f"{name}_true"]) / sd for name, sd in NOISE.items()}
    turned = both["yaw_rad"] - both["yaw_rad_true"]
    deviations["yaw_rad"] = (turned - 2 * np.pi * np.rint(turned / (2 * np.pi))) / YAW_SD_RAD
    for name in ("length_m", "width_m"):
        deviations[name] = (both[name] / both[f"{name}_true"] - 1) / 0.05
    noise = np.array([*deviations.values()])
    num = noise.shape[1]
    assert np.abs(noise.mean(axis=1)).max() < 5 / math.sqrt(num)
    assert np.abs(noise.std(axis=1) - 1).max() < 5 / math.sqrt(2 * num)
    assert np.abs(np.corrcoef(noise) - np.eye(len(noise))).max() < 5 / math.sqrt(num)
