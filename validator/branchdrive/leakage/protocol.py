"""Everything that a leakage gate fixes before it sees data.

Source: the choices and their values are this project's; measured power decided between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["CLIP_SD", "STATISTICS", "Protocol"]

STATISTICS = ("rank_max_t", "max_t", "hsic", "ridge")
"""Names of the statistics, in the order of every axis over statistics."""

CLIP_SD = 6.0
"""Standardised features are clipped to this distance from the group median, so that no single drive decides."""


@dataclass(frozen=True)
class Protocol:
    """Numbers of the gate; they belong into the report.

    Attributes:
        alpha: Family-wise error of the statistics together, above 0 and below 1.
        num_permutations: Permutations drawn, at least 1; smallest p is ``1 / (num_permutations + 1)``.
        num_frequencies: Random frequencies of the kernel, at least 1; each gives a cosine and a sine.
        bandwidth: Of the Gaussian kernel, in standard deviations over all columns; None is the median heuristic.
        num_folds: Folds over groups of the cross-fitted ridge, at least 2.
        penalty: Of the ridge, in units of the mean eigenvalue of the training Gram matrix, above 0.
        offsets_sd: Offsets of the minimum detectable effect, standard deviations, ascending and above 0.
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
    offsets_sd: tuple[float, ...] = (0.1, 0.2, 0.4, 0.8)
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
        if not all(0 < offset < math.inf for offset in self.offsets_sd):
            raise ValueError(f"`offsets_sd` is {self.offsets_sd!r}, not all above 0 and finite")
        if list(self.offsets_sd) != sorted(set(self.offsets_sd)):
            raise ValueError(f"`offsets_sd` is {self.offsets_sd!r}, not ascending")
