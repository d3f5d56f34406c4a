"""Mistakes of collectors, planted into tables that are right: what each of them records of one and the same drive."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

Shard = dict[str, pa.Table]
Shards = dict[str, Shard]


def _each(shards: Mapping[str, Shard], change: Callable[[Shard], Shard]) -> Shards:
    return {folder: change(dict(shard)) for folder, shard in shards.items()}


def _with(table: pa.Table, column: str, values: pa.Array | pa.ChunkedArray) -> pa.Table:
    place = table.schema.get_field_index(column)
    return table.set_column(place, table.schema.field(place), values.cast(table.schema.field(place).type))


def _scaled(table: pa.Table, factors: Mapping[str, float]) -> pa.Table:
    for column, factor in factors.items():
        values = table[column].combine_chunks()
        if pa.types.is_list(values.type):
            items = pc.multiply(values.values, factor)
            table = _with(table, column, pa.ListArray.from_arrays(values.offsets, items))
        else:
            table = _with(table, column, pc.multiply(values.cast(pa.float64()), factor))
    return table


def mirrored_world(shards: Mapping[str, Shard]) -> Shards:
    """A left-handed simulator, recorded as it is; steering stays positive to the right."""

    def change(shard: Shard) -> Shard:
        columns = {
            "rollouts": ("route_y_m",),
            "observations": (
                "y_m", "yaw_rad", "yaw_rate_radps", "accel_lateral_mps2", "route_offset_m", "route_heading_error_rad",
                "target_point_1_y_m", "target_point_2_y_m",
            ),
            "actors": ("y_m", "yaw_rad", "vel_y_mps"),
            "map": ("y_m",),
        }  # fmt: skip
        return {name: _scaled(table, dict.fromkeys(columns.get(name, ()), -1.0)) for name, table in shard.items()}

    return _each(shards, change)


def speed_in_kmh(shards: Mapping[str, Shard]) -> Shards:
    """The ego's speed in km/h."""
    return _each(shards, lambda s: {**s, "observations": _scaled(s["observations"], {"speed_mps": 3.6})})


def late_observations(shards: Mapping[str, Shard]) -> Shards:
    """Every observation holds the state of the one before it."""

    def change(shard: Shard) -> Shard:
        table = shard["observations"].sort_by([("rollout_id", "ascending"), ("tick", "ascending")])
        ids = table["rollout_id"].combine_chunks().to_pylist()
        before = np.array([i - 1 if i and ids[i - 1] == ids[i] else i for i in range(len(ids))])
        late = table.take(before)
        for column in ("rollout_id", "tick"):
            late = _with(late, column, table[column])
        return {**shard, "observations": late}

    return _each(shards, change)


def ignored_commands(shards: Mapping[str, Shard]) -> Shards:
    """Every intervention drives as its nominal did."""

    def change(shard: Shard) -> Shard:
        records = shard["rollouts"].select(["rollout_id", "nominal_rollout_id"]).to_pydict()
        nominal = dict(zip(records["rollout_id"], records["nominal_rollout_id"], strict=True))
        table = shard["observations"]
        ids, ticks = table["rollout_id"].to_pylist(), table["tick"].to_pylist()
        place = {key: i for i, key in enumerate(zip(ids, ticks, strict=True))}
        rows = [place.get((nominal[one] or one, tick), i) for i, (one, tick) in enumerate(zip(ids, ticks, strict=True))]
        copied = table.take(rows)
        return {**shard, "observations": _with(copied, "rollout_id", table["rollout_id"])}

    return _each(shards, change)


def constant_column(shards: Mapping[str, Shard]) -> Shards:
    """A target speed that nobody computed."""

    def change(shard: Shard) -> Shard:
        table = shard["observations"]
        return {**shard, "observations": _with(table, "target_speed_mps", pa.array([10.0] * table.num_rows))}

    return _each(shards, change)


def half_extents(shards: Mapping[str, Shard]) -> Shards:
    """Boxes from their centre to their sides."""
    sides = ("length_m", "width_m", "height_m")

    def change(shard: Shard) -> Shard:
        rollouts = _scaled(shard["rollouts"], {f"ego_{side}": 0.5 for side in sides})
        return {**shard, "rollouts": rollouts, "actors": _scaled(shard["actors"], dict.fromkeys(sides, 0.5))}

    return _each(shards, change)


def ten_hertz(shards: Mapping[str, Shard]) -> Shards:
    """A simulator at 10 Hz whose ticks are recorded as 20 Hz: motion as in a world of twice the size, equal rates."""

    def change(shard: Shard) -> Shard:
        places = (
            "x_m", "y_m", "route_progress_m", "route_offset_m", "target_point_1_x_m", "target_point_1_y_m",
            "target_point_2_x_m", "target_point_2_y_m",
        )  # fmt: skip
        rates = ("yaw_rate_radps", "accel_longitudinal_mps2", "accel_lateral_mps2")
        factors = {
            "rollouts": dict.fromkeys(("route_x_m", "route_y_m"), 2.0),
            "observations": dict.fromkeys(places, 2.0) | dict.fromkeys(rates, 0.5),
            "actors": dict.fromkeys(("x_m", "y_m"), 2.0),
            "map": dict.fromkeys(("x_m", "y_m", "z_m", "width_m"), 2.0),
        }
        return {name: _scaled(table, factors.get(name, {})) for name, table in shard.items()}

    return _each(shards, change)
