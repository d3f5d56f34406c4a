"""What documents of the quality layer say, as plain sentences that the card and the reports share.

Source: spec/10-layers.md#card.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from branchdrive.contract.text import counted, percent
from branchdrive.quality.ledger import BENCHMARK_ACCESSES, RELEASE_ACCESS, Ledger, accesses
from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive.statistics.split import DIVIDED

__all__ = [
    "PARTITION_TITLES",
    "UNITS",
    "access_sentence",
    "benchmark_sentences",
    "calibration_sentences",
    "filtering_sentences",
    "population_sentences",
    "target_sentences",
    "threshold_text",
]

PARTITION_TITLES: Mapping[str, str] = MappingProxyType(
    {"train": "Train", "val": "Validation", "test": "Test", "calibration": "Calibration"}
)
"""How texts name partitions."""

UNITS: Mapping[str, str] = MappingProxyType({"pair": "pairs", "bank": "complete banks"})
"""How texts name the units of retention."""


def calibration_sentences(split: Mapping[str, Any]) -> list[str]:
    """How the calibration partition was drawn, and what that means for a guard; nothing where there is none."""
    if "calibration" not in split["partitions"]:
        return []
    if split["algorithm"] == DIVIDED:
        return [
            "Calibration and test are a uniform division of one pool of clusters, so that a calibration cluster and a "
            "test cluster are exchangeable by construction, but for near duplicates, which are left out afterwards."
        ]
    return [
        f"The calibration partition was drawn by `{split['algorithm']}`: that its clusters and those of test are "
        "exchangeable is assumed."
    ]


def filtering_sentences(filtering: Mapping[str, Any]) -> list[str]:
    """Which thresholds filter nothing, and how the nearest vehicle differs where it is matched by actor."""
    variables = {variable["name"]: variable for variable in filtering["variables"]}
    sentences = [
        f"The threshold of `{name}`, {_amount(variable)}, filters nothing: {_why(variable)}."
        for name, variable in variables.items()
        if variable["filters"] is False
    ]
    for name in ("vehicle_gap_m", "vehicle_rel_speed_mps"):
        nearest, matched = variables.get(name), variables.get(f"matched_{name}")
        if nearest is None or matched is None:  # a document of a stranger may name one variable twice
            continue
        if _amount(nearest) == _amount(matched) and not matched["num_unmatched"]:
            continue  # it says nothing
        unmatched = f"{matched['num_unmatched'] or 0:,} of {filtering['num_pairs']:,} pairs"
        sentences.append(
            f"`{name}` compares the nearest vehicle of each drive, whichever it is, at {_amount(nearest)}; of the same "
            f"vehicle, matched by actor, the threshold would be {_amount(matched)}, with {unmatched} in which the "
            "replay lacks it at a frame."
        )
    return sentences


def _amount(variable: Mapping[str, Any]) -> str:
    if variable["threshold"] is None:
        return "any finite value"
    return f"{variable['threshold']:.4g} {variable['unit'] or ''}".rstrip()


def _why(variable: Mapping[str, Any]) -> str:
    reasons = []
    if variable["num_failing_alone"] == 0:
        reasons.append("no pair fails by it alone")
    if variable["over_variation"] is not None and variable["over_variation"] >= 1:
        reasons.append(f"it is {variable['over_variation']:.2g} times what nominals move in the window")
    return " and ".join(reasons)


def threshold_text(variable: Mapping[str, Any], thresholds: Mapping[str, Any]) -> str:
    """The threshold of a variable with its unit, or why it has none."""
    if not variable["judged"]:
        return f"not judged: support of {counted(thresholds['pedestrian_support'], 'group')}"
    if variable["value"] is None:
        return "any finite value"
    return f"{variable['value']:.4g} {variable['unit'] or ''}".rstrip()


def target_sentences(retention: Mapping[str, Any]) -> list[str]:
    """Whether the core criteria reach the predeclared targets in the test partition, pairs and banks."""
    return [
        f"{row['num_passed']:,} of {row['num_units']:,} {UNITS[row['unit']]} passed, {percent(row['share'])}: "
        f"the predeclared target of {percent(row['target'], 0)} was {'met' if row['met'] else 'not met'}."
        for row in retention["rows"]
        if row["criterion"] == "core" and row["partition"] == "test" and row["share"] is not None
    ]


def population_sentences(population: Mapping[str, Any]) -> list[str]:
    """What the population table does not say by itself: near duplicates left out, and what a benchmark will lack."""
    frozen = population["stages"][-1]  # the last one; a document of a stranger may call it otherwise
    valid = next((stage for stage in population["stages"] if stage["stage"] == "core_valid"), frozen)
    sentences = []
    left_out = valid["total"] - frozen["total"]
    if left_out:
        groups = "group is" if left_out == 1 else "groups are"
        sentences.append(f"{left_out} core-valid {groups} left out as near duplicates of another partition.")
    empty = [PARTITION_TITLES[name] for name in population["partitions"] if not (frozen["groups"] or {}).get(name)]
    if empty:
        sentences.append(
            f"The frozen population has no group in: {', '.join(empty)}. A benchmark takes groups in train, val and "
            "test. Collect more groups."
        )
    num_test = (frozen["groups"] or {}).get("test", 0)
    if 0 < num_test < LEAST_UNITS:
        sentences.append(
            f"With {counted(num_test, 'test group')} a benchmark concludes nothing: intervals and tests of 95 % take "
            f"{LEAST_UNITS} route clusters or more."
        )
    return sentences


def access_sentence(ledger: Ledger) -> str:
    """How often the test partition was accessed."""
    count = len(accesses(RELEASE_ACCESS, ledger))
    if count == 0:
        return "The test partition has not been accessed."
    if count == 1:
        return "The test partition was accessed once, after everything that it judges was fixed."
    return (
        f"The test partition was accessed {count} times, under different splits or thresholds: "
        "it is no longer an untouched test set, and results on it are optimistic."
    )


def benchmark_sentences(ledger: Ledger) -> list[str]:
    """How often benchmarks of earlier builds accessed the test partition; nothing where none did."""
    counts = [len(accesses(event, ledger)) for event in BENCHMARK_ACCESSES]
    if not any(counts):
        return []
    predictions, selections = (f"{count} {'time' if count == 1 else 'times'}" for count in counts)
    return [
        f"Benchmarks of earlier builds accessed the test partition {predictions} for predictions and {selections} for "
        "selections: it is no longer an untouched test set for another benchmark."
    ]
