"""Evaluation: openings on the record first, then the results, then tables and figures, published as one.

The prediction lock is there before outcomes of the test partition are looked at. The ranking lock follows, and holds
nothing that is not from training or predictions. Predictions of others come from no locked checkpoint: their results
are printed with a warning and are not published.

Source: paper IV-C; spec/14-benchmark.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from branchdrive.cli.progress import Update
from branchdrive.contract.document import dump_json
from branchdrive.dataset.layout import LEDGER_FILE
from branchdrive.derive.benchmark.data import BenchmarkData
from branchdrive.derive.benchmark.lock import lock_digest, ranking_lock_document, risk_fit_of
from branchdrive.derive.benchmark.openings import EVENTS, opened, warnings
from branchdrive.derive.benchmark.prediction_set import PredictionSet
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol
from branchdrive.derive.benchmark.ranking_result import utility_scale
from branchdrive.derive.benchmark.results import noise_of as stored_noise
from branchdrive.derive.benchmark.results import results_document
from branchdrive.derive.benchmark.tables import render_tables
from branchdrive.derive.guard.outcome_noise import OutcomeNoise
from branchdrive.derive.guard.risk_fit import RiskFit
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.document import published_document, stored_document
from branchdrive_reference.benchmark.lock import read_lock
from branchdrive_reference.benchmark.noise import noise_of
from branchdrive_reference.benchmark.published import benchmark_data, published_predictions
from branchdrive_reference.benchmark.release import LAYER, Release
from branchdrive_reference.benchmark.risk import RISK, waiting_risk
from branchdrive_reference.benchmark.workspace import LOCK, OPENINGS, RANKING_LOCK, RESULTS, Workspace

__all__ = ["Evaluation", "evaluate_foreign", "evaluate_published", "presented"]

TABLES = f"{LAYER}/TABLES.md"


@dataclass(frozen=True)
class Evaluation:
    """Results and what shows them.

    Attributes:
        results: Document ``results.json``.
        files: Results, tables and figures by path in the benchmark layer, such as ``figures/guard.png``.
    """

    results: dict[str, Any]
    files: dict[str, bytes]


def evaluate_published(
    workspace: Workspace, protocol: BenchmarkProtocol, *, show: Update, with_figures: bool = True
) -> Evaluation:
    """Evaluate the published predictions, and publish results, tables and figures beside them.

    Raises:
        UsageError: Nothing is predicted, or the extra for figures is not installed.
        DatasetError: Predictions or locks cannot be read, or are not those of this release and protocol.
    """
    release = workspace.release
    data = benchmark_data(release)
    predictions = published_predictions(release, protocol, data)
    lock = read_lock(workspace, protocol)
    show(0, 4, "locks")
    ranking_lock = _ranking_lock(workspace, protocol, data, predictions, lock_digest(lock))
    files = release.benchmark_files()
    openings: dict[str, Any] = stored_document(workspace, OPENINGS) or {"entries": []}
    for event, document in zip(EVENTS, (lock, ranking_lock), strict=True):
        openings = opened(openings, event, lock_digest(document))
    if files.get(OPENINGS) != dump_json(openings) or files.get(RANKING_LOCK) != dump_json(ranking_lock):
        # On the record before anything is looked at; results of another lock do not stay beside it.
        files = {path: content for path, content in files.items() if not _is_presented(path)}
        files |= {OPENINGS: dump_json(openings), RANKING_LOCK: dump_json(ranking_lock)}
        workspace.publish(files)
    show(1, 4, "statistics")
    said = warnings(openings, changed=_changed(release, lock), ledger=release.document(LEDGER_FILE))
    noise = None if ranking_lock["outcome_noise"] is None else stored_noise(ranking_lock["outcome_noise"])
    results = results_document(protocol, data, predictions, risk_fit_of(ranking_lock), noise, warnings=said)
    show(2, 4, "figures")
    shown = presented(release, protocol, results, with_figures=with_figures)
    show(3, 4, "publication")
    kept = {path: content for path, content in files.items() if not _is_presented(path)}
    workspace.publish(kept | {f"{LAYER}/{name}": content for name, content in shown.items()})
    workspace.drop(RISK)  # the ranking lock holds it
    workspace.reopened().tidy()
    show(4, 4)
    return Evaluation(results, shown)


def evaluate_foreign(
    release: Release,
    protocol: BenchmarkProtocol,
    found: PredictionSet,
    data: BenchmarkData,
    *,
    with_figures: bool = True,
) -> Evaluation:
    """Evaluate predictions of others beside the published ones; nothing is published.

    Raises:
        DatasetError: Published predictions cannot be read, or have a model of the same name.
    """
    risk, noise = None, None
    openings: Any = {"entries": []}
    predictions, changed = found, tuple[str, ...]()
    if release.has_benchmark:
        predictions = published_predictions(release, protocol, data).joined(found)
        openings = release.document(OPENINGS) or openings
        changed = _changed(release, release.document(LOCK))
        ranking_lock = published_document(release, RANKING_LOCK)
        risk = risk_fit_of(ranking_lock)
        if ranking_lock is not None and ranking_lock["outcome_noise"] is not None:
            noise = stored_noise(ranking_lock["outcome_noise"])
    said = warnings(openings, unlocked=found.models, changed=changed, ledger=release.document(LEDGER_FILE))
    results = results_document(protocol, data, predictions, risk, noise, warnings=said)
    return Evaluation(results, presented(release, protocol, results, with_figures=with_figures))


def presented(
    release: Release, protocol: BenchmarkProtocol, results: dict[str, Any], *, with_figures: bool
) -> dict[str, bytes]:
    """Results as files by path in the benchmark layer.

    Raises:
        UsageError: The extra for figures is not installed.
    """
    files = {"results.json": dump_json(results), "TABLES.md": render_tables(results).encode()}
    if not with_figures:
        return files
    try:
        from branchdrive_reference.benchmark.figure.gallery import figures
    except ModuleNotFoundError as error:
        raise UsageError(
            f"figures need the package {error.name!r}: pip install 'branchdrive[plots]', or use `--no-figures`"
        ) from error
    drawn = figures(
        results,
        alpha=protocol.guard.alpha,
        population=release.document("quality/population.json"),
        leakage=release.document("quality/leakage.json"),
    )
    return files | {f"figures/{name}": content for name, content in drawn.items()}


def _is_presented(path: str) -> bool:
    return path in (RESULTS, TABLES) or path.startswith(f"{LAYER}/figures/")


def _ranking_lock(
    workspace: Workspace, protocol: BenchmarkProtocol, data: BenchmarkData, predictions: PredictionSet, lock: str
) -> dict[str, Any]:
    """The ranking lock; risk and noise of the published one stay, unless a new risk waits."""
    published = published_document(workspace.release, RANKING_LOCK)
    if published is not None and published["prediction_lock_digest"] != lock:
        published = None
    risk: RiskFit | None = waiting_risk(workspace, protocol) or risk_fit_of(published)
    noise: OutcomeNoise | None = None
    if published is not None and published["outcome_noise"] is not None:
        noise = stored_noise(published["outcome_noise"])
    else:
        noise = noise_of(workspace.release, data, tolerance_m=protocol.guard.tolerance_m)
    return ranking_lock_document(
        prediction_lock_digest=lock,
        predictions_digest=predictions.digest(data),
        scale=utility_scale(protocol, data),
        risk_fit=risk,
        noise=noise,
    )


def _changed(release: Release, lock: Any) -> tuple[str, ...]:
    digests = release.manifest.files
    entries = lock["checkpoints"] if lock is not None else ()
    return tuple(e["file"] for e in entries if digests.get(f"{LAYER}/{e['file']}") != e["sha256"])
