"""The learned risk of a whole drive: how probable it is that a candidate's drive stays clean to its end.

A forest of randomised trees reads what a vehicle knows at the branch, and the candidate, and is fitted on the groups of
training whose drives were monitored to their end (table `endings`)::

    x = [summaries of the history under `sensor`, one of the candidates]      what is not available is -1000
    p = share of clean drives in the leaves of x, mean over trees

Its calibration on the reported groups comes first: the Brier score beside that of each candidate's share in training,
and what happened where it said so much. Then selectors choose the best estimated utility among the candidates with
``p >= CLEAN_FROM``, and among all where there is none, beside what they choose without it and beside `oracle_clean`.

These figures explore: they are printed, stand in no document and no lock, and nothing here is called safe.

Source: Geurts et al. 2006 (extremely randomised trees), Brier 1950; this project's choice otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.cell import number
from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.metric.ending import Endings
from branchdrive.benchmark.protocol.selection import CLEAN_ORACLE, ENSEMBLE, ORACLE, Prior
from branchdrive.benchmark.ranking.baseline import estimate
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.ending import SelectedEndings, selected_endings
from branchdrive.benchmark.ranking.measure import Selector, by_score, measures
from branchdrive.benchmark.ranking.ranking import population
from branchdrive.benchmark.ranking.selected_table import percents
from branchdrive.driving.utility import predicted_utility, utility
from branchdrive.errors import UsageError
from branchdrive.runtime.environment import extra
from branchdrive.statistics import rounding
from branchdrive.text.table import Column, Passage, Table

__all__ = [
    "CLEAN_FROM", "Calibration", "calibration", "clean_sections", "fit_clean", "judged_clean", "need_forest",
]  # fmt: skip

Array = NDArray[np.float64]

CLEAN_FROM = 0.9
"""Probability from which a drive is judged clean."""

_CONTRACT = "sensor"
_ABSENT = -1000.0
_TREES, _LEAST_ROWS, _SEED = 200, 3, 0
_BINS = 5
_CLEAN_FIRST = 2.0
"""More than utilities, which are at most 1, can differ."""

_MEANING = (
    "A drive is clean without a collision, a departure from the road and a red light or stop sign that was run, from "
    "its start to its end; after the window it goes on under the expert's policy. This is no closed loop, no record of "
    "the release holds it, and nothing here is called safe."
)


class Calibration(NamedTuple):
    """How probabilities of clean drives agree with what was recorded, over candidates whose end is known.

    Attributes:
        brier: Mean squared error of the probabilities.
        brier_of_shares: The same of each candidate's share of clean drives in training.
        said: Mean probability in bins of equal width ``[bins]``; NaN in an empty one.
        happened: Share of clean drives there.
        counts: Candidates there.
    """

    brier: float
    brier_of_shares: float
    said: Array
    happened: Array
    counts: NDArray[np.int64]


def need_forest() -> None:
    """Make sure that a risk can be learned.

    Raises:
        PlatformError: The extra is not installed.
    """
    with extra("trees", of="the risk of a whole drive"):
        import sklearn.ensemble  # noqa: F401


def fit_clean(known: Array, endings: Endings, asked: Array) -> Array:
    """Probability that the drive of each candidate is clean ``[asked, candidates]``.

    Args:
        known: Summaries of the groups of training ``[n, D]``, NaN where not available.
        endings: Of their candidates.
        asked: Summaries of the groups that are asked for ``[asked, D]``.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: All known drives of training end alike, or none is known.
    """
    need_forest()
    from sklearn.ensemble import ExtraTreesClassifier

    where, clean = endings.is_known.reshape(-1), endings.is_clean.reshape(-1)
    if len(set(clean[where].tolist())) < 2:
        raise UsageError("all known drives of training end alike, or none is known; a risk cannot be learned from them")
    model = ExtraTreesClassifier(_TREES, min_samples_leaf=_LEAST_ROWS, max_features=1 / 3, random_state=_SEED, n_jobs=1)
    num_candidates = endings.is_known.shape[1]
    model.fit(_rows(known, num_candidates)[where], clean[where])
    found = model.predict_proba(_rows(asked, num_candidates))[:, 1]
    return np.asarray(found, np.float64).reshape(len(asked), num_candidates)


def _rows(histories: Array, num_candidates: int) -> NDArray[np.float32]:
    """A row for each candidate of each group ``[groups * candidates, D + candidates]``."""
    filled = np.where(np.isfinite(histories), histories, _ABSENT)
    actions = np.tile(np.eye(num_candidates), (len(histories), 1))
    return np.concatenate([np.repeat(filled, num_candidates, axis=0), actions], axis=1).astype(np.float32)


def calibration(probabilities: Array, endings: Endings, shares: Array) -> Calibration:
    """How probabilities agree with what was recorded.

    Args:
        probabilities: ``[groups, candidates]``.
        endings: Of the same; at least one is known.
        shares: Share of clean drives of each candidate in training ``[candidates]``.
    """
    known, clean = endings.is_known, endings.is_clean.astype(np.float64)
    said, happened = probabilities[known], clean[known]
    place = np.minimum((said * _BINS).astype(np.int64), _BINS - 1)
    counts = np.bincount(place, minlength=_BINS)
    sums = (np.bincount(place, weights=values, minlength=_BINS) for values in (said, happened))
    mean_said, share = (np.divide(total, counts, out=np.full(_BINS, np.nan), where=counts > 0) for total in sums)
    constant = np.broadcast_to(shares, known.shape)[known]
    return Calibration(
        brier=float(((said - happened) ** 2).mean()),
        brier_of_shares=float(((constant - happened) ** 2).mean()),
        said=mean_said,
        happened=share,
        counts=counts,
    )


def judged_clean(scores: Array, probabilities: Array) -> Selector:
    """The best score among candidates that are judged clean, and among all in a group without one."""
    return by_score(scores + _CLEAN_FIRST * (probabilities >= CLEAN_FROM))


def clean_sections(inputs: ResultInputs, contexts: Contexts | None) -> list[Table | Passage]:
    """The calibration of the risk, and for each profile what selectors choose with it and without.

    Args:
        inputs: Of the results.
        contexts: What baselines see; histories under `sensor` and, for priors, scenario types.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: The release has no endings, or none of the reported groups is known; the protocol has no baseline
            that reads histories; or no risk can be learned.
    """
    fitted, reported = inputs.fitted, inputs.reported
    if fitted.endings is None or reported.endings is None:
        raise UsageError("the release does not tell how drives end; build it with `--endings`")
    if not reported.endings.is_known.any():
        raise UsageError("no drive of the reported groups was monitored to its end; there is nothing to hold a risk to")
    histories = None if contexts is None else contexts.histories.get(_CONTRACT)
    if contexts is None or histories is None:
        raise UsageError(f"the protocol has no baseline that reads histories under {_CONTRACT!r}; the risk needs them")
    known, asked = (histories[[contexts.row[group] for group in part.groups]] for part in (fitted, reported))
    probabilities = fit_clean(known, fitted.endings, asked)
    is_known = fitted.endings.is_known
    shares = fitted.endings.is_clean.sum(axis=0) / np.maximum(is_known.sum(axis=0), 1)
    return [
        _calibration_table(calibration(probabilities, reported.endings, shares)),
        *(
            _profile_section(inputs, contexts, profile, probabilities, reported.endings)
            for profile in inputs.protocol.preferences
        ),
    ]


def _calibration_table(found: Calibration) -> Table:
    rows = [
        [f"{low / _BINS:.1f} to {(low + 1) / _BINS:.1f}", str(count), *(number(rounding.number(v)) for v in shares)]
        for low, (count, *shares) in enumerate(zip(found.counts, found.said, found.happened, strict=True))
    ]
    columns = [Column.name("Probability"), Column("Candidates"), Column("Mean"), Column("Clean drives, share")]
    notes = [
        _MEANING,
        f"Brier score {number(found.brier)}, of each candidate's share in training {number(found.brier_of_shares)}; "
        "less is better. Candidates of one group are no independent samples.",
    ]
    return Table("Learned risk of a whole drive: calibration", columns, rows, notes)


def _profile_section(
    inputs: ResultInputs, contexts: Contexts, profile: str, probabilities: Array, endings: Endings
) -> Table | Passage:
    title = f"Choices among drives that are judged clean, profile {profile}"
    preference = inputs.protocol.preferences[profile]
    utilities = utility(inputs.reported.targets, inputs.utility_scale, preference)
    ranked = population(inputs.reported.targets, utilities).ranked
    if not ranked.any():
        return Passage(title, ["Not judged: no group can be ranked."])
    scores = {name: found[ranked] for name, found in _scores(inputs, contexts, profile).items()}
    selectors: dict[str, Selector] = {}
    for name, found in scores.items():
        selectors[name], selectors[f"{name}, judged clean"] = (
            by_score(found),
            judged_clean(found, probabilities[ranked]),
        )
    selectors[ORACLE] = by_score(utilities[ranked])
    selectors[f"{ORACLE}, judged clean"] = judged_clean(utilities[ranked], probabilities[ranked])
    selectors[CLEAN_ORACLE] = by_score(utilities[ranked] + _CLEAN_FIRST * endings.is_clean[ranked])
    nominal = inputs.data.nominal
    ends = selected_endings(
        endings, {name: one.shares for name, one in selectors.items()}, ranked, inputs.resampling,
        nominal=nominal, seed=inputs.seed,
    )  # fmt: skip
    regrets = {name: measures(one, utilities[ranked], nominal=nominal).regret for name, one in selectors.items()}
    rows = [_row(name, float(regrets[name].mean()), ends[name]) for name in selectors]
    columns = [Column.name("Selector"), *map(Column, ("Regret", "Clean", "Collision", "Off road", "Completed"))]
    share = float((probabilities[ranked] >= CLEAN_FROM).any(axis=1).mean())
    notes = [
        f"N = {int(ranked.sum())} groups, in {share:.1%} of which a candidate is judged clean, with a probability of "
        f"{CLEAN_FROM:g} or more. Intervals of 95 % resample route clusters.",
        _MEANING,
    ]
    return Table(title, columns, rows, notes, has_intervals=True)


def _scores(inputs: ResultInputs, contexts: Contexts, profile: str) -> Mapping[str, Array]:
    """Estimated utilities ``[groups, candidates]`` of priors of scenario types and of each model's mean over seeds."""
    scale, preference = inputs.utility_scale, inputs.protocol.preferences[profile]
    trained = utility(inputs.fitted.targets, scale, preference)
    groups: tuple[Sequence[str], Sequence[str]] = (inputs.fitted.groups, inputs.reported.groups)
    found = {
        one.name: estimate(one, contexts, groups[0], trained, groups[1])
        for one in inputs.protocol.baselines
        if isinstance(one, Prior) and one.by == ("scenario_type",)
    }
    report = inputs.protocol.partitions.report
    for model in inputs.judged:
        mean = inputs.predictions.scalars(model, report).mean(axis=0)
        found[ENSEMBLE + model] = predicted_utility(mean, scale, preference)
    return found


def _row(name: str, regret: float, ends: SelectedEndings) -> list[str]:
    rates = (ends.rates[end]._asdict() for end in ("clean", "collision", "off_road", "completed"))
    return [name, number(regret), *map(percents, rates)]
