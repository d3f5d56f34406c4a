"""Evidence rules decide the same from the pairs that can decide as from all pairs."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import numpy as np
import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st
from tests import synthetic

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.mismatch import Mismatch
from branchdrive.driving.risk import risk_evidence
from branchdrive.raw.motion import pairs
from branchdrive.raw.rules import evidence
from branchdrive.raw.shard_view import ShardView

RULES = (evidence.separation_recomputes, evidence.ttc_recomputes, evidence.nearest_actors_recompute)
ROUTE = (np.array([-60.0, 0.0, 60.0]), np.array([0.0, 0.0, 20.0]))
EGO = (4.5, 2.0)
NUDGES = (0.0, 1e-7, -1e-7, 2e-6, -2e-6, 1e-3, -1e-3, 5.0, -5.0)
"""Errors in metres and seconds, from within the slack of a cut-off to far out."""


def tables(rng: np.random.Generator, num_rollouts: int, share_wrong: float, is_gridded: bool) -> dict[str, pa.Table]:
    """Rollouts of one observation each among up to ten actors; part of the evidence is wrong."""

    def draw(low: float, high: float, size: int) -> Any:
        values = rng.uniform(low, high, size)
        return np.round(values / 2) * 2 if is_gridded else values  # a grid makes ties, contacts and cut-offs

    parts: dict[str, list[dict[str, Any]]] = {"rollouts": [], "observations": [], "actors": [], "evidence": []}
    for i in range(num_rollouts):
        n = int(rng.integers(0, 11))
        observation = {
            "rollout_id": f"r{i}", "tick": 0, "x_m": float(draw(-20, 20, 1)[0]), "y_m": float(draw(-8, 8, 1)[0]),
            "yaw_rad": float(rng.choice([0.0, 0.5, np.pi / 2])), "speed_mps": float(rng.choice([0.0, 0.1, 8.0])),
        }  # fmt: skip
        around = {
            "tick": np.zeros(n, int), "actor_id": rng.permutation(20)[:n],
            "actor_class": rng.choice(["vehicle", "cycle", "pedestrian", "static"], n),
            "x_m": draw(-60, 60, n), "y_m": draw(-25, 25, n), "yaw_rad": rng.choice([0.0, 1.0, np.pi / 2], n),
            "length_m": rng.choice([0.5, 4.5, 12.0], n), "width_m": rng.choice([0.5, 2.0], n),
            "vel_x_mps": rng.choice([0.0, -0.1, 3.0, -12.0], n), "vel_y_mps": rng.choice([0.0, 0.1, 2.0], n),
        }  # fmt: skip
        columns = {name: np.array([value]) for name, value in observation.items()}
        (length_m, width_m), (x_m, y_m) = EGO, ROUTE
        found = risk_evidence(columns, around, ego_length_m=length_m, ego_width_m=width_m, route_x_m=x_m, route_y_m=y_m)
        row = {name: None if np.ma.is_masked(values[0]) else values[0].item() for name, values in found.items()}
        for name, value in row.items():
            if rng.random() < share_wrong:
                if isinstance(value, bool):
                    row[name] = not value
                elif name.endswith("_id"):
                    row[name] = int(rng.integers(0, 20))
                elif isinstance(value, float):
                    row[name] = value + float(rng.choice(NUDGES))
        parts["rollouts"].append(
            {"rollout_id": f"r{i}", "role": "nominal", "nominal_rollout_id": None, "branch_tick": 0,
             "ego_length_m": EGO[0], "ego_width_m": EGO[1],
             "route_x_m": ROUTE[0].tolist(), "route_y_m": ROUTE[1].tolist()}
        )  # fmt: skip
        parts["observations"].append(observation)
        parts["evidence"].append({"rollout_id": f"r{i}", "tick": 0, **row})
        parts["actors"] += [
            {"rollout_id": f"r{i}", **{name: values[k].item() for name, values in around.items()}} for k in range(n)
        ]
    return {name: table(name, rows) for name, rows in parts.items()}


def table(name: str, rows: list[dict[str, Any]]) -> pa.Table:
    """Rows as a table of the declared types, with the columns that the rules read."""
    declared = table_schema(name)
    there = [field.with_nullable(True) for field in declared if field.name in (rows[0] if rows else declared.names)]
    return pa.Table.from_pylist(rows, schema=pa.schema(there))


def verdicts(view: ShardView) -> list[tuple[list[int], list[Mismatch]]]:
    """What each rule finds, in full."""
    every = np.ones(view.num_rollouts, bool)
    checks = [check for rule in RULES for check in rule(view, every)]
    return [(check.bad.tolist(), [check.mismatch(int(i)) for i in check.bad]) for check in checks]


def all_actors(view: ShardView) -> Any:
    stream = view.stream("actors")
    rows = np.flatnonzero(view.observations.rows_of(stream) >= 0)
    return pairs._actors(rows, [stream[name][rows] for name in pairs._ACTOR_COLUMNS])


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.1, 0.5]),
    st.booleans(),
    st.sampled_from([0.0, 1e-6, 1e-3]),
)
def test_pairs_beyond_the_limits_decide_nothing(seed: int, share_wrong: float, is_gridded: bool, e: float) -> None:
    shard = tables(np.random.default_rng(seed), 12, share_wrong, is_gridded)
    document = {**synthetic.descriptor(), "tolerances": {"evidence": e}}
    descriptor = Descriptor.model_validate(document)
    found = verdicts(ShardView(shard, descriptor))
    with patch.object(pairs, "_actors_within_limits", all_actors):
        assert verdicts(ShardView(shard, descriptor)) == found


def test_most_pairs_are_left_out() -> None:
    shard = tables(np.random.default_rng(3), 200, 0.0, False)
    view = ShardView(shard, Descriptor.model_validate(synthetic.descriptor()))
    assert not any(any(bad) for bad, _ in verdicts(view))
    assert len(view.cached(pairs.deciding_pairs).frame) < len(view.stream("actors")) / 2
