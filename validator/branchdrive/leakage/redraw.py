"""What an auditor finds when it draws permutations of the gate again.

Permutations are functions of seed and number, so an auditor draws the first of them as the audit did: 199, and on
in doubling numbers until 3 reach every statistic or all are drawn. A p-value that would fail the gate is so
judged on all permutations, and one that is far from it on few. The effect size is judged on the first replicate
at the offsets that decide it.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.agreement import REL, Difference
from branchdrive.leakage.battery import Battery
from branchdrive.leakage.gate import Place
from branchdrive.leakage.plausible import is_plausible
from branchdrive.leakage.protocol import STATISTICS, Protocol
from branchdrive.leakage.sensitivity import PATTERNS, replicate_values
from branchdrive.statistics.permutation import critical_rank, reaching

__all__ = ["redrawn_differences"]

Array = NDArray[np.float64]

_FIRST = 199
"""Permutations that are drawn at least."""

_REACHED = 3
"""Permutations that must reach every statistic before no more are drawn."""


def redrawn_differences(
    gate: Mapping[str, Any], features: Array, battery: Battery, places: tuple[Place, ...], protocol: Protocol, seed: int
) -> list[Difference]:
    """p-values, critical values and detections of a stated gate against permutations and a replicate drawn again.

    Args:
        gate: As stated, with four tests.
        features: As the gate saw them ``[groups, actions, features]``, dealt to the folds.
        battery: Statistics of these features.
        places: As they recompute.
        protocol: Numbers of the gate.
        seed: Of the audit.
    """
    observed = battery.observed()
    null = _prefix(battery, observed, protocol, seed)
    total = protocol.num_permutations
    found: list[Difference] = []
    for index, (test, value) in enumerate(zip(gate["tests"], observed.tolist(), strict=True)):
        found += _unlikely(f"/gate/tests/{index}/p", test["p"], value, null[:, index], total)
    largest = null[:, STATISTICS.index("max_t")]
    for index, (place, named) in enumerate(zip(places, gate["places"], strict=False)):
        found += _unlikely(f"/gate/places/{index}/p", named["p"], abs(place.t), largest, total)
    effect = gate["minimum_detectable_effect"]
    if effect is not None:
        found += _critical_differences(effect, null, protocol)
        found += _detection_differences(effect, features, battery, protocol, seed)
    return found


def _prefix(battery: Battery, observed: Array, protocol: Protocol, seed: int) -> Array:
    """Null distribution of the first permutations, as many as tell the p-values ``[drawn, 4]``."""
    total = protocol.num_permutations
    null = np.empty((0, len(STATISTICS)))
    stop = min(_FIRST, total)
    while True:
        more = battery.null(stop, seed=seed, scratch_bytes=protocol.scratch_bytes, start=len(null))
        null = np.concatenate([null, more])
        if stop == total or (reaching(null, observed) >= _REACHED).all():
            return null
        stop = min(2 * stop, total)


def _unlikely(pointer: str, p: float, value: float, null: Array, total: int) -> Iterator[Difference]:
    reached = int(reaching(null, value))
    if not is_plausible(reached, len(null), p, total):
        yield Difference(pointer, f"a p-value that fits {reached:,} of {len(null):,} permutations", p)


def _critical_differences(effect: Mapping[str, Any], null: Array, protocol: Protocol) -> Iterator[Difference]:
    """Fewer permutations than the rank of a critical value exceed it, and of all permutations that many reach it."""
    rank = critical_rank(protocol.num_permutations, protocol.alpha / len(STATISTICS))
    for index, (value, column) in enumerate(zip(effect["critical"], null.T, strict=True)):
        if value is None:
            continue
        beyond = int(np.count_nonzero(column > value + REL * abs(value)))
        reached = int(np.count_nonzero(column >= value - REL * abs(value)))
        if beyond >= rank or (len(column) == protocol.num_permutations and reached < rank):
            told = f"a value that {beyond:,} of {len(column):,} permutations do not exceed"
            if beyond < rank:
                told = f"a value that {rank} of {len(column):,} permutations reach"
            yield Difference(f"/gate/minimum_detectable_effect/critical/{index}", told, value)


def _detection_differences(
    effect: Mapping[str, Any], features: Array, battery: Battery, protocol: Protocol, seed: int
) -> Iterator[Difference]:
    """Shares of 0 and 1 against the first replicate, at the smallest offset stated and the largest that was missed."""
    critical = np.array([np.inf if value is None else value for value in effect["critical"]])
    for pattern in PATTERNS:
        of_pattern = [(i, d) for i, d in enumerate(effect["detections"]) if d["pattern"] == pattern]
        missed = [(i, d) for i, d in of_pattern if d["gate_share"] < 1]
        smallest = [(i, d) for i, d in of_pattern if d["offset_sd"] == effect["smallest_sd"][pattern]]
        for index, said in (*smallest[:1], *missed[-1:]):
            pointer = f"/gate/minimum_detectable_effect/detections/{index}"
            moved = replicate_values(features, battery.reference, pattern, said["offset_sd"], seed=seed)
            if moved is None:
                found, tied = np.zeros(len(critical), np.bool_), np.zeros(len(critical), np.bool_)
            else:
                values = Battery.like(battery.reference, moved, protocol).observed()
                found, tied = values > critical, np.isclose(values, critical, rtol=REL, atol=0.0)
            for statistic, share in enumerate(said["shares"]):
                if not tied[statistic] and share == (0.0 if found[statistic] else 1.0):
                    told = "above 0: the first replicate is found" if found[statistic] else "below 1: it is missed"
                    yield Difference(f"{pointer}/shares/{statistic}", told, share)
            if not tied.any() and said["gate_share"] == (0.0 if found.any() else 1.0):
                told = "above 0: the first replicate is found" if found.any() else "below 1: it is missed"
                yield Difference(f"{pointer}/gate_share", told, said["gate_share"])
