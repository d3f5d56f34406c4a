"""Examples of the documents of derived layers, as a small release has them."""

from __future__ import annotations

from typing import Any

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.driving.discrepancy import CORE
from branchdrive.driving.feature import MIXED_PROFILE, SENSOR_PROFILE
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.quality.replay_frames import MATCHED
from branchdrive.quality.threshold import VARIABLES

__all__ = ["EXAMPLES"]

SHA = "0123456789abcdef" * 4
PARTITIONS = ("train", "val", "test")


def _source() -> dict[str, Any]:
    return {
        "spec_version": "0.1",
        "raw_layer": SHA,
        "dataset_id": "invented",
        "dataset_version": "1.2.0",
        "num_groups": 2,
        "num_attempts": 27,
        "records": {"physical": 23, "nominal_link": 2, "missing": 1},
        "states": {"selected": 24, "ineligible": 1, "missing": 1},
        "dispositions": dict(
            zip(LAYER_TABLES["attempts"]["disposition"].values, (24, 1, 1, 0, 0, 0, 1, 0, 0), strict=True)
        ),
    }


def _split() -> dict[str, Any]:
    return {
        "algorithm": "clustered-1",
        "seed": 3,
        "shares": {"train": 70, "val": 15, "test": 15},
        "calibration": {"min_groups": 88, "min_clusters": 48},
        "num_clusters": 160,
        "partitions": {name: {"groups": 95, "clusters": 40} for name in (*PARTITIONS, "calibration")},
        "digest": SHA,
    }


def _thresholds() -> dict[str, Any]:
    return {
        "split_digest": SHA,
        "quantile": 0.99,
        "method": "higher",
        "partition": "train",
        "num_groups": 442,
        "pedestrian_support": 12,
        "variables": [
            {
                "name": variable.name,
                "unit": LAYER_TABLES["pairs"][variable.name].unit,
                "criterion": "core" if variable in CORE else "extended",
                "judged": variable.name != "pedestrian_gap_m",
                "floor": 0.001,
                "value": None if variable.name == "pedestrian_gap_m" else 0.25,
            }
            for variable in VARIABLES
        ],
    }


def _filtering() -> dict[str, Any]:
    names = [variable.name for variable in VARIABLES]
    return {
        "split_digest": SHA,
        "num_groups": 442,
        "num_pairs": 7608,
        "variables": [
            {
                "name": name,
                "unit": LAYER_TABLES["pairs"][name.removeprefix("matched_")].unit,
                "decides": name in names,
                "threshold": 0.25,
                "mean_share_above": 0.5,
                "share_above": 1.0,
                "variation": 0.5,
                "over_variation": 0.5,
                "num_failing": 12,
                "num_failing_alone": 0 if name in names else None,
                "filters": False if name in names else None,
                "num_unmatched": None if name in names else 3,
            }
            for name in (*names, *MATCHED)
        ],
    }


def _retention() -> dict[str, Any]:
    return {
        "seed": 3,
        "num_resamples": 2000,
        "level": 0.95,
        "split_digest": SHA,
        "thresholds_digest": SHA,
        "rows": [
            {
                "criterion": criterion,
                "partition": partition,
                "unit": unit,
                "num_groups": 95,
                "num_passed": 87,
                "num_units": 95,
                "share": 0.9158,
                "low": 0.8629,
                "high": 0.9684,
                "target": target,
                "met": target == 0.9,
            }
            for criterion in ("core", "extended")
            for partition in PARTITIONS
            for unit, target in (("pair", 0.98), ("bank", 0.9))
        ],
    }


