"""Small tables of a quality layer, and one with the counts that the paper reports."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from tests.validator.quality.whole import retention_document, threshold_document

from branchdrive.quality.fidelity import with_passes
from branchdrive.quality.ledger import with_round
from branchdrive.quality.partition import assignment_of, clusters_of, split_document
from branchdrive.quality.population import population_document
from branchdrive.quality.threshold import VARIABLES, Thresholds
from branchdrive.quality.variants import variants_document
from branchdrive.tables.frame import concat, num_rows

Table = dict[str, Any]

NUM_POLICIES = 13
ACTIONS = [f"action_{k:02d}" for k in range(NUM_POLICIES - 1)]
DIGEST = "d" * 64
ONES = Thresholds(np.ones(len(VARIABLES)), np.ones(len(VARIABLES), bool), 442, 0)
"""A threshold of 1 for every variable."""
FLAGS = ("exact_bank", "controls_valid", "integrity_complete", "eligible", "core_valid", "extended_valid")


def texts(values: Any) -> Any:
    return np.array(list(values), dtype=object)


def reaching(name: str, num_flags: int, count: int, partition: str | None = None) -> Table:
    """Groups with the first flags of `FLAGS`; each integrity-complete one is a route cluster of its own."""
    complete = num_flags > FLAGS.index("integrity_complete")
    return {
        "group_id": texts(f"{name}-{i:04d}" for i in range(count)),
        "scenario_type": texts(f"Type{i % 9}" for i in range(count)),
        **{flag: np.full(count, place < num_flags) for place, flag in enumerate(FLAGS)},
        "partitioned": np.full(count, complete),
        "route_cluster": np.ma.masked_array(np.zeros(count, np.int32), not complete),
        "partition": np.ma.masked_array(texts([partition or ""] * count), not complete),
        "near_duplicate": np.zeros(count, bool),
    }


def numbered(groups: Table) -> Table:
    """The same groups with clusters of one group each, numbered as a release numbers them."""
    order = sorted(groups["group_id"][groups["integrity_complete"]].tolist())
    labels = np.array([order.index(g) if g in order else 0 for g in groups["group_id"]], np.int32)
    return {**groups, "route_cluster": np.ma.masked_array(labels, ~groups["integrity_complete"])}


def paper_groups() -> Table:
    """2,467 groups with the stages of the paper's population table."""
    partitioned = {
        "train": {3: 2, 4: 11, 5: 4, 6: 427},
        "val": {4: 7, 6: 88},
        "test": {4: 8, 5: 2, 6: 85},
    }
    parts = [reaching("lost", 0, 716), reaching("bank", 1, 1102), reaching("controls", 2, 15)]
    for name, counts in partitioned.items():
        parts += [reaching(f"{name}{num_flags}", num_flags, count, name) for num_flags, count in counts.items()]
    return numbered(concat(parts))


def pairs_of(groups: Table, actions: list[str] = ACTIONS) -> Table:
    """Bit-identical interventions of every integrity-complete group."""
    group_ids = [g for g in groups["group_id"][groups["integrity_complete"]] for _ in actions]
    count = len(group_ids)
    keys = actions * (count // len(actions))
    values: Table = {variable.name: np.zeros(count) for variable in VARIABLES}
    for name in ("vehicle_gap_m", "vehicle_rel_speed_mps", "pedestrian_gap_m"):
        values[name] = np.ma.masked_array(values[name], np.zeros(count, bool))
    return {
        "group_id": texts(group_ids),
        "rollout_id": texts(f"{g}.{k}" for g, k in zip(group_ids, keys, strict=True)),
        "kind": texts(["intervention"] * count),
        "action_key": texts(keys),
        **values,
        "has_pedestrian": np.zeros(count, bool),
    }


def failing(pairs: Table, group_ids: list[str], num_pairs: int, variable: str) -> None:
    """Let pairs of groups differ by 9 in a variable, at least one of each group, `num_pairs` in all."""
    members = [np.flatnonzero(pairs["group_id"] == g) for g in group_ids]
    rows = [rows[k] for k in range(len(members[0])) for rows in members]
    pairs[variable][rows[:num_pairs]] = 9.0


def paper_pairs(groups: Table) -> Table:
    """Pairs with the retention that the paper reports, under thresholds of 1 in every variable."""
    pairs = pairs_of(groups)
    ids = groups["group_id"].tolist()
    for name, variable, num_pairs in (
        ("train4", "position_m", 40), ("train5", "actor_count_share", 9), ("val4", "speed_mps", 24),
        ("test4", "steer", 62), ("test5", "vehicle_gap_m", 11),
    ):  # fmt: skip
        failing(pairs, [g for g in ids if g.startswith(f"{name}-")], num_pairs, variable)
    return with_passes(pairs, ONES)


class Release(NamedTuple):
    """Documents of a quality layer."""

    population: Table
    split: Table
    thresholds: Table
    retention: Table
    ledger: Table
    variants: Table


def documents(groups: Table, pairs: Table, *, seed: int = 7) -> Release:
    """Documents of stored tables."""
    split = split_document(assignment_of(groups), clusters_of(groups), seed=seed)
    digests = {"split_digest": split["digest"], "thresholds_digest": DIGEST}
    return Release(
        population_document(groups, num_policies=NUM_POLICIES),
        split,
        threshold_document(pairs, groups),
        retention_document(pairs, groups, seed=seed, **digests),
        with_round(None, **digests),
        variants_document(groups),
    )


def leakage(verdict: str = "pass", **gate: Any) -> Table:
    """A document of a leakage audit, as far as texts read it."""
    effect = {
        "detections": [
            *({"pattern": p, "offset_sd": sd} for p in ("one", "dense") for sd in (0.4, 0.8)),
            *({"pattern": p, "offset_sd": sd} for p in ("tenth", "thirtieth") for sd in (1.6, 6.4)),
        ],
        "smallest_sd": {"one": None, "dense": 0.4, "tenth": 6.4, "thirtieth": None},
    }
    place = {"source": "ego", "variable": "speed_mps", "offset_ticks": [-5, -5], "action": "brake_0.30",
             "kind": "value", "t": 9.0, "difference": 0.25, "p": 0.0001}  # fmt: skip
    light = {"source": "recorded_evidence", "variable": "traffic_light", "offset_ticks": [-5, -5]}
    code = {"statistic": "concordance", "columns": [light], "groups": 21, "value": 99.0, "p": 0.0001}
    tests = [{"status": "inconclusive"}, {"status": "pass"}, {"status": "not_run"}]
    return {
        "gate": {
            "verdict": verdict, "reason": "This is why", "bit_identical": False,
            "shape": {"groups": 606, "actions": 12, "features": 24, "columns": 1908}, "places": [place] * 5,
            "codes": [code, {**code, "statistic": "interaction", "columns": [light, light]}, {**code, "p": 0.5}],
            "minimum_detectable_effect": effect, **gate,
        },
        "protocol": {"gate": {"alpha": 0.001}},
        "inputs": {"variables": {"streams": ["evidence/traffic_light"]}},
        "battery": {"ways": [{"tests": tests}, {"tests": tests}]},
        "not_run": [{"test": f"{way}/gru", "reason": "PyTorch is not installed."} for way in "ab"],
    }  # fmt: skip


def shuffled(frame: Table, seed: int) -> Table:
    order = np.random.default_rng(seed).permutation(num_rows(frame))
    return {name: values[order] for name, values in frame.items()}
