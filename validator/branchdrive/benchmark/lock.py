"""Locks: digests of everything that is fixed before outcomes of the test partition are looked at.

The prediction lock names protocol, release, code and checkpoints. The ranking lock follows it and adds what
selections need: predictions, the scale of utility, the learned risk and the noise of outcomes, the last three from
training. A lock documents; it cannot prove that nobody looked before.

Source: paper, "Training and Test Locking" (locked evaluation); spec/14-benchmark.md#lock.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from pydantic import ValidationError

from branchdrive.benchmark.guard.risk import RiskFit, Risks
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.benchmark.ranking.noise import OutcomeNoise, noise_record
from branchdrive.benchmark.ranking.record import scale_record
from branchdrive.contract.comparison import TOLERANCE, document_mismatches
from branchdrive.contract.document import dump_json
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.driving.utility import WEIGHED, Scale
from branchdrive.errors import DatasetError

__all__ = [
    "LockFacts", "LockedCheckpoint", "changed_checkpoints", "checkpoint_mismatches", "further_risks_of",
    "lock_digest", "lock_document",
    "lock_mismatches", "ranking_lock_document", "ranking_lock_mismatches", "risk_fit_of", "scale_document",
    "unlocked_models",
]  # fmt: skip


class LockedCheckpoint(NamedTuple):
    """A checkpoint as it is locked.

    Attributes:
        model: Name of the model.
        seed: Seed of its training.
        file: Path in the layer's folder, as ``checkpoints/M3-seed11.safetensors``.
        sha256: Of the file, hexadecimal.
        training_groups_digest: Of the groups that it was trained on, see `data.groups_digest`.
    """

    model: str
    seed: int
    file: str
    sha256: str
    training_groups_digest: str


class LockFacts(NamedTuple):
    """What a prediction lock must say of a release.

    Attributes:
        protocol_digest: SHA-256 of the stored ``protocol.json``.
        release_identity: Identity of the release without its raw layer; ``None`` where it is not known.
        split_digest: As ``quality/split.json`` has it.
        normalisation_digest: SHA-256 of the stored ``model/normalisation.json``.
        features_digest: SHA-256 of the stored ``model/features.json``.
        candidate_order: Action keys in the order of the bank.
    """

    protocol_digest: str
    release_identity: str | None
    split_digest: str
    normalisation_digest: str
    features_digest: str
    candidate_order: Sequence[str]


def lock_document(
    protocol: BenchmarkProtocol,
    facts: LockFacts,
    checkpoints: Sequence[LockedCheckpoint],
    *,
    package: str,
    version: str,
) -> dict[str, Any]:
    """The document ``lock.json``.

    Args:
        protocol: What is compared, and how.
        facts: Of the release; the protocol's digest is taken from the protocol.
        checkpoints: Of every declared model and seed, in any order.
        package: Name of the software that trained.
        version: Its version.

    Raises:
        DatasetError: The identity is unknown, or checkpoints are not those of the declared models and seeds.
    """
    if facts.release_identity is None:
        raise DatasetError("the identity of the release is unknown; finish the release before it is locked")
    document = {
        "kind": "prediction",
        "protocol_digest": protocol.digest,
        "release_identity": facts.release_identity,
        "split_digest": facts.split_digest,
        "normalisation_digest": facts.normalisation_digest,
        "features_digest": facts.features_digest,
        "code": {"package": package, "version": version},
        "candidate_order": list(facts.candidate_order),
        "metric_definitions": protocol.metric_definitions,
        "checkpoints": [found._asdict() for found in sorted(checkpoints)],
    }
    for wrong in checkpoint_mismatches(document, protocol):
        raise DatasetError(f"checkpoints to lock: expected {wrong.expected}, found {wrong.found}")
    return document


def lock_digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical bytes of a lock, hexadecimal: those that a writer stores."""
    return hashlib.sha256(dump_json(document)).hexdigest()


def lock_mismatches(document: Mapping[str, Any], facts: LockFacts) -> Iterator[Mismatch]:
    """Where a prediction lock is not of this protocol and this release."""
    expected: dict[str, Any] = {**facts._asdict(), "candidate_order": list(facts.candidate_order)}
    if facts.release_identity is None:
        del expected["release_identity"]
    return document_mismatches(expected, {name: document[name] for name in expected})


