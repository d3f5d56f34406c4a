"""Guards side by side: the paper's and the selection-path guard, one profile, from predictions and outcomes.

The global margin is fitted on the validation partition, as in the paper; the selection path is calibrated on its own
partition; every selection is then looked up in the test partition, and judged by its outcomes there. Groups in which a
candidate has no utility or no separation take no part and are counted. `action_prior`, which takes the same candidate
everywhere, stands beside them without a guard: a selector has to be worth more than that.

Source: paper, "Conservative Calibration and Deployment Boundary" for the global margin; the rest is this project's
choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.calibration import Calibration, conformal, learn_then_test
from branchdrive.benchmark.guard.data import CompleteGroups, GuardPartitions, Setting, complete_groups
from branchdrive.benchmark.guard.figure import RATES, terms
from branchdrive.benchmark.guard.path import (
    GlobalMargin,
    MarginReport,
    SelectionPath,
    fit_margin,
    margin_report,
    margin_selection,
    violations,
)
from branchdrive.benchmark.guard.redraw import Redraws, redrawn_margin, redrawn_path
from branchdrive.benchmark.guard.risk import RiskFit, guarded_path
from branchdrive.benchmark.ranking.ratio import Figure, cluster_weights, figures

__all__ = ["SELECTIONS", "Assessment", "TradeOff", "assess"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

SELECTIONS = ("nominal", "action_prior", "unguarded", "global_margin", "conformal", "learn_then_test")
"""Names of the selections, in the order of `Assessment.selections`."""


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


class _Calibrated(NamedTuple):
    """The selection path on the calibration partition, and the places that are taken on it."""

    path: SelectionPath
    conformal: Calibration
    learn_then_test: Calibration


def assess(fit: RiskFit, partitions: GuardPartitions, setting: Setting) -> Assessment:
    """Fit the margin, calibrate the path, select in the test partition, and judge what was selected.

    Args:
        fit: Learned risk, from training.
        partitions: Predictions and outcomes.
        setting: Profile, limits and draws.

    Raises:
        ValueError: The risk was fitted for another tolerance, a prediction is not finite, shapes do not match, or a
            partition has no group that takes part.
    """
    tolerance_m = setting.limits.tolerance_m
    if fit.tolerance_m != tolerance_m:
        raise ValueError(f"the risk was fitted for a tolerance of {fit.tolerance_m:g} m, not {tolerance_m:g} m")
    validation, calibration, test = (complete_groups(data, setting) for data in partitions)
    margin = _fit(validation, setting)
    calibrated = _calibrate(fit, calibration, setting)
    path = _path(fit, test, setting)
    selections = _select(path, test, margin, calibrated, setting)
    return Assessment(
        kept=test.kept,
        num_left_out={
            name: int((~groups.kept).sum())
            for name, groups in zip(GuardPartitions._fields, (validation, calibration, test), strict=True)
        },
        margin=margin,
        margin_validation=_report(validation, margin, setting),
        margin_test=_report(test, margin, setting),
        conformal=calibrated.conformal,
        learn_then_test=calibrated.learn_then_test,
        selections=selections,
        figures=_judge(selections, test, calibrated, setting),
        trade_off=_trade_off(path, test, setting),
        redraws=_redraw(validation, calibration, test, calibrated, path, setting),
    )


def _fit(validation: CompleteGroups, setting: Setting) -> GlobalMargin:
    """The paper's margin."""
    predicted_m, separation_m = validation.predicted_m, validation.separation_m
    return fit_margin(predicted_m, separation_m, nominal=setting.nominal, coverage=setting.limits.coverage)


def _calibrate(fit: RiskFit, calibration: CompleteGroups, setting: Setting) -> _Calibrated:
    """Where on the selection path conformal risk control and learn then test stop."""
    limits, path = setting.limits, _path(fit, calibration, setting)
    losses, clusters = _violations(path, calibration, setting), calibration.clusters
    least = {"min_groups": limits.min_groups, "min_clusters": limits.min_clusters}
    return _Calibrated(
        path,
        conformal(losses, clusters, alpha=limits.alpha, **least),
        learn_then_test(
            losses, clusters, calibration.groups, seed=setting.seed, alpha=limits.alpha, delta=limits.delta, **least
        ),
    )


