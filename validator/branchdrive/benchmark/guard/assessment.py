"""Guards side by side: the paper's and the selection-path guard, one profile, from predictions and outcomes.

The global margin is fitted on the validation partition, as in the paper; the selection path is calibrated on its own
partition; every selection is then looked up in the test partition. Groups in which a candidate has no utility or
no separation take no part and are counted. `action_prior`, which takes the same candidate everywhere, stands beside
them without a guard: a selector has to be worth more than that.

Source: paper, "Conservative Calibration and Deployment Boundary" for the global margin; the rest is this project's
choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.calibration import (
    ALPHA,
    DELTA,
    MIN_CLUSTERS,
    MIN_GROUPS,
    Calibration,
    conformal,
    learn_then_test,
)
from branchdrive.benchmark.guard.figure import RATES, terms
from branchdrive.benchmark.guard.path import (
    COVERAGE,
    TOLERANCE_M,
    GlobalMargin,
    MarginReport,
    SelectionPath,
    fit_margin,
    margin_report,
    margin_selection,
    violations,
    worst_overprediction,
)
from branchdrive.benchmark.guard.redraw import (
    Executed,
    Redraws,
    conformal_places,
    judged,
    learn_then_test_places,
    margin_places,
    pool_of,
)
from branchdrive.benchmark.guard.risk import RiskFit, guarded_path
from branchdrive.benchmark.ranking.measure import choose
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.benchmark.ranking.ratio import Figure, cluster_weights, figures
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import Profile, Scale, predicted_utility, utility
from branchdrive.statistics.bootstrap import NUM_RESAMPLES

__all__ = ["SELECTIONS", "Assessment", "GuardData", "Limits", "TradeOff", "assess"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

SELECTIONS = ("nominal", "action_prior", "unguarded", "global_margin", "conformal", "learn_then_test")
"""Names of the selections, in the order of `Assessment.selections`."""


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


_LIMITS = Limits()


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


class TradeOff(NamedTuple):
    """The whole path on the test partition, each ``[multipliers]``: a figure, from which nothing may be chosen.

    Attributes:
        multipliers: ``lambda``, from ``inf`` to 0.
        violation: Share of groups with a violation.
        violation_of_clusters: The same with equal weight for every cluster, which the guarantee is about.
        intervention: Share of groups that leave nominal.
        gain: Mean executed utility gained over nominal.
    """

    multipliers: Array
    violation: Array
    violation_of_clusters: Array
    intervention: Array
    gain: Array


class Assessment(NamedTuple):
    """What the guards do.

    Attributes:
        kept: Groups of the test partition that take part, ``[groups]``.
        num_left_out: Groups that take no part, by partition: validation, calibration, test.
        margin: The paper's margin.
        margin_validation: Its report on the validation groups it was fitted on.
        margin_test: Its report on the test groups.
        conformal: Calibration of the selection path.
        learn_then_test: The variant beside it.
        selections: Chosen candidate of every test group that takes part, by the names `SELECTIONS`.
        figures: Figures of every selection, by selection and name.
        trade_off: The path on the test partition.
        redraws: Guards over redraws, by the last names of `SELECTIONS`, `None` for a guard that was not judged; `None`
            where no redraws are asked for.
    """

    kept: NDArray[np.bool_]
    num_left_out: Mapping[str, int]
    margin: GlobalMargin
    margin_validation: MarginReport
    margin_test: MarginReport
    conformal: Calibration
    learn_then_test: Calibration
    selections: Mapping[str, Indices]
    figures: Mapping[str, Mapping[str, Figure]]
    trade_off: TradeOff
    redraws: Mapping[str, Redraws | None] | None


class _CompleteGroups(NamedTuple):
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


def assess(
    fit: RiskFit,
    *,
    validation: GuardData,
    calibration: GuardData,
    test: GuardData,
    nominal: int,
    action_prior: int,
    scale: Scale,
    profile: Profile,
    profile_name: str,
    seed: int,
    num_resamples: int = NUM_RESAMPLES,
    limits: Limits = _LIMITS,
    num_redraws: int | None = None,
) -> Assessment:
    """Fit the margin, calibrate the path, and look both up in the test partition.

    Args:
        fit: Learned risk, from training.
        validation: Partition of the global margin.
        calibration: Partition of the selection path.
        test: Partition of the figures.
        nominal: Place of the nominal candidate.
        action_prior: Candidate with the greatest mean utility in training.
        scale: Quantiles of the training partition.
        profile: What is preferred.
        profile_name: Its name in `RiskFit.grids`.
        seed: Of the draw of learn then test and of intervals.
        num_resamples: Of intervals.
        limits: What guards are held to.
        num_redraws: Further divisions of calibrating and test clusters; none by default.

    Raises:
        ValueError: The risk was fitted for another tolerance, a prediction is not finite, shapes do not match, or a
            partition has no group that takes part.
    """
    if fit.tolerance_m != limits.tolerance_m:
        raise ValueError(f"the risk was fitted for a tolerance of {fit.tolerance_m:g} m, not {limits.tolerance_m:g} m")
    val, cal, tested = (_complete_groups(data, scale, profile) for data in (validation, calibration, test))

    def path_of(found: _CompleteGroups) -> SelectionPath:
        return guarded_path(
            fit, found.scalars, nominal=nominal, scale=scale, profile=profile, profile_name=profile_name
        )

    def lost(path: SelectionPath, found: _CompleteGroups) -> NDArray[np.bool_]:
        return violations(path.selections, found.separation_m, nominal=nominal, tolerance_m=limits.tolerance_m)

    calibration_path = path_of(cal)
    losses = lost(calibration_path, cal)
    least = {"min_groups": limits.min_groups, "min_clusters": limits.min_clusters}
    exact = conformal(losses, cal.clusters, alpha=limits.alpha, **least)
    tail = learn_then_test(losses, cal.clusters, cal.groups, seed=seed, alpha=limits.alpha, delta=limits.delta, **least)
    margin = fit_margin(val.predicted_m, val.separation_m, nominal=nominal, coverage=limits.coverage)
    path = path_of(tested)
    selections = dict(
        zip(
            SELECTIONS,
            (
                path.selections[0],
                np.full(len(tested.groups), action_prior, np.intp),
                path.selections[-1],
                margin_selection(tested.predicted_m, tested.predicted_utilities, margin, nominal=nominal),
                path.selections[exact.place],
                path.selections[tail.place],
            ),
            strict=True,
        )
    )
    settled = _settled(exact, tail, always_nominal=action_prior == nominal)
    found = {
        name: figures(
            terms(
                chosen,
                path.selections[-1],
                tested.utilities,
                tested.separation_m,
                tested.clusters,
                nominal=nominal,
                tolerance_m=limits.tolerance_m,
            ),
            tested.clusters,
            seed=seed,
            num_resamples=num_resamples,
            rates=RATES,
            settled=settled.get(name, ()),
        )
        for name, chosen in selections.items()
    }
    losses = lost(path, tested)
    weights = cluster_weights(tested.clusters)
    gains = tested.utilities[np.arange(len(tested.groups)), path.selections] - tested.utilities[:, nominal]
    places = {"nominal": nominal, "action_prior": action_prior}
    reports = [
        margin_report(of.predicted_m, of.separation_m, of.predicted_utilities, of.utilities, margin, **places)
        for of in (val, tested)
    ]
    return Assessment(
        kept=tested.kept,
        num_left_out={
            name: int((~part.kept).sum())
            for name, part in (("validation", val), ("calibration", cal), ("test", tested))
        },
        margin=margin,
        margin_validation=reports[0],
        margin_test=reports[1],
        conformal=exact,
        learn_then_test=tail,
        selections=selections,
        figures=found,
        trade_off=TradeOff(
            path.multipliers,
            losses.mean(axis=1),
            (losses * weights).sum(axis=1) / weights.sum(),
            (path.selections != nominal).mean(axis=1),
            gains.mean(axis=1),
        ),
        redraws=None
        if num_redraws is None
        else {
            "global_margin": _redrawn_margin(val, tested, nominal, limits, seed, num_redraws),
            **_redrawn_path(
                cal,
                tested,
                np.concatenate([calibration_path.selections, path.selections], axis=1),
                {found.method: found.refusal is None for found in (exact, tail)},
                nominal,
                limits,
                seed,
                num_redraws,
            ),
        },
    )


def _redrawn_margin(
    val: _CompleteGroups, tested: _CompleteGroups, nominal: int, limits: Limits, seed: int, num_redraws: int
) -> Redraws:
    """The global margin over redraws of validation and test clusters."""
    pool = pool_of(val.members, tested.members, seed=seed, num_redraws=num_redraws)
    predicted_m, utilities = (
        np.concatenate([getattr(part, name) for part in (val, tested)])
        for name in ("predicted_m", "predicted_utilities")
    )
    executed = _executed(val, tested, nominal, limits)
    worst = worst_overprediction(predicted_m, executed.separation_m, nominal=nominal)
    margins, places = margin_places(worst, pool, coverage=limits.coverage)
    selections = np.stack(
        [
            margin_selection(predicted_m, utilities, GlobalMargin(margin_m, 0, 0), nominal=nominal)
            for margin_m in margins.tolist()
        ]
    )
    return judged(selections, choose(utilities), executed, pool, places)


def _redrawn_path(
    cal: _CompleteGroups,
    tested: _CompleteGroups,
    selections: Indices,
    is_judged: Mapping[str, bool],
    nominal: int,
    limits: Limits,
    seed: int,
    num_redraws: int,
) -> dict[str, Redraws | None]:
    """The selection path over redraws of calibration and test clusters; `None` where it was not judged."""
    if not any(is_judged.values()):
        return dict.fromkeys(is_judged)
    pool = pool_of(cal.members, tested.members, seed=seed, num_redraws=num_redraws)
    executed = _executed(cal, tested, nominal, limits)
    losses = violations(selections, executed.separation_m, nominal=nominal, tolerance_m=limits.tolerance_m)
    places = {
        "conformal": conformal_places(losses, pool, alpha=limits.alpha),
        "learn_then_test": learn_then_test_places(losses, pool, alpha=limits.alpha, delta=limits.delta),
    }
    return {
        name: judged(selections, selections[-1], executed, pool, places[name]) if holds else None
        for name, holds in is_judged.items()
    }


def _executed(one: _CompleteGroups, other: _CompleteGroups, nominal: int, limits: Limits) -> Executed:
    utilities, separation_m = (
        np.concatenate([getattr(part, name) for part in (one, other)]) for name in ("utilities", "separation_m")
    )
    return Executed(utilities, separation_m, nominal, limits.tolerance_m, limits.alpha)


def _settled(exact: Calibration, tail: Calibration, *, always_nominal: bool) -> dict[str, Sequence[str]]:
    """Rates that follow from what a selection is: nominal never loses, ActionPrior always intervenes."""
    nominal = {"conformal": exact.place == 0, "learn_then_test": tail.place == 0, "action_prior": always_nominal}
    return {
        "action_prior": ("intervention",),
        **{name: RATES for name, holds in (("nominal", True), *nominal.items()) if holds},
    }


def _complete_groups(data: GuardData, scale: Scale, profile: Profile) -> _CompleteGroups:
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
    return _CompleteGroups(
        kept=kept,
        scalars=scalars,
        utilities=utilities[kept],
        separation_m=separation[kept],
        groups=[name for name, keeps in zip(data.groups, kept, strict=True) if keeps],
        clusters=[name for name, keeps in zip(data.clusters, kept, strict=True) if keeps],
        predicted_m=mean[..., SEPARATION],
        predicted_utilities=predicted_utility(mean, scale, profile),
    )
