"""What guards are assessed on and under: partitions, the groups of each that take part, limits and a profile.

A group in which a candidate has no utility or no separation takes no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.calibration import ALPHA, DELTA, MIN_CLUSTERS, MIN_GROUPS
from branchdrive.benchmark.guard.path import COVERAGE, TOLERANCE_M
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import Profile, Scale, predicted_utility, utility
from branchdrive.statistics.bootstrap import NUM_RESAMPLES

__all__ = ["CompleteGroups", "GuardData", "GuardPartitions", "Limits", "Setting", "complete_groups"]

Array = NDArray[np.float64]


class Limits(NamedTuple):
    """What guards are held to.

    Attributes:
        alpha: Largest rate of violations.
        delta: Of learn then test.
        tolerance_m: Of a violation, metres.
        min_groups: Calibration groups below which the selection path is not judged.
        min_clusters: Their clusters.
        coverage: Of the global margin.
    """

    alpha: float = ALPHA
    delta: float = DELTA
    tolerance_m: float = TOLERANCE_M
    min_groups: int = MIN_GROUPS
    min_clusters: int = MIN_CLUSTERS
    coverage: float = COVERAGE


class GuardData(NamedTuple):
    """One partition.

    Attributes:
        scalars: Predicted targets ``[seeds, groups, candidates, 6]``.
        outcomes: Executed targets ``[groups, candidates, 6]``.
        groups: Identifier of every group.
        clusters: Route cluster of every group.
    """

    scalars: Array
    outcomes: Targets
    groups: Sequence[str]
    clusters: Sequence[str]


class GuardPartitions(NamedTuple):
    """Partitions of an assessment.

    Attributes:
        validation: The global margin is fitted on it.
        calibration: The selection path is calibrated on it.
        test: Figures are of it.
    """

    validation: GuardData
    calibration: GuardData
    test: GuardData


class Setting(NamedTuple):
    """What guards are assessed under.

    Attributes:
        profile_name: Name of the profile in `RiskFit.grids`.
        profile: What is preferred.
        scale: Quantiles of the training partition.
        nominal: Place of the nominal candidate.
        action_prior: Candidate with the greatest mean utility in training.
        seed: Of the draw of learn then test, of intervals and of redraws.
        num_resamples: Of intervals.
        num_redraws: Further divisions of calibrating and test clusters; `None` for none.
        limits: What guards are held to.
    """

    profile_name: str
    profile: Profile
    scale: Scale
    nominal: int
    action_prior: int
    seed: int
    num_resamples: int = NUM_RESAMPLES
    num_redraws: int | None = None
    limits: Limits = Limits()


class CompleteGroups(NamedTuple):
    """The groups of a partition that take part."""

    kept: NDArray[np.bool_]
    scalars: Array
    utilities: Array
    separation_m: Array
    groups: list[str]
    clusters: list[str]
    predicted_m: Array
    predicted_utilities: Array

    @property
    def members(self) -> tuple[tuple[str, str], ...]:
        """Identifier and cluster of every group."""
        return tuple(zip(self.groups, self.clusters, strict=True))


def complete_groups(data: GuardData, setting: Setting) -> CompleteGroups:
    """The groups of a partition that take part.

    Raises:
        ValueError: Shapes do not match, or no group takes part.
    """
    scale, profile = setting.scale, setting.profile
    shape = data.outcomes.values.shape
    if data.scalars.ndim != 4 or data.scalars.shape[1:] != shape or not len(data.scalars):
        raise ValueError(f"predictions {list(data.scalars.shape)} and outcomes {list(shape)} do not match")
    if not len(data.groups) == len(data.clusters) == shape[0]:
        raise ValueError(
            f"{len(data.groups)} groups and {len(data.clusters)} clusters do not match {shape[0]} outcomes"
        )
    utilities, separation = utility(data.outcomes, scale, profile), data.outcomes.values[..., SEPARATION]
    kept = np.asarray(np.isfinite(utilities).all(axis=1) & np.isfinite(separation).all(axis=1))
    if not kept.any():
        raise ValueError(f"none of {len(kept)} groups has every utility and separation; a guard needs one")
    scalars = data.scalars[:, kept]
    mean = scalars.mean(axis=0)
    return CompleteGroups(
        kept=kept,
        scalars=scalars,
        utilities=utilities[kept],
        separation_m=separation[kept],
        groups=[name for name, keeps in zip(data.groups, kept, strict=True) if keeps],
        clusters=[name for name, keeps in zip(data.clusters, kept, strict=True) if keeps],
        predicted_m=mean[..., SEPARATION],
        predicted_utilities=predicted_utility(mean, scale, profile),
    )
