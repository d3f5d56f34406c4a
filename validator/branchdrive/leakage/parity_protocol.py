"""Everything that the paper's battery fixes before it sees data.

Source: paper VI-A for the kinds of tests and the resamples; other values are this project's choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["CONTROLS", "SEQUENCE_TESTS", "TESTS", "ParityProtocol"]

SEQUENCE_TESTS = ("ego", "controls", "ego_controls")
"""Tests that need a sequence classifier."""

TESTS = ("availability", "discrepancy", *SEQUENCE_TESTS)
"""Names of the tests, in the order of reports."""

CONTROLS = ("explicit_label", "synthetic_offset", "random_label")
"""Names of the controls; the last is the one in which nothing must be found."""


@dataclass(frozen=True)
class ParityProtocol:
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