def _select(
    path: SelectionPath, test: CompleteGroups, margin: GlobalMargin, calibrated: _Calibrated, setting: Setting
) -> dict[str, Indices]:
    """Chosen candidates of every selection ``[groups]``, by the names `SELECTIONS`."""
    chosen = (
        path.selections[0],
        np.full(len(test.groups), setting.action_prior, np.intp),
        path.selections[-1],
        margin_selection(test.predicted_m, test.predicted_utilities, margin, nominal=setting.nominal),
        path.selections[calibrated.conformal.place],
        path.selections[calibrated.learn_then_test.place],
    )
    return dict(zip(SELECTIONS, chosen, strict=True))


def _judge(
    selections: Mapping[str, Indices], test: CompleteGroups, calibrated: _Calibrated, setting: Setting
) -> dict[str, Mapping[str, Figure]]:
    """Figures of every selection, by selection and name."""
    settled = _settled(calibrated, always_nominal=setting.action_prior == setting.nominal)
    found = {}
    for name, chosen in selections.items():
        counted = terms(
            chosen,
            selections["unguarded"],
            test.utilities,
            test.separation_m,
            test.clusters,
            nominal=setting.nominal,
            tolerance_m=setting.limits.tolerance_m,
        )
        found[name] = figures(
            counted,
            test.clusters,
            seed=setting.seed,
            num_resamples=setting.num_resamples,
            rates=RATES,
            settled=settled.get(name, ()),
        )
    return found


def _settled(calibrated: _Calibrated, *, always_nominal: bool) -> dict[str, Sequence[str]]:
    """Rates that follow from what a selection is: nominal never loses, ActionPrior always intervenes."""
    stays = {found.method: found.place == 0 for found in (calibrated.conformal, calibrated.learn_then_test)}
    stays |= {"nominal": True, "action_prior": always_nominal}
    return {
        "action_prior": ("intervention",),
        **{name: RATES for name, holds in stays.items() if holds},
    }


def _path(fit: RiskFit, found: CompleteGroups, setting: Setting) -> SelectionPath:
    return guarded_path(
        fit,
        found.scalars,
        nominal=setting.nominal,
        scale=setting.scale,
        profile=setting.profile,
        profile_name=setting.profile_name,
    )


def _violations(path: SelectionPath, found: CompleteGroups, setting: Setting) -> Mask:
    """Violations along a path ``[multipliers, groups]``."""
    tolerance_m = setting.limits.tolerance_m
    return violations(path.selections, found.separation_m, nominal=setting.nominal, tolerance_m=tolerance_m)


def _report(found: CompleteGroups, margin: GlobalMargin, setting: Setting) -> MarginReport:
    return margin_report(
        found.predicted_m,
        found.separation_m,
        found.predicted_utilities,
        found.utilities,
        margin,
        nominal=setting.nominal,
        action_prior=setting.action_prior,
    )


def _trade_off(path: SelectionPath, test: CompleteGroups, setting: Setting) -> TradeOff:
    violated, weights = _violations(path, test, setting), cluster_weights(test.clusters)
    gains = test.utilities[np.arange(len(test.groups)), path.selections] - test.utilities[:, setting.nominal]
    return TradeOff(
        path.multipliers,
        violated.mean(axis=1),
        (violated * weights).sum(axis=1) / weights.sum(),
        (path.selections != setting.nominal).mean(axis=1),
        gains.mean(axis=1),
    )


def _redraw(
    validation: CompleteGroups,
    calibration: CompleteGroups,
    test: CompleteGroups,
    calibrated: _Calibrated,
    path: SelectionPath,
    setting: Setting,
) -> dict[str, Redraws | None] | None:
    """Guards over redraws; `None` where no redraws are asked for."""
    if setting.num_redraws is None:
        return None
    selections = np.concatenate([calibrated.path.selections, path.selections], axis=1)
    methods = (calibrated.conformal, calibrated.learn_then_test)
    is_judged = {found.method: found.refusal is None for found in methods}
    return {
        "global_margin": redrawn_margin(validation, test, setting, setting.num_redraws),
        **redrawn_path(calibration, test, selections, is_judged, setting, setting.num_redraws),
    }
