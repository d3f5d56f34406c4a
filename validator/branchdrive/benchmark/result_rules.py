"""Benchmark rules on what follows: predictions, ranking lock, results and tables.

Source: paper IV to VI; spec/14-benchmark.md.
"""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.benchmark.lock import changed_checkpoints, ranking_lock_problems, risk_fit_of, unlocked_models
from branchdrive.benchmark.prediction_problem import PredictionProblem
from branchdrive.benchmark.prediction_rows import TABLES as PREDICTED
from branchdrive.benchmark.ranking_result import utility_scale
from branchdrive.benchmark.results import TOLERANCE, noise_of, results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.benchmark.view import (
    data_of,
    digest_of,
    layer_files,
    lock_of,
    lock_of_kind,
    other_kind,
    predictions_of,
    problems_of,
    protocol_of,
    ranking_lock_of,
)
from branchdrive.benchmark.warning import warnings
from branchdrive.contract.comparison import document_problems
from branchdrive.contract.layer import table_path
from branchdrive.contract.layout import (
    BENCHMARK_LEDGER_FILE,
    LEDGER_FILE,
    LOCK_FILE,
    RANKING_LOCK_FILE,
    RESULTS_FILE,
    TABLES_FILE,
)
from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import problems_found, text_agrees
from branchdrive.layers.view import ReleaseView

_SEED = "seed"


@rule("BD-BMK-007")
def predictions_are_complete(view: ReleaseView) -> Iterator[Check]:
    """Every model predicts whole banks of the partitions that it must, and nothing beside them."""
    problems = [problem for problem in view.once(problems_of) if problem.kind not in (_SEED, "number")]
    yield Check.of(sum(len(view.tables[name]) for name in PREDICTED), map(_sighting, problems))


@rule("BD-BMK-008")
def every_declared_seed_predicts(view: ReleaseView) -> Iterator[Check]:
    """A declared model has predictions of its declared seeds, and of no other."""
    problems = [problem for problem in view.once(problems_of) if problem.kind == _SEED]
    yield Check.of(len(view.once(protocol_of).models), map(_sighting, problems))


def _sighting(problem: PredictionProblem) -> Mismatch:
    place = {"file": table_path(problem.table), "table": problem.table, **problem.place}
    return Mismatch(place, problem.expected, problem.found)


@rule("BD-BMK-009")
def ranking_lock_follows(view: ReleaseView) -> Iterator[Check]:
    """The ranking lock names the prediction lock, the predictions, and the scale of utility of training."""
    if RANKING_LOCK_FILE not in view.files:
        return
    if (other := other_kind(view, RANKING_LOCK_FILE)) is not None:
        yield other
        return
    document, data = lock_of_kind(view, RANKING_LOCK_FILE), view.once(data_of)
    try:
        problems = ranking_lock_problems(
            document,
            prediction_lock_digest=digest_of(view, LOCK_FILE),
            predictions_digest=view.once(predictions_of).digest(data),
            scale=utility_scale(view.once(protocol_of), data),
        )
    except DatasetError as error:
        raise PreconditionError(str(error)) from error
    yield problems_found(RANKING_LOCK_FILE, 3, problems)


@rule("BD-BMK-010")
def learned_risk_is_sound(view: ReleaseView) -> Iterator[Check]:
    """Weights of the learned risk are in range, and none lets risk rise with predicted separation."""
    if (document := ranking_lock_of(view)) is None or document["risk_fit"] is None:
        return
    try:
        risk_fit = risk_fit_of(document)
    except DatasetError as error:
        yield problems_found(RANKING_LOCK_FILE, 1, [("/risk_fit", "a learned risk", str(error))])
        return
    expected = {"tolerance_m": view.once(protocol_of).guard.tolerance_m}
    yield problems_found(
        RANKING_LOCK_FILE,
        1,
        [
            (f"/risk_fit/{name}", f"{value:g}, as the protocol has it", f"{getattr(risk_fit, name):g}")
            for name, value in expected.items()
            if getattr(risk_fit, name) != value
        ],
    )


@rule("BD-BMK-012")
def results_recompute(view: ReleaseView) -> Iterator[Check]:
    """Metrics, tests, rankings, guards and warnings follow from predictions, the model layer and the locks."""
    if RESULTS_FILE not in view.files:
        return
    found, ranking = view.document(RESULTS_FILE), ranking_lock_of(view)
    try:
        risk_fit = risk_fit_of(ranking)
    except DatasetError as error:
        raise PreconditionError(str(error)) from error
    noise = None if ranking is None or ranking["outcome_noise"] is None else noise_of(ranking["outcome_noise"])
    protocol, data, predictions = view.once(protocol_of), view.once(data_of), view.once(predictions_of)
    try:
        expected = results_document(protocol, data, predictions, risk_fit, noise, warnings=_warnings(view))
    except (DatasetError, ValueError) as error:
        yield problems_found(RESULTS_FILE, 1, [("", "results that can be computed", f"none: {error}")])
        return
    yield problems_found(RESULTS_FILE, 1, document_problems(expected, found, tolerance=TOLERANCE))


def _unlocked(view: ReleaseView) -> list[str]:
    return unlocked_models(lock_of(view), view.once(predictions_of))


def _warnings(view: ReleaseView) -> list[str]:
    changed = changed_checkpoints(lock_of(view), layer_files(view)) if view.digests else ()
    has_calibration = view.once(protocol_of).partitions.calibrate in view.once(data_of).parts
    return warnings(
        view.document(BENCHMARK_LEDGER_FILE),
        unlocked=_unlocked(view),
        changed=changed,
        of_release=view.document(LEDGER_FILE),
        has_calibration=has_calibration,
    )


@rule("BD-BMK-013")
def tables_say_what_results_say(view: ReleaseView) -> Iterator[Check]:
    """`TABLES.md` is the one that the results give."""
    if TABLES_FILE not in view.files:
        return
    if RESULTS_FILE not in view.files:
        yield problems_found(TABLES_FILE, 1, [("", f"tables of `{RESULTS_FILE}`", "no such file")])
        return
    try:
        text = render_tables(view.document(RESULTS_FILE))
    except KeyError as error:
        raise PreconditionError(f"{RESULTS_FILE} has nothing for {error}, which the tables show") from error
    yield text_agrees(view, TABLES_FILE, text)


@rule("BD-BMK-015")
def predictions_come_from_locked_checkpoints(view: ReleaseView) -> Iterator[Check]:
    """No model predicts whose checkpoint was not locked."""
    file: Location = {"file": table_path("predictions"), "table": "predictions"}
    yield Check.of(
        len(view.once(predictions_of).models),
        [Mismatch({**file, "model": name}, "a locked checkpoint of every seed", "none") for name in _unlocked(view)],
    )
