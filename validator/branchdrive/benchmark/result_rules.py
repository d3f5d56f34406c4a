"""Benchmark rules on what follows: predictions, ranking lock, results and tables.

Source: paper IV to VI; spec/14-benchmark.md.
"""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.benchmark.lock import changed_checkpoints, ranking_lock_mismatches, risk_fit_of, unlocked_models
from branchdrive.benchmark.prediction_rows import TABLES as PREDICTED
from branchdrive.benchmark.ranking_result import utility_scale
from branchdrive.benchmark.results import noise_of, results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.benchmark.view import (
    data_of,
    digest_of,
    layer_files,
    lock_of,
    lock_of_kind,
    mismatches_of,
    other_kind,
    predictions_of,
    protocol_of,
    ranking_lock_of,
)
from branchdrive.benchmark.warning import warnings
from branchdrive.contract.comparison import TOLERANCE, document_mismatches
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
from branchdrive.layers.compare import document_check, text_agrees
from branchdrive.layers.view import ReleaseView


@rule("BD-BMK-007")
def predictions_are_complete(view: ReleaseView) -> Iterator[Check]:
    """Every model predicts whole banks of the partitions that it must, and nothing beside them."""
    found = [m for m in view.cached(mismatches_of) if not _is_of_seeds(m) and "column" not in m.location]
    yield Check.of(sum(len(view.tables[name]) for name in PREDICTED), map(_in_file, found))


@rule("BD-BMK-008")
def every_declared_seed_predicts(view: ReleaseView) -> Iterator[Check]:
    """A declared model has predictions of its declared seeds, and of no other."""
    found = filter(_is_of_seeds, view.cached(mismatches_of))
    yield Check.of(len(view.cached(protocol_of).models), map(_in_file, found))


def _is_of_seeds(mismatch: Mismatch) -> bool:
    return "model" in mismatch.location and "seed" not in mismatch.location


def _in_file(mismatch: Mismatch) -> Mismatch:
    return mismatch.within({"file": table_path(str(mismatch.location["table"]))})


@rule("BD-BMK-009")
def ranking_lock_follows(view: ReleaseView) -> Iterator[Check]:
    """The ranking lock names the prediction lock, the predictions, and the scale of utility of training."""
    if RANKING_LOCK_FILE not in view.files:
        return
    if (other := other_kind(view, RANKING_LOCK_FILE)) is not None:
        yield other
        return
    document, data = lock_of_kind(view, RANKING_LOCK_FILE), view.cached(data_of)
    try:
        mismatches = ranking_lock_mismatches(
            document,
            prediction_lock_digest=digest_of(view, LOCK_FILE),
            predictions_digest=view.cached(predictions_of).digest(data),
            scale=utility_scale(view.cached(protocol_of), data),
        )
    except DatasetError as error:
        raise PreconditionError(str(error)) from error
    yield document_check(RANKING_LOCK_FILE, 3, mismatches)


@rule("BD-BMK-010")
def learned_risk_is_sound(view: ReleaseView) -> Iterator[Check]:
    """Weights of the learned risk are in range, and none lets risk rise with predicted separation."""
    try:
        risk_fit = risk_fit_of(ranking_lock_of(view))
    except DatasetError as error:
        yield document_check(RANKING_LOCK_FILE, 1, [Mismatch({"pointer": "/risk_fit"}, "a learned risk", str(error))])
        return
    if risk_fit is None:
        return
    wanted, found = view.cached(protocol_of).guard.tolerance_m, risk_fit.tolerance_m
    at: Location = {"pointer": "/risk_fit/tolerance_m"}
    other = Mismatch(at, f"{wanted:g}, as the protocol has it", f"{found:g}")
    yield document_check(RANKING_LOCK_FILE, 1, [other] if found != wanted else [])


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
    protocol, data, predictions = view.cached(protocol_of), view.cached(data_of), view.cached(predictions_of)
    try:
        expected = results_document(protocol, data, predictions, risk_fit, noise, warnings=_warnings(view))
    except (DatasetError, ValueError) as error:
        none = Mismatch({"pointer": "/"}, "results that can be computed", f"none: {error}")
        yield document_check(RESULTS_FILE, 1, [none])
        return
    yield document_check(RESULTS_FILE, 1, document_mismatches(expected, found, tolerance=TOLERANCE))


def _unlocked(view: ReleaseView) -> list[str]:
    return unlocked_models(lock_of(view), view.cached(predictions_of))


def _warnings(view: ReleaseView) -> list[str]:
    changed = changed_checkpoints(lock_of(view), layer_files(view)) if view.digests else ()
    has_calibration = view.cached(protocol_of).partitions.calibrate in view.cached(data_of).parts
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
        none = Mismatch({"pointer": "/"}, f"tables of `{RESULTS_FILE}`", "no such file")
        yield document_check(TABLES_FILE, 1, [none])
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
        len(view.cached(predictions_of).models),
        [Mismatch({**file, "model": name}, "a locked checkpoint of every seed", "none") for name in _unlocked(view)],
    )