def _population() -> dict[str, Any]:
    counts = {"train": 431, "val": 88, "test": 87}
    totals = {
        "discovered": 2467,
        "exact_bank": 1751,
        "controls_valid": 649,
        "integrity_complete": 634,
        "eligible": 632,
        "core_valid": 606,
        "extended_valid": 600,
        "frozen": 606,
    }
    return {
        "num_policies": 13,
        "partitions": list(PARTITIONS),
        "stages": [
            {
                "stage": stage,
                "title": stage,
                "groups": None if stage in ("discovered", "exact_bank", "controls_valid") else dict(counts),
                "total": total,
                "trajectories": None if stage == "discovered" else 13 * total,
            }
            for stage, total in totals.items()
        ],
    }


def _variants() -> dict[str, Any]:
    where = {"core_valid": True, "near_duplicate": False}
    return {
        "frozen": {"where": where, "num_groups": 606, "digest": SHA},
        "variants": [
            {
                "name": "extended",
                "title": "Replay-valid by the extended variables too",
                "where": {**where, "extended_valid": True},
                "num_groups": 600,
                "digest": SHA,
            }
        ],
    }


def _ledger() -> dict[str, Any]:
    events = ("thresholds_fixed", "validation_evaluated", "test_accessed")
    return {
        "entries": [
            {"number": i, "event": event, "split_digest": SHA, "thresholds_digest": SHA}
            for i, event in enumerate(events, start=1)
        ]
    }


def _features() -> dict[str, Any]:
    size = len(SENSOR_PROFILE.state)
    profiles = {
        "state": (16, SENSOR_PROFILE.state),
        "past_controls": (80, SENSOR_PROFILE.controls),
        "expert": (16, MIXED_PROFILE.state[size:]),
    }
    return {
        "contracts": {
            "sensor": ["state", "past_controls"],
            "mixed": ["state", "past_controls", "expert"],
            "privileged": ["state", "past_controls", "expert"],
        },
        "histories": {
            table: {"rows": rows, "features": [{**feature.record, "recorded": True} for feature in features]}
            for table, (rows, features) in profiles.items()
        },
        "candidate_order": list(load_action_bank().keys),
        "encoding": {"name": "bd29", "width": 29, "sha256": SHA},
        "targets": [
            {"name": t.name, "mask": f"{t.name.rsplit('_', 1)[0]}_available", "symbol": t.symbol, "unit": t.unit}
            for t in TARGETS
        ],
        "trajectory": {"steps": 10, "components": list(TRAJECTORY)},
        "arrays": {
            "state": {"shape": ["groups", 16, 21], "tables": ["state"]},
            "actions": {"shape": [13, 29], "tables": ["actions"]},
        },
    }


def _normalisation() -> dict[str, Any]:
    def scaled(names: list[str]) -> list[dict[str, Any]]:
        return [{"feature": name, "offset": 0.5, "scale": 2.0, "limit": 8.0} for name in names]

    size = len(SENSOR_PROFILE.state)
    return {
        "split_digest": SHA,
        "partition": "train",
        "num_groups": 431,
        "state": scaled([feature.name for feature in SENSOR_PROFILE.state]),
        "past_controls": scaled([feature.name for feature in SENSOR_PROFILE.controls]),
        "expert": [
            {"feature": feature.name, "offset": 0.0, "scale": 1.0, "limit": None}
            for feature in MIXED_PROFILE.state[size:]
        ],
        "scalars": [{"feature": TARGETS[0].name, "offset": None, "scale": None}]
        + [{"feature": target.name, "offset": 1.0, "scale": 0.5} for target in TARGETS[1:]],
        "trajectories": [
            {"step": step, "component": component, "offset": 0.0, "scale": 1.0}
            for step in range(1, 11)
            for component in TRAJECTORY
        ],
    }


EXAMPLES: dict[str, dict[str, Any]] = {
    "source": _source(),
    "split": _split(),
    "thresholds": _thresholds(),
    "retention": _retention(),
    "filtering": _filtering(),
    "population": _population(),
    "variants": _variants(),
    "ledger": _ledger(),
    "features": _features(),
    "normalisation": _normalisation(),
}
"""One conforming document by the stem of its schema; copy it before a change."""
