"""Benchmark rules: locks are of this release, predictions are complete, and results follow from them.

Source: paper IV to VI; spec/14-benchmark.md.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

from branchdrive.audit.check import ReleaseCheck, release_rule
from branchdrive.audit.finding import Sighting
from branchdrive.audit.release.compare import problems_found
from branchdrive.audit.release.view import NotAtHandError, ReleaseView
from branchdrive.audit.rules.model import FEATURES, NORMALISATION
from branchdrive.audit.rules.release import text_agrees
from branchdrive.audit.rules.split import SPLIT
from branchdrive.contract.layer import table_path
from branchdrive.dataset.layout import LEDGER_FILE
from branchdrive.dataset.manifest import derived_identity
from branchdrive.derive.benchmark.checkpoint import CheckpointFacts, checkpoint_facts
from branchdrive.derive.benchmark.data import TABLES, BenchmarkData, groups_digest
from branchdrive.derive.benchmark.lock import (
    LockFacts,
    changed_checkpoints,
    checkpoint_problems,
    lock_problems,
    ranking_lock_problems,
    risk_fit_of,
    unlocked_models,
)
from branchdrive.derive.benchmark.openings import EVENTS, num_openings, openings_problems, warnings
from branchdrive.derive.benchmark.prediction_problem import PredictionProblem, prediction_problems
from branchdrive.derive.benchmark.prediction_rows import TABLES as PREDICTED
from branchdrive.derive.benchmark.prediction_set import PredictionSet
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol, protocol_problem, read_protocol
from branchdrive.derive.benchmark.ranking_result import utility_scale
from branchdrive.derive.benchmark.results import TOLERANCE, noise_of, results_document
from branchdrive.derive.benchmark.tables import render_tables
from branchdrive.derive.layer.comparison import document_problems
from branchdrive.errors import DatasetError

FOLDER = "benchmark"
PROTOCOL, LOCK, RANKING_LOCK, OPENINGS, RESULTS = (
    f"{FOLDER}/{name}.json" for name in ("protocol", "lock", "ranking_lock", "openings", "results")
)
TABLES_FILE = f"{FOLDER}/TABLES.md"
_KINDS = {LOCK: "prediction", RANKING_LOCK: "ranking"}
CHECKPOINTS = "checkpoints/"
_SEED = "seed"


def _protocol(view: ReleaseView) -> BenchmarkProtocol:
    try:
        return read_protocol(view.document(PROTOCOL))
    except DatasetError as error:
        raise NotAtHandError(f"{PROTOCOL}: {error}") from error


def _data(view: ReleaseView) -> BenchmarkData:
    try:
        return BenchmarkData.of({name: view.frame(name) for name in TABLES}, view.descriptor.action_bank)
    except DatasetError as error:
        raise NotAtHandError(f"the model layer cannot be packed: {error}") from error


def _lock(view: ReleaseView) -> Mapping[str, Any]:
    return _of_kind(view, LOCK)


def _ranking_lock(view: ReleaseView) -> Mapping[str, Any] | None:
    """The ranking lock; ``None`` where the layer has none and claims nothing."""
    return _of_kind(view, RANKING_LOCK) if RANKING_LOCK in view.files else None


def _of_kind(view: ReleaseView, path: str) -> Mapping[str, Any]:
    if _other_kind(view, path) is not None:
        raise NotAtHandError(f"{path} is a lock of another kind")
    document: Mapping[str, Any] = view.document(path)
    return document


def _other_kind(view: ReleaseView, path: str) -> ReleaseCheck | None:
    """What is wrong with a lock of another kind than its place takes; ``None`` for the right one."""
    found = view.document(path)["kind"]
    return None if found == _KINDS[path] else problems_found(path, 1, [("/kind", _KINDS[path], found)])


def _digest(view: ReleaseView, path: str) -> str:
    """SHA-256 of a document's stored bytes."""
    view.document(path)
    return hashlib.sha256(view.contents[path]).hexdigest()


def _frames(view: ReleaseView) -> dict[str, Any]:
    return {name: view.frame(name) for name in PREDICTED}


def _problems(view: ReleaseView) -> list[PredictionProblem]:
    return prediction_problems(_frames(view), view.once(_data), view.once(_protocol))


def _predictions(view: ReleaseView) -> PredictionSet:
    try:
        return PredictionSet.from_frames(_frames(view), view.once(_data))
    except DatasetError as error:
        raise NotAtHandError(f"predictions are not complete: {error}") from error


def _files(view: ReleaseView) -> dict[str, str]:
    """Digests of the checkpoints that are there, by their name in the lock."""
    prefix = f"{FOLDER}/"
    return {path.removeprefix(prefix): d for path, d in view.digests.items() if path.startswith(prefix)}


