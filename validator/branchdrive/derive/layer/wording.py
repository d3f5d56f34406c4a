"""What documents of the quality layer say, as plain sentences that the card and the reports share.

Source: spec/10-layers.md#card.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from branchdrive.derive.layer.benchmark_openings import PREDICTION, RANKING, locks_of
from branchdrive.derive.layer.ledger import num_test_openings

__all__ = [
    "PARTITION_TITLES",
    "UNITS",
    "benchmark_sentences",
    "leakage_sentences",
    "opening_sentence",
    "percent",
    "population_sentences",
    "target_sentences",
]

PARTITION_TITLES: Mapping[str, str] = MappingProxyType(
    {"train": "Train", "val": "Validation", "test": "Test", "calibration": "Calibration"}
)
"""How texts name partitions."""

UNITS: Mapping[str, str] = MappingProxyType({"pair": "pairs", "bank": "complete banks"})
"""How texts name the units of retention."""

_PLACES_SHOWN = 3

_PATTERNS = {"one": "in one feature of one action", "dense": "as a dose over all actions on a quarter of the features"}

_VERDICTS = {
    "pass": "passes: replays before the branch did not tell the actions apart",
    "fail": "fails: replays before the branch tell actions apart, so results on this release cannot be trusted",
    "inconclusive": "is inconclusive, which is no pass",
}


_STATUSES = {"pass": "pass", "fail": "fail", "inconclusive": "inconclusive", "not_run": "not run"}


def percent(share: float, digits: int = 2) -> str:
    """A share as per cent; what is not all is never rounded to 100, what is not nothing never to 0."""
    least = 0.51 * 10.0 ** -(digits + 2)
    shown = min(max(share, least), 1 - least) if 0 < share < 1 else share
    return f"{100 * shown:.{digits}f}%"


def target_sentences(retention: Mapping[str, Any], partition: str = "test") -> list[str]:
    """Whether the core criteria reach the predeclared targets in a partition, pairs and banks."""
    return [
        f"{row['num_passed']:,} of {row['num_units']:,} {UNITS[row['unit']]} passed, {percent(row['share'])}: "
        f"the predeclared target of {percent(row['target'], 0)} was {'met' if row['met'] else 'not met'}."
        for row in retention["rows"]
        if row["criterion"] == "core" and row["partition"] == partition and row["share"] is not None
    ]


def population_sentences(population: Mapping[str, Any]) -> list[str]:
    """What the population table does not say by itself: near duplicates that were left out, empty partitions."""
    frozen = population["stages"][-1]  # the last one; a document of a stranger may call it otherwise
    valid = next((stage for stage in population["stages"] if stage["stage"] == "core_valid"), frozen)
    sentences = []
    left_out = valid["total"] - frozen["total"]
    if left_out:
        groups = "group is" if left_out == 1 else "groups are"
        sentences.append(f"{left_out} core-valid {groups} left out as near duplicates of another partition.")
    empty = [PARTITION_TITLES[name] for name in population["partitions"] if not (frozen["groups"] or {}).get(name)]
    if empty:
        sentences.append(f"The frozen population has no group in: {', '.join(empty)}. Collect more groups.")
    return sentences


def opening_sentence(ledger: Mapping[str, Any]) -> str:
    """How often the test partition was opened."""
    openings = num_test_openings(ledger)
    if openings == 0:
        return "The test partition has not been opened."
    if openings == 1:
        return "The test partition was opened once, after everything that it judges was fixed."
    return (
        f"The test partition was opened {openings} times, under different splits or thresholds: "
        "it is no longer an untouched test set, and results on it are optimistic."
    )


def benchmark_sentences(ledger: Mapping[str, Any]) -> list[str]:
    """How often benchmarks of earlier builds opened the test partition; nothing where none did."""
    counts = [len(locks_of(ledger, event)) for event in (PREDICTION, RANKING)]
    if not any(counts):
        return []
    predictions, selections = (f"{count} {'time' if count == 1 else 'times'}" for count in counts)
    return [
        f"Benchmarks of earlier builds opened the test partition {predictions} for predictions and {selections} for "
        "selections: it is no longer an untouched test set for another benchmark."
    ]


def leakage_sentences(leakage: Mapping[str, Any] | None) -> list[str]:
    """Verdict of the leakage gate, its reason, the minimum detectable effect, and the diagnostic battery.

    Args:
        leakage: Document ``leakage.json``; None where leakage was not audited.
    """
    if leakage is None:
        return ["Leakage was not audited: nothing is known about whether inputs tell the action that follows."]
    gate = leakage["gate"]
    shape = gate["shape"]
    seen = f"{shape['groups']:,} groups, {shape['actions']:,} actions and {shape['features']:,} features"
    sentences = [f"The leakage gate {_VERDICTS[gate['verdict']]} ({seen}).", _sentence(gate["reason"])]
    if gate["verdict"] == "fail":
        sentences += [_place_sentence(place) for place in gate["places"][:_PLACES_SHOWN]]
    return [sentence for sentence in [*sentences, *_effect(gate), *_battery(leakage)] if sentence]


def _battery(leakage: Mapping[str, Any]) -> list[str]:
    """What the tests of the diagnostic battery came to, and why some did not run."""
    counts = Counter(test["status"] for way in leakage["battery"]["ways"] for test in way["tests"])
    if not counts:
        return []
    told = ", ".join(f"{counts[status]} {title}" for status, title in _STATUSES.items() if counts[status])
    reasons = dict.fromkeys(_sentence(entry["reason"]) for entry in leakage["not_run"])
    return [f"The battery of classifiers, a diagnostic beside the gate: {told}.", *reasons]


def _place_sentence(place: Mapping[str, Any]) -> str:
    at = f"{place['source']} {place['variable']}{_ticks(place['offset_ticks'])}"
    return f"Action {place['action']} differs in {at} by {place['difference']:.3g} (adjusted p {place['p']:.2g})."


def _effect(gate: Mapping[str, Any]) -> list[str]:
    effect = gate["minimum_detectable_effect"]
    if effect is None:
        why = "replays are bit-identical" if gate["bit_identical"] else "no feature has a value to move"
        return [f"Minimum detectable effect: not applicable, {why}."]
    offsets = sorted({found["offset_sd"] for found in effect["detections"]})
    sentences = []
    for pattern, where in _PATTERNS.items():
        smallest = effect["smallest_sd"].get(pattern)
        if smallest is not None:
            least = "at most " if offsets and smallest == offsets[0] else ""
            found = f"{least}{smallest:g} standard deviations"
        else:
            found = f"above {offsets[-1]:g} standard deviations" if offsets else "unknown"
        sentences.append(f"Minimum detectable effect {where}: {found}.")
    return sentences


def _ticks(span: list[int] | None) -> str:
    if span is None:
        return ""
    return f" at tick {span[0]}" if span[0] == span[-1] else f" at ticks {span[0]} to {span[-1]}"


def _sentence(text: str) -> str:
    text = text.strip()
    return text if not text or text.endswith(".") else f"{text}."
