"""Results of guards: the paper's and the selection-path guard side by side, with what each promises.

Source: paper, "Conservative Calibration and Deployment Boundary"; spec/14-benchmark.md#guard.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.assessment import Assessment, assess
from branchdrive.benchmark.guard.calibration import GLOBAL_MARGIN, LEARN_THEN_TEST, Calibration, guarantee
from branchdrive.benchmark.guard.data import GuardData, GuardPartitions, Limits, Setting
from branchdrive.benchmark.guard.path import MarginReport
from branchdrive.benchmark.guard.redraw import Redraws
from branchdrive.benchmark.guard.risk import RiskFit, Risks
from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.ranking.noise import OutcomeNoise, selected_differences
from branchdrive.benchmark.ranking.record import action_prior
from branchdrive.statistics.rounding import number, numbers

__all__ = ["further_guard_results", "guard_results"]


def guard_results(inputs: ResultInputs, risk_fit: RiskFit | None, noise: OutcomeNoise | None) -> dict[str, Any]:
    """The section ``guard``: empty of profiles, with the reason, where something that it needs is missing."""
    guard = inputs.protocol.guard
    return _section(inputs, (guard.model, guard.tolerance_m), risk_fit, noise)


def further_guard_results(inputs: ResultInputs, risks: Risks, noise: OutcomeNoise | None) -> list[dict[str, Any]]:
    """Sections of the same form for the other guarded models and tolerances, in the order of `Guard.further`."""
    return [_section(inputs, guarded, risks.get(guarded), noise) for guarded in inputs.protocol.guard.further]


def _section(
    inputs: ResultInputs, guarded: tuple[str, float], risk_fit: RiskFit | None, noise: OutcomeNoise | None
) -> dict[str, Any]:
    model, tolerance_m = guarded
    reason = _reason(inputs, risk_fit, model)
    profiles: list[dict[str, Any]] = []
    if reason is None and risk_fit is not None:
        partitions, limits = _partitions(inputs, model), _limits(inputs, tolerance_m)
        try:
            profiles = [
                _profile(inputs, partitions, limits, risk_fit, noise, name) for name in inputs.protocol.preferences
            ]
        except ValueError as error:
            reason = str(error)
    return {
        "model": model,
        "tolerance_m": tolerance_m,
        "reason": reason,
        "guarantee": {
            "conformal": _claimed(guarantee(tolerance_m), "conformal", profiles),
            "learn_then_test": _claimed(LEARN_THEN_TEST, "learn_then_test", profiles),
            "global_margin": GLOBAL_MARGIN if profiles else None,
        },
        "profiles": profiles,
    }


def _claimed(text: str, method: str, profiles: Sequence[Mapping[str, Any]]) -> str | None:
    """A guarantee; ``None`` where the method was judged under no profile."""
    return text if any(profile[method]["refusal"] is None for profile in profiles) else None


def _reason(inputs: ResultInputs, risk_fit: RiskFit | None, model: str) -> str | None:
    if risk_fit is None:
        return "No risk was fitted."
    for partition in inputs.protocol.predicted:
        if partition not in inputs.data.parts:
            return f"The release has no partition {partition!r}."
        if not inputs.predictions.covers(model, partition):
            return f"{model} does not predict the partition {partition!r}."
    lacking = [name for name in inputs.protocol.preferences if name not in risk_fit.grids]
    return f"The fitted risk has no multipliers for the profile {lacking[0]!r}." if lacking else None


def _partitions(inputs: ResultInputs, model: str) -> GuardPartitions:
    """What a model predicts for the partitions of an assessment, and what happened there."""
    found = []
    for name in inputs.protocol.predicted:
        part = inputs.data.parts[name]
        found.append(GuardData(inputs.predictions.scalars(model, name), part.targets, part.groups, part.clusters))
    return GuardPartitions(*found)


def _limits(inputs: ResultInputs, tolerance_m: float) -> Limits:
    guard = inputs.protocol.guard
    return Limits(
        alpha=guard.alpha,
        delta=guard.delta,
        tolerance_m=tolerance_m,
        min_groups=int(guard.min_groups),
        min_clusters=int(guard.min_clusters),
        coverage=guard.coverage,
    )


def _profile(
    inputs: ResultInputs,
    partitions: GuardPartitions,
    limits: Limits,
    risk_fit: RiskFit,
    noise: OutcomeNoise | None,
    name: str,
) -> dict[str, Any]:
    protocol, guard = inputs.protocol, inputs.protocol.guard
    setting = Setting(
        profile_name=name,
        profile=protocol.preferences[name],
        scale=inputs.utility_scale,
        nominal=inputs.data.nominal,
        action_prior=action_prior(inputs, name),
        seed=inputs.seed,
        num_resamples=int(protocol.statistics.resamples),
        num_redraws=None if guard.redraws is None else int(guard.redraws),
        limits=limits,
    )
    found = assess(risk_fit, partitions, setting)
    return {
        "profile": name,
        "num_groups": int(found.kept.sum()),
        "num_left_out": {key: int(count) for key, count in found.num_left_out.items()},
        "global_margin": {
            "margin_m": found.margin.margin_m,
            "rank": found.margin.rank,
            "num_groups": found.margin.num_groups,
            "val": _report_record(found.margin_validation),
            "test": _report_record(found.margin_test),
        },
        "conformal": _calibration_record(found.conformal, found),
        "learn_then_test": _calibration_record(found.learn_then_test, found),
        "selections": [
            _selection_record(selection, chosen, found, inputs, noise) for selection, chosen in found.selections.items()
        ],
        "trade_off": {key: numbers(values.tolist()) for key, values in found.trade_off._asdict().items()},
        **_redraw_records(found.redraws, guard.redraws),
    }


def _redraw_records(found: Mapping[str, Redraws | None] | None, num_redraws: int | None) -> dict[str, Any]:
    """The member ``redraws`` of a profile; nothing where none are declared."""
    if found is None:
        return {}
    guards = {name: None if redraws is None else redraws._asdict() for name, redraws in found.items()}
    return {"redraws": {"num_redraws": num_redraws, **guards}}


def _report_record(found: MarginReport) -> dict[str, Any]:
    return {
        "covered_candidates": found.covered_candidates,
        "covered_groups": found.covered_groups,
        "acceptance": found.acceptance,
        "num_actions": found.num_actions,
        "vacuous": bool(found.vacuous),
        "value": number(found.value),
        "nominal_value": number(found.nominal_value),
        "action_prior_value": number(found.action_prior_value),
    }


def _calibration_record(found: Calibration, assessment: Assessment) -> dict[str, Any]:
    return {
        "method": found.method,
        "multiplier": number(float(assessment.trade_off.multipliers[found.place])),
        "place": int(found.place),
        "num_groups": found.num_groups,
        "num_clusters": found.num_clusters,
        "curve": numbers(found.curve.tolist()),
        "limit": found.limit,
        "refusal": found.refusal,
    }


def _selection_record(
    selection: str,
    chosen: NDArray[np.intp],
    found: Assessment,
    inputs: ResultInputs,
    noise: OutcomeNoise | None,
) -> dict[str, Any]:
    beyond = None
    if noise is not None:
        outcomes = inputs.reported.targets
        kept = type(outcomes)(outcomes.values[found.kept], outcomes.available[found.kept])
        differences = selected_differences(kept, chosen, noise, nominal=inputs.data.nominal)
        beyond = {
            "num_worse": differences.worse.sum(axis=0).tolist(),
            "num_better": differences.better.sum(axis=0).tolist(),
            "num_compared": differences.num_compared.tolist(),
            "standard_error": numbers(differences.standard_error.tolist()),
        }
    figures = {
        name: {
            "value": number(figure.value),
            "low": number(figure.low),
            "high": number(figure.high),
            "num_undefined": int(figure.num_undefined),
        }
        for name, figure in found.figures[selection].items()
    }
    return {
        "selection": selection,
        "num_actions": len(np.unique(chosen)),
        "figures": figures,
        "beyond_noise": beyond,
    }