@release_rule("BD-BMK-001")
def protocol_is_consistent(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Names differ, profiles are weighed to 1, and families and guard name what is declared."""
    problem = protocol_problem(view.document(PROTOCOL))
    yield problems_found(PROTOCOL, 1, [] if problem is None else [("", "a protocol without contradiction", problem)])


@release_rule("BD-BMK-002")
def lock_is_of_this_release(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Protocol, identity, split, normalisation, features and candidates are those of the release."""
    if (other := _other_kind(view, LOCK)) is not None:
        yield other
        return
    document = _lock(view)
    facts = LockFacts(
        _digest(view, PROTOCOL),
        derived_identity(view.digests) if view.digests else None,
        view.document(SPLIT)["digest"],
        _digest(view, NORMALISATION),
        _digest(view, FEATURES),
        view.descriptor.action_bank.keys,
    )
    yield problems_found(LOCK, len(facts), lock_problems(document, facts))


@release_rule("BD-BMK-003")
def lock_names_every_checkpoint(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """One checkpoint for each declared model and seed, each in a file of its own."""
    document = _lock(view)
    yield problems_found(LOCK, len(document["checkpoints"]), checkpoint_problems(document, view.once(_protocol)))


@release_rule("BD-BMK-004")
def checkpoints_are_the_locked_ones(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Every locked checkpoint is there with the digest of the lock, and no other."""
    entries = _lock(view)["checkpoints"]
    if not view.digests:
        raise NotAtHandError("digests are off")
    found = _files(view)
    sightings = [
        Sighting(
            f"sha256 {entry['sha256']}",
            f"sha256 {found[entry['file']]}" if entry["file"] in found else "no such file",
            {"file": f"{FOLDER}/{entry['file']}"},
        )
        for entry in entries
        if found.get(entry["file"]) != entry["sha256"]
    ]
    stray = sorted(name for name in found.keys() - {entry["file"] for entry in entries} if name.startswith(CHECKPOINTS))
    sightings += [Sighting("a checkpoint that the lock names", "another", {"file": f"{FOLDER}/{n}"}) for n in stray]
    yield ReleaseCheck.of(len(entries) + len(stray), sightings)


@release_rule("BD-BMK-005")
def locks_name_the_training_groups(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Every checkpoint was trained on the training groups of the frozen population, and on no other."""
    data, protocol, entries = view.once(_data), view.once(_protocol), _lock(view)["checkpoints"]
    fit = data.parts.get(protocol.partitions.fit)
    expected = groups_digest(() if fit is None else fit.groups)
    problems = [
        (f"/checkpoints/{i}/training_groups_digest", expected, entry["training_groups_digest"])
        for i, entry in enumerate(entries)
        if entry["training_groups_digest"] != expected
    ]
    yield problems_found(LOCK, len(entries), problems)


@release_rule("BD-BMK-006")
def checkpoints_say_what_the_lock_says(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Provenance in the header of a checkpoint: model, seed, configuration, split, normalisation, training groups."""
    lock, protocol = _lock(view), view.once(_protocol)
    configurations = {model.id: model.config_digest for model in protocol.models}
    sightings, examined = [], 0
    for entry in lock["checkpoints"]:
        path = f"{FOLDER}/{entry['file']}"
        if path not in view.contents:
            continue
        examined += 1
        expected = CheckpointFacts(
            entry["model"],
            int(entry["seed"]),
            lock["split_digest"],
            lock["normalisation_digest"],
            configurations.get(entry["model"], "no declared configuration"),
            entry["training_groups_digest"],
        )
        try:
            found = checkpoint_facts(view.contents[path], view.sizes[path])
        except (ValueError, RecursionError) as error:
            sightings.append(Sighting("a header with provenance", str(error), {"file": path}))
            continue
        sightings += [
            Sighting(f"{name} {wanted!r}", f"{name} {said!r}", {"file": path})
            for name, wanted, said in zip(CheckpointFacts._fields, expected, found, strict=True)
            if wanted != said
        ][:1]
    yield ReleaseCheck.of(examined, sightings)


@release_rule("BD-BMK-007")
def predictions_are_complete(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Every model predicts whole banks of the partitions that it must, and nothing beside them."""
    problems = [problem for problem in view.once(_problems) if problem.kind not in (_SEED, "number")]
    yield ReleaseCheck.of(sum(len(view.tables[name]) for name in PREDICTED), map(_sighting, problems))


@release_rule("BD-BMK-008")
def every_declared_seed_predicts(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """A declared model has predictions of its declared seeds, and of no other."""
    problems = [problem for problem in view.once(_problems) if problem.kind == _SEED]
    yield ReleaseCheck.of(len(view.once(_protocol).models), map(_sighting, problems))


def _sighting(problem: PredictionProblem) -> Sighting:
    place = {"file": table_path(problem.table), "table": problem.table, **problem.place}
    return Sighting(problem.expected, problem.found, place)


@release_rule("BD-BMK-009")
def ranking_lock_follows(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """The ranking lock names the prediction lock, the predictions, and the scale of utility of training."""
    if RANKING_LOCK not in view.files:
        return
    if (other := _other_kind(view, RANKING_LOCK)) is not None:
        yield other
        return
    document, data = _of_kind(view, RANKING_LOCK), view.once(_data)
    try:
        problems = ranking_lock_problems(
            document,
            prediction_lock_digest=_digest(view, LOCK),
            predictions_digest=view.once(_predictions).digest(data),
            scale=utility_scale(view.once(_protocol), data),
        )
    except DatasetError as error:
        raise NotAtHandError(str(error)) from error
    yield problems_found(RANKING_LOCK, 3, problems)


@release_rule("BD-BMK-010")
def learned_risk_is_sound(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Weights of the learned risk are in range, and none lets risk rise with predicted separation."""
    if (document := _ranking_lock(view)) is None or document["risk_fit"] is None:
        return
    try:
        risk_fit = risk_fit_of(document)
    except DatasetError as error:
        yield problems_found(RANKING_LOCK, 1, [("/risk_fit", "a learned risk", str(error))])
        return
    expected = {"tolerance_m": view.once(_protocol).guard.tolerance_m}
    yield problems_found(
        RANKING_LOCK,
        1,
        [
            (f"/risk_fit/{name}", f"{value:g}, as the protocol has it", f"{getattr(risk_fit, name):g}")
            for name, value in expected.items()
            if getattr(risk_fit, name) != value
        ],
    )


@release_rule("BD-BMK-011")
def openings_are_under_the_locks(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Openings count up, predictions before selections, the last of each kind under the lock of the layer."""
    document = view.document(OPENINGS)
    problems = openings_problems(
        document,
        lock_digest=_digest(view, LOCK),
        ranking_lock_digest=_digest(view, RANKING_LOCK) if RANKING_LOCK in view.files else None,
        has_results=RESULTS in view.files,
    )
    yield problems_found(OPENINGS, max(1, len(document["entries"])), problems)


@release_rule("BD-BMK-012")
def results_recompute(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Metrics, tests, rankings, guards and warnings follow from predictions, the model layer and the locks."""
    if RESULTS not in view.files:
        return
    found, ranking = view.document(RESULTS), _ranking_lock(view)
    try:
        risk_fit = risk_fit_of(ranking)
    except DatasetError as error:
        raise NotAtHandError(str(error)) from error
    noise = None if ranking is None or ranking["outcome_noise"] is None else noise_of(ranking["outcome_noise"])
    protocol, data, predictions = view.once(_protocol), view.once(_data), view.once(_predictions)
    try:
        expected = results_document(protocol, data, predictions, risk_fit, noise, warnings=_warnings(view))
    except (DatasetError, ValueError) as error:
        yield problems_found(RESULTS, 1, [("", "results that can be computed", f"none: {error}")])
        return
    yield problems_found(RESULTS, 1, document_problems(expected, found, tolerance=TOLERANCE))


def _unlocked(view: ReleaseView) -> list[str]:
    return unlocked_models(_lock(view), view.once(_predictions))


def _warnings(view: ReleaseView) -> list[str]:
    changed = changed_checkpoints(_lock(view), _files(view)) if view.digests else ()
    return warnings(
        view.document(OPENINGS), unlocked=_unlocked(view), changed=changed, ledger=view.document(LEDGER_FILE)
    )


@release_rule("BD-BMK-013")
def tables_say_what_results_say(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """`TABLES.md` is the one that the results give."""
    if TABLES_FILE not in view.files:
        return
    if RESULTS not in view.files:
        yield problems_found(TABLES_FILE, 1, [("", f"tables of `{RESULTS}`", "no such file")])
        return
    try:
        text = render_tables(view.document(RESULTS))
    except KeyError as error:
        raise NotAtHandError(f"{RESULTS} has nothing for {error}, which the tables show") from error
    yield text_agrees(view, TABLES_FILE, text)


@release_rule("BD-BMK-014")
def test_was_opened_once_for_the_benchmark(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """One opening for predictions and one for selections, those on the ledger of the release among them."""
    document, ledger = view.document(OPENINGS), view.document(LEDGER_FILE)
    counts = {event: num_openings(document, event, ledger) for event in EVENTS}
    problems = [
        ("/entries", f"one {event} here and in {LEDGER_FILE}", f"{count} of them")
        for event, count in counts.items()
        if count > 1
    ]
    yield problems_found(OPENINGS, len(counts), problems)


@release_rule("BD-BMK-015")
def predictions_come_from_locked_checkpoints(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """No model predicts whose checkpoint was not locked."""
    file: dict[str, str | int] = {"file": table_path("predictions"), "table": "predictions"}
    yield ReleaseCheck.of(
        len(view.once(_predictions).models),
        [Sighting("a locked checkpoint of every seed", "none", {**file, "model": name}) for name in _unlocked(view)],
    )