def checkpoint_mismatches(document: Mapping[str, Any], protocol: BenchmarkProtocol) -> Iterator[Mismatch]:
    """Where the checkpoints of a lock are not one for each declared model and seed, under names of their own."""
    wanted = sorted((model.id, int(seed)) for model in protocol.models for seed in model.seeds)
    found = sorted((entry["model"], int(entry["seed"])) for entry in document["checkpoints"])
    files = [entry["file"] for entry in document["checkpoints"]]
    at: Location = {"pointer": "/checkpoints"}
    for model, seed in sorted({*wanted, *found}):
        count = found.count((model, seed))
        if count != wanted.count((model, seed)):
            yield Mismatch(at, f"one checkpoint of {model}, seed {seed}", f"{count} of them")
    if len(set(files)) < len(files):
        yield Mismatch(at, "a file for each checkpoint", "a file that two share")


def changed_checkpoints(document: Mapping[str, Any], digests: Mapping[str, str]) -> tuple[str, ...]:
    """Files of a prediction lock that are missing or not the locked ones.

    Args:
        document: The lock.
        digests: SHA-256 of the files that are there, by path in the layer's folder.
    """
    return tuple(entry["file"] for entry in document["checkpoints"] if digests.get(entry["file"]) != entry["sha256"])


def unlocked_models(document: Mapping[str, Any], predictions: PredictionSet) -> list[str]:
    """Models with predictions of a seed that has no locked checkpoint."""
    locked = {(entry["model"], int(entry["seed"])) for entry in document["checkpoints"]}
    return [model for model in predictions.models if not {(model, seed) for seed in predictions.seeds(model)} <= locked]


def ranking_lock_document(
    *,
    prediction_lock_digest: str,
    predictions_digest: str,
    scale: Scale,
    risk_fit: RiskFit | None,
    noise: OutcomeNoise | None,
    further_risks: Risks = MappingProxyType({}),
) -> dict[str, Any]:
    """The document ``ranking_lock.json``.

    Args:
        prediction_lock_digest: SHA-256 of the stored ``lock.json``.
        predictions_digest: Of all predictions, see `PredictionSet.digest`.
        scale: Of utility, from training.
        risk_fit: Learned risk, from out-of-fold predictions of training; None for a benchmark without a guard.
        noise: How far outcomes move between nominal replays of training groups; None where there are none.
        further_risks: Learned risks of further guards.
    """
    further = [
        {"model": model, "tolerance_m": tolerance_m, "risk_fit": fit.model_dump(mode="json")}
        for (model, tolerance_m), fit in further_risks.items()
    ]
    return {
        **({"further_risk_fits": further} if further else {}),
        "kind": "ranking",
        "prediction_lock_digest": prediction_lock_digest,
        "predictions_digest": predictions_digest,
        "utility_scale": scale_document(scale),
        "risk_fit": None if risk_fit is None else risk_fit.model_dump(mode="json"),
        "outcome_noise": None if noise is None else noise_record(noise),
    }


def scale_document(scale: Scale) -> dict[str, Any]:
    """The scale of utility as a ranking lock has it."""
    return {"targets": list(WEIGHED), **scale_record(scale)}


def ranking_lock_mismatches(
    document: Mapping[str, Any], *, prediction_lock_digest: str, predictions_digest: str, scale: Scale
) -> Iterator[Mismatch]:
    """Where a ranking lock does not follow from the prediction lock, the predictions and training."""
    expected = {
        "prediction_lock_digest": prediction_lock_digest,
        "predictions_digest": predictions_digest,
        "utility_scale": scale_document(scale),
    }
    return document_mismatches(expected, {name: document[name] for name in expected}, tolerance=TOLERANCE)


def risk_fit_of(document: Mapping[str, Any] | None) -> RiskFit | None:
    """The learned risk of a ranking lock; ``None`` where there is none.

    Raises:
        DatasetError: It is no risk: a number is out of range, or a weight has the wrong sign.
    """
    if document is None or document["risk_fit"] is None:
        return None
    return _fit_of(document["risk_fit"], "/risk_fit")


def further_risks_of(document: Mapping[str, Any] | None) -> dict[tuple[str, float], RiskFit]:
    """The learned risks of further guards in a ranking lock.

    Raises:
        DatasetError: One is no risk, or two are of the same model and tolerance.
    """
    found: dict[tuple[str, float], RiskFit] = {}
    for i, entry in enumerate(() if document is None else document.get("further_risk_fits", ())):
        guarded, at = (entry["model"], float(entry["tolerance_m"])), f"/further_risk_fits/{i}"
        if guarded in found:
            raise DatasetError(f"{at}: another risk of {guarded[0]} at {guarded[1]:g} m")
        found[guarded] = _fit_of(entry["risk_fit"], f"{at}/risk_fit")
    return found


def _fit_of(record: Any, at: str) -> RiskFit:
    try:
        return RiskFit.model_validate(record)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = "".join(f"/{part}" for part in first["loc"])
        raise DatasetError(f"{at}{place}: {first['msg']}") from error
