"""Locks: what they name, and what another protocol, release or checkpoint does to them."""

from __future__ import annotations

from typing import Any

import pytest
from tests.mismatch import pointers
from tests.validator.benchmark.samples import data, further_risks, noise, prediction_set, risk_fit, small_protocol

from branchdrive.benchmark.lock import (
    LockedCheckpoint,
    LockFacts,
    checkpoint_mismatches,
    further_risks_of,
    lock_digest,
    lock_document,
    lock_mismatches,
    ranking_lock_document,
    ranking_lock_mismatches,
    risk_fit_of,
)
from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.ranking.noise import RepeatLosses, noise_of
from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.errors import DatasetError

PROTOCOL = small_protocol()
FACTS = LockFacts(PROTOCOL.digest, "1" * 64, "2" * 64, "3" * 64, "4" * 64, data().candidates)
CHECKPOINTS = [
    LockedCheckpoint(model.id, seed, f"checkpoints/{model.id}-{seed}.safetensors", "5" * 64, "6" * 64)
    for model in PROTOCOL.models
    for seed in model.seeds
]


def lock() -> dict[str, Any]:
    return lock_document(PROTOCOL, FACTS, CHECKPOINTS[::-1], package="invented", version="1.0")


def ranking_lock() -> dict[str, Any]:
    return ranking_lock_document(
        prediction_lock_digest=lock_digest(lock()),
        predictions_digest=prediction_set().digest(data()),
        scale=utility_scale(PROTOCOL, data()),
        risk_fit=risk_fit(),
        noise=noise(),
    )


@pytest.mark.parametrize("document", [lock(), ranking_lock()], ids=["prediction", "ranking"])
def test_locks_conform_and_come_back_from_their_bytes(document: dict[str, Any]) -> None:
    assert schema_mismatches(document, "lock.schema.json") == []
    assert parse_json(dump_json(document)) == document


def test_order_of_checkpoints_decides_nothing() -> None:
    assert lock() == lock_document(PROTOCOL, FACTS, CHECKPOINTS, package="invented", version="1.0")
    assert not list(lock_mismatches(lock(), FACTS))
    assert not list(checkpoint_mismatches(lock(), PROTOCOL))


@pytest.mark.parametrize("name", LockFacts._fields)
def test_lock_of_another_release_or_protocol_is_found(name: str) -> None:
    changes: dict[str, Any] = {name: data().candidates[::-1] if name == "candidate_order" else "9" * 64}
    other = FACTS._replace(**changes)
    assert {pointer.split("/")[1] for pointer in pointers(lock_mismatches(lock(), other))} == {name}


def test_identity_that_is_not_known_is_not_compared() -> None:
    assert not list(lock_mismatches(lock(), FACTS._replace(release_identity=None)))
    with pytest.raises(DatasetError, match="identity of the release is unknown"):
        lock_document(PROTOCOL, FACTS._replace(release_identity=None), CHECKPOINTS, package="invented", version="1")


@pytest.mark.parametrize(
    ("checkpoints", "words"),
    [
        (CHECKPOINTS[1:], "one checkpoint of M0, seed 0, found 0 of them"),
        ([*CHECKPOINTS, CHECKPOINTS[0]], "one checkpoint of M0, seed 0, found 2 of them"),
        ([*CHECKPOINTS, CHECKPOINTS[0]._replace(seed=5)], "one checkpoint of M0, seed 5, found 1 of them"),
        ([CHECKPOINTS[0]._replace(file=CHECKPOINTS[1].file), *CHECKPOINTS[1:]], "a file for each checkpoint"),
    ],
)
def test_checkpoints_are_those_of_the_protocol(checkpoints: list[LockedCheckpoint], words: str) -> None:
    with pytest.raises(DatasetError, match=words):
        lock_document(PROTOCOL, FACTS, checkpoints, package="invented", version="1")


def test_ranking_lock_follows_from_predictions_and_training() -> None:
    facts: dict[str, Any] = {
        "prediction_lock_digest": lock_digest(lock()),
        "predictions_digest": prediction_set().digest(data()),
        "scale": utility_scale(PROTOCOL, data()),
    }
    assert not list(ranking_lock_mismatches(ranking_lock(), **facts))
    for name, wrong in (("prediction_lock_digest", "0" * 64), ("predictions_digest", "0" * 64)):
        assert pointers(ranking_lock_mismatches(ranking_lock(), **{**facts, name: wrong})) == [f"/{name}"]
    moved = facts["scale"]._replace(q95=facts["scale"].q95 + 1)
    assert len(list(ranking_lock_mismatches(ranking_lock(), **{**facts, "scale": moved}))) == 5


def test_learned_risk_comes_back_and_a_wrong_sign_is_refused() -> None:
    document = parse_json(dump_json(ranking_lock()))
    assert risk_fit_of(document) == risk_fit()
    document["risk_fit"]["logistic"][0] = 1.0
    with pytest.raises(DatasetError, match="risk would rise with separation"):
        risk_fit_of(document)
    assert risk_fit_of(None) is None
    assert risk_fit_of({"risk_fit": None}) is None


def test_risks_of_further_guards_come_back_each_once() -> None:
    risks = further_risks()
    document = ranking_lock_document(
        prediction_lock_digest="1" * 64,
        predictions_digest="2" * 64,
        scale=utility_scale(PROTOCOL, data()),
        risk_fit=risk_fit(),
        noise=noise()._replace(further_losses={0.5: RepeatLosses(24, 1, 48, 1)}),
        further_risks=risks,
    )
    assert schema_mismatches(document, "lock.schema.json") == []
    stored = parse_json(dump_json(document))
    assert further_risks_of(stored) == risks
    assert noise_of(stored["outcome_noise"]).further_losses == {0.5: RepeatLosses(24, 1, 48, 1)}
    assert further_risks_of(ranking_lock()) == further_risks_of(None) == {}
    stored["further_risk_fits"][1]["risk_fit"]["logistic"][0] = 1.0
    with pytest.raises(DatasetError, match=r"^/further_risk_fits/1/risk_fit: .*risk would rise with separation"):
        further_risks_of(stored)
    stored["further_risk_fits"] = [stored["further_risk_fits"][0]] * 2
    with pytest.raises(DatasetError, match=r"/further_risk_fits/1: another risk of M3 at 0\.5 m"):
        further_risks_of(stored)


@pytest.mark.parametrize(("tolerance", "conforms"), [(0.0, True), (-0.0, True), (None, True), (-1e-9, False)])
def test_no_tolerance_is_negative(tolerance: float | None, conforms: bool) -> None:
    document = ranking_lock()
    document["outcome_noise"]["tolerance"][1] = tolerance
    assert (schema_mismatches(document, "lock.schema.json") == []) is conforms
