"""Everything that a leakage audit fixes before it sees data.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" for the kinds of tests and the resamples of the
battery; other choices and their values are this project's, and measured power decided between them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = [
    "CLIP_SD", "CONTROLS", "SEQUENCE_TESTS", "STATISTICS", "TESTS", "AuditProtocol", "BatteryProtocol", "GateProtocol",
]  # fmt: skip

STATISTICS = ("rank_max_t", "max_t", "hsic", "ridge", "concordance", "interaction")
"""Names of the statistics, in the order of every axis over statistics."""

CLIP_SD = 6.0
"""Standardised features are clipped to this distance from the group median, so that no single drive decides."""

SEQUENCE_TESTS = ("ego", "controls", "ego_controls")
"""Tests that need a sequence classifier."""

TESTS = ("availability", "discrepancy", *SEQUENCE_TESTS)
"""Names of the tests, in the order of reports."""

CONTROLS = ("explicit_label", "synthetic_offset", "random_label")
"""Names of the controls; the last is the one in which nothing must be found."""


_LISTS = ("subsets", "offsets_sd", "sparse_offsets_sd")


@dataclass(frozen=True)
class GateProtocol:
    """Numbers of the gate; they belong into the report.

    Attributes:
        alpha: Family-wise error of the statistics together, above 0 and below 1.
        num_permutations: Permutations drawn, at least 1; smallest p is ``1 / (num_permutations + 1)``.
        num_frequencies: Random frequencies of the kernel, at least 1; each gives a cosine and a sine.
        bandwidth: Of the Gaussian kernel, in standard deviations over all columns; None is the median heuristic.
        num_folds: Folds over groups of the cross-fitted ridge, at least 2.
        penalty: Of the ridge, in units of the mean eigenvalue of the training Gram matrix, above 0.
        subsets: Parts of the groups that concordance is looked for in: one in so many, at least 1 each, ascending.
        offsets_sd: Offsets of the minimum detectable effect, standard deviations, ascending and above 0.
        sparse_offsets_sd: The same where few groups get the offset.
        num_replicates: Data sets without a leak into which every offset is injected, at least 1.
        num_named: Largest number of places that a finding names, at least 1.
        scratch_bytes: Bound on what one chunk of permutations occupies; no result depends on it.

    Raises:
        ValueError: A number is outside of its range.
    """

    alpha: float = 0.001
    num_permutations: int = 9_999
    num_frequencies: int = 200
    bandwidth: float | None = None
    num_folds: int = 5
    penalty: float = 0.01
    subsets: tuple[int, ...] = (1, 10, 30)
    offsets_sd: tuple[float, ...] = (0.1, 0.2, 0.4, 0.8)
    sparse_offsets_sd: tuple[float, ...] = (0.8, 1.6, 3.2, 6.4)
    num_replicates: int = 5
    num_named: int = 10
    scratch_bytes: int = 64 * 2**20

    def __post_init__(self) -> None:
        for name, least in (
            ("num_permutations", 1),
            ("num_frequencies", 1),
            ("num_folds", 2),
            ("num_replicates", 1),
            ("num_named", 1),
            ("scratch_bytes", 1),
        ):
            if getattr(self, name) < least:
                raise ValueError(f"`{name}` is {getattr(self, name)!r}, not at least {least}")
        if not 0 < self.alpha < 1:
            raise ValueError(f"`alpha` is {self.alpha!r}, not above 0 and below 1")
        positive = {"penalty": self.penalty} | ({} if self.bandwidth is None else {"bandwidth": self.bandwidth})
        for name, value in positive.items():
            if not 0 < value < math.inf:
                raise ValueError(f"`{name}` is {value!r}, not above 0 and finite")
        for name in ("offsets_sd", "sparse_offsets_sd"):
            offsets = getattr(self, name)
            if not all(0 < offset < math.inf for offset in offsets):
                raise ValueError(f"`{name}` is {offsets!r}, not all above 0 and finite")
        if not all(part >= 1 for part in self.subsets):
            raise ValueError(f"`subsets` is {self.subsets!r}, not all at least 1")
        for name in ("offsets_sd", "sparse_offsets_sd", "subsets"):
            if list(getattr(self, name)) != sorted(set(getattr(self, name))):
                raise ValueError(f"`{name}` is {getattr(self, name)!r}, not ascending")


@dataclass(frozen=True)
class BatteryProtocol:
    """Numbers of the paper's battery; they belong into the report.

    Attributes:
        alpha: Family-wise error over all tests, above 0 and below 1.
        control_alpha: Level at which a control counts as found, above 0 and below 1.
        num_permutations: Of labels on held-out scores, at least 1.
        num_resamples: Of groups for intervals, at least 1.
        penalty: Of the logistic regression, above 0.
        offset_sd: Of the synthetic offset, within-group standard deviations, above 0.
        score_atol: Largest difference of log-probabilities that count as identical, at least 0.

    Raises:
        ValueError: A number is outside of its range.
    """

    alpha: float = 0.05
    control_alpha: float = 0.001
    num_permutations: int = 10_000
    num_resamples: int = 2_000
    penalty: float = 1.0
    offset_sd: float = 3.0
    score_atol: float = 1e-9

    def __post_init__(self) -> None:
        for name in ("alpha", "control_alpha"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"`{name}` is {getattr(self, name)!r}, not above 0 and below 1")
        for name in ("num_permutations", "num_resamples"):
            if getattr(self, name) < 1:
                raise ValueError(f"`{name}` is {getattr(self, name)!r}, not at least 1")
        for name in ("penalty", "offset_sd"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"`{name}` is {getattr(self, name)!r}, not above 0 and finite")
        if not 0 <= self.score_atol < math.inf:
            raise ValueError(f"`score_atol` is {self.score_atol!r}, not at least 0 and finite")


@dataclass(frozen=True)
class AuditProtocol:
    """Numbers of a whole audit.

    Attributes:
        gate: Of the gate.
        battery: Of the paper's battery.
    """

    gate: GateProtocol = field(default_factory=GateProtocol)
    battery: BatteryProtocol = field(default_factory=BatteryProtocol)

    def as_json(self) -> dict[str, Any]:
        """All numbers that a result depends on."""
        gate = {name: value for name, value in asdict(self.gate).items() if name != "scratch_bytes"}
        lists = {name: list(gate[name]) for name in _LISTS}
        return {"gate": {**gate, **lists}, "parity": asdict(self.battery)}

    @classmethod
    def from_json(cls, numbers: Mapping[str, Any]) -> AuditProtocol:
        """GateProtocol that a document states; counts may be written as ``1.0``.

        Raises:
            ValueError: A number is outside of its range.
        """
        gate, parity = (_with_whole_counts(numbers[part]) for part in ("gate", "parity"))
        subsets, offsets_sd, sparse_offsets_sd = (tuple(gate.pop(name)) for name in _LISTS)
        lists = {"subsets": tuple(map(int, subsets)), "offsets_sd": offsets_sd, "sparse_offsets_sd": sparse_offsets_sd}
        return cls(GateProtocol(**{**gate, **lists}), BatteryProtocol(**parity))


def _with_whole_counts(numbers: Mapping[str, Any]) -> dict[str, Any]:
    return {name: int(value) if name.startswith("num_") else value for name, value in numbers.items()}
