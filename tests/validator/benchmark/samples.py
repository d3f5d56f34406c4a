"""A small benchmark: four partitions of synthetic banks, three models that know more or less, a learned risk."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.validator.benchmark.guard.banks import banks

from branchdrive.benchmark.guard.risk import FEATURES, MultiplierGrid, RiskFit
from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.metric.outcome import Predictions
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import PredictionRows
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol, default_protocol
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.noise import OutcomeNoise, RepeatLosses
from branchdrive.contract.bank import load_action_bank
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.tables.frame import Frame

SIZES = {"train": 24, "val": 20, "calibration": 96, "test": 20}
BANK = load_action_bank()
SEEDS = (11, 23, 37)
PAPER_MODELS = ("M0", "M1", "M2", "M3")
GUARD = ("model", "alpha", "delta", "tolerance_m", "min_groups", "min_clusters", "coverage")
"""What a protocol must say of its guard."""


def paper_protocol() -> dict[str, Any]:
    """The default protocol with the models of the paper alone, without what it ranks beside their selectors."""
    document = {name: value for name, value in default_protocol().document.items() if name != "selection"}
    models = [model for model in document["models"] if model["id"] in PAPER_MODELS]
    added = ("ranking_baselines", "ranking_decision")
    families = [family for family in document["families"] if family["name"] not in added]
    return document | {"name": "small", "version": "0.1.0", "models": models, "families": families}


def whole_protocol() -> BenchmarkProtocol:
    """The default protocol with few resamples."""
    few = {"seed": 0, "resamples": 100, "level": 0.95, "flips": 100}
    document = default_protocol().document | {"name": "whole", "statistics": few}
    document["shuffles"] = {"kinds": [], "seeds": [0]}
    return BenchmarkProtocol.model_validate(document)


def contexts() -> Contexts:
    """Labels and summaries that tell a little of a group; privileged ones tell more."""
    groups = [group for part in data().parts.values() for group in part.groups]
    outcomes = np.concatenate([part.outcomes.scalars for part in data().parts.values()])
    noise_of = np.random.default_rng(3).normal(size=(len(groups), 2))
    gap = outcomes[:, 0, 1]
    histories: dict[str, NDArray[np.float64] | None] = {
        "sensor": np.column_stack([gap + noise_of[:, 0], noise_of[:, 1]]),
        "privileged": np.column_stack([gap, noise_of[:, 1]]),
    }
    kinds = ["near" if one < np.median(gap) else "far" for one in gap]
    labels = {
        "scenario_type": kinds,
        "town": ["T"] * len(groups),
        "command": kinds,
        "speed_limit": [None] * len(groups),
    }
    return Contexts({group: row for row, group in enumerate(groups)}, labels, histories)


def small_protocol(**changes: Any) -> BenchmarkProtocol:
    """The protocol of the paper with few resamples."""
    document = paper_protocol()
    document["statistics"] = {"seed": 0, "resamples": 200, "level": 0.95, "flips": 500}
    document["shuffles"] = {"kinds": ["action", "history", "joint"], "seeds": [0, 1]}
    document["guard"] = {name: document["guard"][name] for name in GUARD}
    return BenchmarkProtocol.model_validate({**document, **changes})


def group_ids(partition: str) -> list[str]:
    return [f"{partition}-{place:03d}" for place in range(SIZES[partition])]


def paths_of(scalars: NDArray[np.float64]) -> NDArray[np.float64]:
    """Trajectories that end at the displacement and turn by the yaw rate, ``[..., 10, 5]``."""
    step = np.arange(1, 11) / 10
    end, turned = scalars[..., 2, None], scalars[..., 5, None] * step
    ones = np.ones_like(turned)
    return np.stack([end * step, turned, np.sin(turned), np.cos(turned), end / 2.5 * ones], axis=-1)


@cache
def frames() -> dict[str, Frame]:
    """Tables of the model layer."""
    rows: dict[str, list[Any]] = {name: [] for name in ("group_id", "partition", "route_cluster")}
    values = []
    for number, partition in enumerate(SIZES):
        found = banks(SIZES[partition], seed=number)
        rows["group_id"] += group_ids(partition)
        rows["partition"] += [partition] * SIZES[partition]
        rows["route_cluster"] += [1000 * number + place // 2 for place in range(SIZES[partition])]
        values.append(found.outcomes.values)
    outcomes = np.concatenate(values)
    flat, size = outcomes.reshape(-1, 6), len(BANK.keys)
    groups = np.array(rows["group_id"], object)
    scalars: dict[str, Any] = {
        "group_id": np.repeat(groups, size),
        "action_key": np.tile(np.array(BANK.keys, object), len(groups)),
    }
    for place, target in enumerate(TARGETS):
        scalars[target.name.rsplit("_", 1)[0] + "_available"] = np.ones(len(flat), bool)
        scalars[target.name] = flat[:, place].copy()
    steps = paths_of(outcomes).reshape(-1, 5)
    trajectories: dict[str, Any] = {
        "group_id": np.repeat(groups, size * 10),
        "action_key": np.tile(np.repeat(np.array(BANK.keys, object), 10), len(groups)),
        "step": np.tile(np.arange(1, 11), len(groups) * size),
    }
    trajectories |= {name: steps[:, place].copy() for place, name in enumerate(TRAJECTORY)}
    contexts = {
        name: np.array(column, object if name != "route_cluster" else np.int64) for name, column in rows.items()
    }
    return {"contexts": contexts, "scalars": scalars, "trajectories": trajectories}


def in_one_frame(tables: Mapping[str, Frame]) -> dict[str, list[Frame]]:
    """Tables in one frame each."""
    return {name: [frame] for name, frame in tables.items()}


@cache
def data() -> BenchmarkData:
    return BenchmarkData.of(in_one_frame(frames()), BANK)


def rows_of(tables: Mapping[str, Frame], of: BenchmarkData | None = None) -> PredictionRows:
    """Rows of tables of predictions of one file each, of these data by default."""
    return PredictionRows(in_one_frame(tables), of or data())


@cache
def endings() -> dict[str, Any]:
    """The table of endings of a world that loses sight of some drives, and in which nominal ends well most often."""
    groups, keys = frames()["scalars"]["group_id"], frames()["scalars"]["action_key"]
    rng = np.random.default_rng(7)
    is_nominal = keys == "nominal"
    found: dict[str, Any] = {"group_id": groups, "action_key": keys}
    for event, share in (("collision", 0.3), ("off_road", 0.2), ("infraction", 0.05)):
        monitored = rng.uniform(size=len(keys)) < 0.9
        happened = rng.uniform(size=len(keys)) < np.where(is_nominal, share / 5, share)
        found[f"{event}_monitored"] = monitored
        found[event] = np.ma.masked_array(happened & monitored, ~monitored)
    found["completed"] = rng.uniform(size=len(keys)) < np.where(is_nominal, 0.95, 0.6)
    found["route_fraction"] = np.where(found["completed"], 1.0, rng.uniform(size=len(keys))).astype(np.float32)
    return found


@cache
def data_with_endings() -> BenchmarkData:
    return BenchmarkData.of(in_one_frame({**frames(), "endings": endings()}), BANK)


@cache
def prediction_set() -> PredictionSet:
    """M0 the training mean, M1 the mean of each candidate, M2 that of each group, M3 the outcome with noise."""
    train = data().part("train").outcomes.scalars
    by_model: dict[str, dict[int, dict[str, Predictions]]] = {}
    for model, seeds in (("M0", (0,)), ("M1", SEEDS), ("M2", SEEDS), ("M3", SEEDS)):
        for seed in seeds:
            rng = np.random.default_rng([seed, int(model[1])])
            for partition in ("val", "calibration", "test"):
                truth = data().part(partition).outcomes.scalars
                known = {
                    "M0": np.broadcast_to(train.mean(axis=(0, 1)), truth.shape),
                    "M1": np.broadcast_to(train.mean(axis=0), truth.shape),
                    "M2": np.broadcast_to(truth.mean(axis=1, keepdims=True), truth.shape),
                    "M3": truth + rng.normal(scale=0.3, size=truth.shape),
                }[model]
                off = 0.0 if model == "M0" else rng.normal(scale=0.05, size=truth.shape[-1:])
                parts = by_model.setdefault(model, {}).setdefault(seed, {})
                parts[partition] = Predictions.of(known + off, paths_of(known + off))
    return PredictionSet(by_model)


FURTHER = {"further_tolerances_m": [0.5], "further_models": ["M1"], "redraws": 1000}
"""What a protocol may say of its guard."""


def guarded_protocol() -> BenchmarkProtocol:
    """The small protocol with everything that it may declare of its guard."""
    return small_protocol(guard=small_protocol().document["guard"] | FURTHER)


def further_risks() -> dict[tuple[str, float], RiskFit]:
    """Risks of the further guards."""
    return {
        guarded: risk_fit().model_copy(update={"tolerance_m": guarded[1]})
        for guarded in guarded_protocol().guard.further
    }


def risk_fit() -> RiskFit:
    """A risk that falls with the predicted margin."""
    size = len(FEATURES)
    weights = tuple(-2.0 if feature.name == "margin_m" else 0.0 for feature in FEATURES)
    grid = MultiplierGrid(dual_multiplier=0.1, multipliers=tuple(2.0**-k for k in range(8)))
    return RiskFit(
        features=tuple(feature.name for feature in FEATURES),
        tolerance_m=0.25,
        spread_m=0.1,
        centre=(0.0,) * size,
        spread=(1.0,) * size,
        logistic=weights,
        logistic_offset=0.0,
        severity=(0.0,) * size,
        severity_offset=0.0,
        grids=dict.fromkeys(default_protocol().preferences, grid),
    )


def noise() -> OutcomeNoise:
    """Noise of which that of one target is unknown."""
    tolerance = np.array([np.nan, 0.2, 0.1, 0.0, 0.1, 1e9])
    num_groups, num_one_sided = np.array([0, 24, 24, 24, 24, 24]), np.array([1, 0, 0, 0, 0, 0])
    return OutcomeNoise(tolerance, tolerance / 2, num_groups, num_one_sided, RepeatLosses(24, 3, 48, 4))
