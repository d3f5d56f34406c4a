"""Rules of locks, checkpoints and test-set accesses, and of the results and tables that follow from them.

Source: paper, "Benchmark Protocol", "Experiments" and "Discussion, Limitations, and Intended Use";
spec/14-benchmark.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from branchdrive.benchmark.checkpoint import CheckpointFacts, checkpoint_facts, num_parameters
from branchdrive.benchmark.lock import (
    LockFacts,
    changed_checkpoints,
    checkpoint_mismatches,
    further_risks_of,
    lock_mismatches,
    ranking_lock_mismatches,
    risk_fit_of,
    unlocked_models,
)
from branchdrive.benchmark.prediction.data import groups_digest
from branchdrive.benchmark.prediction.description import describe, described_checkpoints
from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.prediction.rules import data_of, predictions_of
from branchdrive.benchmark.protocol.rules import protocol_of
from branchdrive.benchmark.ranking.context import Contexts, contexts_of
from branchdrive.benchmark.ranking.noise import noise_of
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.benchmark.view import (
    CHECKPOINTS,
    digest_of,
    layer_files,
    lock_of,
    lock_of_kind,
    other_kind,
    ranking_lock_of,
)
from branchdrive.benchmark.warning import warnings
from branchdrive.contract.comparison import TOLERANCE, document_mismatches
from branchdrive.contract.identity import claimed_files, content_identity, derived_content
from branchdrive.contract.layout import (
    BENCHMARK,
    BENCHMARK_LEDGER_FILE,
    LATENCY_FILE,
    LEDGER_FILE,
    LOCK_FILE,
    PROTOCOL_FILE,
    RANKING_LOCK_FILE,
    RESULTS_FILE,
    TABLES_FILE,
)
from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import document_check, place_in_table, text_agrees, text_mismatches
from branchdrive.layers.view import ReleaseView
from branchdrive.model.rules.inputs import FEATURES, NORMALISATION
from branchdrive.quality.ledger import BENCHMARK_ACCESSES, accesses, benchmark_mismatches
from branchdrive.quality.rules.split import SPLIT


@rule("BD-BMK-002")
def lock_is_of_this_release(view: ReleaseView) -> Iterator[Check]:
    """Protocol, identity, split, normalisation, features and candidates are those of the release."""
    if (other := other_kind(view, LOCK_FILE)) is not None:
        yield other
        return
    document, derived = lock_of(view), view.descriptor.derived_layers
    facts = LockFacts(
        digest_of(view, PROTOCOL_FILE),
        content_identity(derived_content(view.content, claimed_files(derived, view.files)), derived),
        view.document(SPLIT)["digest"],
        digest_of(view, NORMALISATION),
        digest_of(view, FEATURES),
        view.descriptor.action_bank.keys,
    )
    yield document_check(LOCK_FILE, len(facts), lock_mismatches(document, facts))


@rule("BD-BMK-003")
def lock_names_every_checkpoint(view: ReleaseView) -> Iterator[Check]:
    """One checkpoint for each declared model and seed, each in a file of its own."""
    document = lock_of(view)
    yield document_check(
        LOCK_FILE, len(document["checkpoints"]), checkpoint_mismatches(document, view.cached(protocol_of))
    )


@rule("BD-BMK-004")
def checkpoints_are_the_locked_ones(view: ReleaseView) -> Iterator[Check]:
    """Every locked checkpoint is there with the digest of the lock, and no other."""
    entries = lock_of(view)["checkpoints"]
    if not view.digests:
        raise PreconditionError("digests were not computed")
    found = layer_files(view)
    mismatches = [
        Mismatch(
            {"file": f"{BENCHMARK}/{entry['file']}"},
            f"sha256 {entry['sha256']}",
            f"sha256 {found[entry['file']]}" if entry["file"] in found else "no such file",
        )
        for entry in entries
        if found.get(entry["file"]) != entry["sha256"]
    ]
    stray = sorted(name for name in found.keys() - {entry["file"] for entry in entries} if name.startswith(CHECKPOINTS))
    mismatches += [Mismatch({"file": f"{BENCHMARK}/{n}"}, "a checkpoint that the lock names", "another") for n in stray]
    yield Check.of(len(entries) + len(stray), mismatches)


@rule("BD-BMK-005")
def locks_name_the_training_groups(view: ReleaseView) -> Iterator[Check]:
    """Every checkpoint was trained on the training groups of the frozen population, and on no other."""
    data, protocol, entries = view.cached(data_of), view.cached(protocol_of), lock_of(view)["checkpoints"]
    fit = data.parts.get(protocol.partitions.fit)
    expected = groups_digest(() if fit is None else fit.groups)
    name = "training_groups_digest"
    for i, entry in enumerate(entries):
        yield document_check(LOCK_FILE, 1, text_mismatches(f"/checkpoints/{i}/{name}", expected, entry[name]))


@rule("BD-BMK-006")
def checkpoints_say_what_the_lock_says(view: ReleaseView) -> Iterator[Check]:
    """Provenance in the header of a checkpoint: model, seed, configuration, split, normalisation, training groups."""
    lock, protocol = lock_of(view), view.cached(protocol_of)
    configurations = {model.id: model.config_digest for model in protocol.models}
    mismatches, examined = [], 0
    for entry in lock["checkpoints"]:
        path = f"{BENCHMARK}/{entry['file']}"
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
            mismatches.append(Mismatch({"file": path}, "a header with provenance", str(error)))
            continue
        mismatches += [
            Mismatch({"file": path}, f"{name} {wanted!r}", f"{name} {given!r}")
            for name, wanted, given in zip(CheckpointFacts._fields, expected, found, strict=True)
            if wanted != given
        ][:1]
    yield Check.of(examined, mismatches)


@rule("BD-BMK-011")
def accesses_are_under_the_locks(view: ReleaseView) -> Iterator[Check]:
    """Entries count up, predictions before selections, and those of each kind name the lock of the layer."""
    ledger = view.document(BENCHMARK_LEDGER_FILE)
    mismatches = benchmark_mismatches(
        ledger,
        lock_digest=digest_of(view, LOCK_FILE),
        ranking_lock_digest=digest_of(view, RANKING_LOCK_FILE) if RANKING_LOCK_FILE in view.files else None,
        has_results=RESULTS_FILE in view.files,
    )
    yield document_check(BENCHMARK_LEDGER_FILE, max(1, len(ledger["entries"])), mismatches)


@rule("BD-BMK-014")
def test_was_accessed_once_for_the_benchmark(view: ReleaseView) -> Iterator[Check]:
    """One access for predictions and one for selections, those on the ledger of the release among them."""
    ledgers = view.document(BENCHMARK_LEDGER_FILE), view.document(LEDGER_FILE)
    counts = {event: len(accesses(event, *ledgers)) for event in BENCHMARK_ACCESSES}
    mismatches = [
        Mismatch({"pointer": "/entries"}, f"one {event} here and in {LEDGER_FILE}", f"{count} of them")
        for event, count in counts.items()
        if count > 1
    ]
    yield document_check(BENCHMARK_LEDGER_FILE, len(counts), mismatches)


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
    lock, guard = ranking_lock_of(view), view.cached(protocol_of).guard
    try:
        risk_fit, further = risk_fit_of(lock), further_risks_of(lock)
    except DatasetError as error:
        yield document_check(RANKING_LOCK_FILE, 1, [Mismatch({"pointer": "/risk_fit"}, "a learned risk", str(error))])
        return
    fits = [] if risk_fit is None else [("/risk_fit", guard.tolerance_m, risk_fit)]
    fits += [(f"/further_risk_fits/{i}/risk_fit", key[1], fit) for i, (key, fit) in enumerate(further.items())]
    for pointer, wanted, fit in fits:
        at: Location = {"pointer": f"{pointer}/tolerance_m"}
        other = Mismatch(at, f"{wanted:g}, as the protocol has it", f"{fit.tolerance_m:g}")
        yield document_check(RANKING_LOCK_FILE, 1, [other] if fit.tolerance_m != wanted else [])
    for i, (model, tolerance_m) in enumerate(further):
        if (model, tolerance_m) not in guard.further:
            undeclared = Mismatch(
                {"pointer": f"/further_risk_fits/{i}"},
                "a guard that the protocol declares",
                f"{model}, {tolerance_m:g} m",
            )
            yield document_check(RANKING_LOCK_FILE, 1, [undeclared])


def seen_of(view: ReleaseView) -> Contexts | None:
    """What the declared baselines see; ``None`` where none is declared.

    Raises:
        PreconditionError: The model layer cannot be packed.
    """
    baselines = view.cached(protocol_of).baselines
    if not baselines:
        return None
    try:
        return contexts_of(view.frame, view.cached(data_of).groups, baselines)
    except DatasetError as error:
        raise PreconditionError(f"the model layer cannot be packed: {error}") from error


@rule("BD-BMK-012")
def results_recompute(view: ReleaseView) -> Iterator[Check]:
    """Metrics, tests, rankings, guards and warnings follow from predictions, the model layer and the locks."""
    if RESULTS_FILE not in view.files:
        return
    found, ranking = view.document(RESULTS_FILE), ranking_lock_of(view)
    try:
        risk_fit, further = risk_fit_of(ranking), further_risks_of(ranking)
    except DatasetError as error:
        raise PreconditionError(str(error)) from error
    noise = None if ranking is None or ranking["outcome_noise"] is None else noise_of(ranking["outcome_noise"])
    protocol, data, predictions = view.cached(protocol_of), view.cached(data_of), view.cached(predictions_of)
    contexts, notes = seen_of(view), _warnings(view)
    try:
        expected = results_document(
            protocol, data, predictions, risk_fit, noise, contexts=contexts, warnings=notes, further_risks=further,
            description=_description(view) if "description" in found else None,
        )  # fmt: skip
    except (DatasetError, ValueError) as error:
        none = Mismatch({"pointer": "/"}, "results that can be computed", f"none: {error}")
        yield document_check(RESULTS_FILE, 1, [none])
        return
    yield document_check(RESULTS_FILE, 1, document_mismatches(expected, found, tolerance=TOLERANCE))


def _description(view: ReleaseView) -> dict[str, Any]:
    """What is counted of population and locked models."""
    places = {model: f"{BENCHMARK}/{file}" for model, file in described_checkpoints(lock_of(view)).items()}
    there = {model: path for model, path in places.items() if path in view.contents}
    try:
        found = {model: num_parameters(view.contents[path], view.sizes[path]) for model, path in there.items()}
    except (ValueError, RecursionError) as error:
        raise PreconditionError(str(error)) from error
    return describe(view.frame("contexts"), view.cached(data_of), found)


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
    """`TABLES.md` is the one that the results and latencies give."""
    if TABLES_FILE not in view.files:
        return
    if RESULTS_FILE not in view.files:
        none = Mismatch({"pointer": "/"}, f"tables of `{RESULTS_FILE}`", "no such file")
        yield document_check(TABLES_FILE, 1, [none])
        return
    latency = view.document(LATENCY_FILE) if LATENCY_FILE in view.files else None
    try:
        text = render_tables(view.document(RESULTS_FILE), latency)
    except KeyError as error:
        raise PreconditionError(f"{RESULTS_FILE} has nothing for {error}, which the tables show") from error
    yield text_agrees(view, TABLES_FILE, text)


@rule("BD-BMK-015")
def predictions_come_from_locked_checkpoints(view: ReleaseView) -> Iterator[Check]:
    """No model predicts whose checkpoint was not locked."""
    where = place_in_table(view, "predictions")
    yield Check.of(
        len(view.cached(predictions_of).models),
        [Mismatch({**where, "model": name}, "a locked checkpoint of every seed", "none") for name in _unlocked(view)],
    )
