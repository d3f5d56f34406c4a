"""Rules of predictions, and what they are and are judged on as rules see it: read once for a dataset."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from branchdrive.benchmark.prediction.check import prediction_mismatches
from branchdrive.benchmark.prediction.data import ENDINGS, TABLES, BenchmarkData
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import TABLES as PREDICTED
from branchdrive.benchmark.prediction.rows import PredictionRows
from branchdrive.benchmark.protocol.rules import protocol_of
from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import place_in_table
from branchdrive.layers.view import ReleaseView


def data_of(view: ReleaseView) -> BenchmarkData:
    """What the benchmark is judged on.

    Raises:
        PreconditionError: The model layer cannot be packed.
    """
    try:
        tables = (*TABLES, *([ENDINGS] if view.has(ENDINGS) else []))
        return BenchmarkData.of({name: [view.frame(name)] for name in tables}, view.descriptor.action_bank)
    except DatasetError as error:
        raise PreconditionError(f"the model layer cannot be packed: {error}") from error


def _rows(view: ReleaseView) -> PredictionRows:
    return PredictionRows({name: [view.frame(name)] for name in PREDICTED}, view.cached(data_of))


def mismatches_of(view: ReleaseView) -> list[Mismatch]:
    """What is wrong with predictions."""
    return list(prediction_mismatches(_rows(view), view.cached(protocol_of)))


def predictions_of(view: ReleaseView) -> PredictionSet:
    """The predictions.

    Raises:
        PreconditionError: They are not complete.
    """
    try:
        return PredictionSet.of_rows(_rows(view))
    except DatasetError as error:
        raise PreconditionError(f"predictions are not complete: {error}") from error


@rule("BD-BMK-007")
def predictions_are_complete(view: ReleaseView) -> Iterator[Check]:
    """Every model predicts whole banks of the partitions that it must, and nothing beside them."""
    found = [m for m in view.cached(mismatches_of) if not _is_of_seeds(m) and "column" not in m.location]
    yield Check.of(sum(len(view.tables[name]) for name in PREDICTED), map(partial(_in_table, view), found))


@rule("BD-BMK-008")
def every_declared_seed_predicts(view: ReleaseView) -> Iterator[Check]:
    """A declared model has predictions of its declared seeds, and of no other."""
    found = filter(_is_of_seeds, view.cached(mismatches_of))
    yield Check.of(len(view.cached(protocol_of).models), map(partial(_in_table, view), found))


def _is_of_seeds(mismatch: Mismatch) -> bool:
    return "model" in mismatch.location and "seed" not in mismatch.location


def _in_table(view: ReleaseView, mismatch: Mismatch) -> Mismatch:
    return mismatch.within(place_in_table(view, str(mismatch.location["table"])))
