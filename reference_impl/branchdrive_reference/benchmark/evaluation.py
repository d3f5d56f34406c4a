"""Evaluation: test-set accesses on record first, then the results, then tables and figures, published as one.

The prediction lock is there before outcomes of the test partition are looked at. The ranking lock follows, and holds
nothing that is not from training or predictions. Predictions of others come from no locked checkpoint: their results
are printed with a warning and are not published.

Source: paper, "Training and Test Locking"; spec/14-benchmark.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from branchdrive.benchmark.checkpoint import num_parameters
from branchdrive.benchmark.guard.risk import Risks
from branchdrive.benchmark.lock import (
    changed_checkpoints,
    further_risks_of,
    lock_digest,
    ranking_lock_document,
    risk_fit_of,
    unlocked_models,
)
from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.description import describe, described_checkpoints
from branchdrive.benchmark.prediction.inputs import ResultInputs, utility_scale
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.benchmark.protocol.selection import MEAN
from branchdrive.benchmark.ranking.by_type import ACCELERATE, type_sections
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.noise import OutcomeNoise
from branchdrive.benchmark.ranking.noise import noise_of as stored_noise
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.benchmark.warning import warnings
from branchdrive.cli.progress import Update
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import (
    BENCHMARK,
    BENCHMARK_LEDGER_FILE,
    LATENCY_FILE,
    LEDGER_FILE,
    LOCK_FILE,
    RANKING_LOCK_FILE,
    RESULTS_FILE,
    TABLES_FILE,
)
from branchdrive.formats.table_file import read_layer_table
from branchdrive.quality.ledger import BENCHMARK_ACCESSES, Ledger, accesses, with_benchmark_access
from branchdrive.tables.arrow import from_arrow
from branchdrive.text.table import Passage, Table
from branchdrive_reference.benchmark.document import RISK, stored_document, waiting_risks
from branchdrive_reference.benchmark.foreign import mean_predictions
from branchdrive_reference.benchmark.lock import read_lock
from branchdrive_reference.benchmark.noise import noise_of
from branchdrive_reference.benchmark.release import Release, baseline_contexts, benchmark_data, published_predictions
from branchdrive_reference.benchmark.workspace import Workspace

__all__ = ["Evaluation", "evaluate_foreign", "evaluate_published", "render_files"]

UNRECORDED = "This evaluation looked at outcomes of the test partition, and no record of the release counts it."


@dataclass(frozen=True)
class Evaluation:
    """Results and what shows them.

    Attributes:
        results: Document ``results.json``.
        files: Results, tables and figures by path in the benchmark layer, such as ``figures/guard.png``.
        printed: Tables that stand in no file, as far as they were asked for.
    """

    results: dict[str, Any]
    files: dict[str, bytes]
    printed: Sequence[Table | Passage] = ()


def evaluate_published(
    workspace: Workspace,
    protocol: BenchmarkProtocol,
    *,
    show: Update,
    with_figures: bool = True,
    with_types: bool = False,
    with_clean_risk: bool = False,
) -> Evaluation:
    """Evaluate the published predictions, and publish results, tables and figures beside them.

    Args:
        workspace: The working area of the release.
        protocol: The one in force.
        show: Called with how far it is.
        with_figures: Whether figures are drawn.
        with_types: Whether regret is broken down by scenario type too.
        with_clean_risk: Whether the risk of a whole drive is learned and selected with.

    Raises:
        UsageError: Nothing is predicted.
        DatasetError: Predictions or locks cannot be read, or are not those of this release and protocol.
    """
    release = workspace.release
    data = benchmark_data(release)
    predictions = published_predictions(release, protocol, data)
    lock = read_lock(workspace, protocol)
    show(0, 4, "locks")
    ranking_lock = _ranking_lock(workspace, protocol, data, predictions, lock_digest(lock))
    files = release.benchmark_files()
    ledger: dict[str, Any] = stored_document(workspace, BENCHMARK_LEDGER_FILE) or {"entries": []}
    for event, document in zip(BENCHMARK_ACCESSES, (lock, ranking_lock), strict=True):
        ledger = with_benchmark_access(ledger, event, lock_digest(document))
    if files.get(BENCHMARK_LEDGER_FILE) != dump_json(ledger) or files.get(RANKING_LOCK_FILE) != dump_json(ranking_lock):
        # On the record before anything is looked at; results of another lock do not stay beside it.
        files = {path: content for path, content in files.items() if not _is_rendered(path)}
        files |= {BENCHMARK_LEDGER_FILE: dump_json(ledger), RANKING_LOCK_FILE: dump_json(ranking_lock)}
        workspace.publish(files)
    show(1, 4, "statistics")
    notes = _warnings(release, ledger, data, protocol, unlocked_models(lock, predictions), _changed(release, lock))
    risk, noise = risk_fit_of(ranking_lock), _stored_noise(ranking_lock)
    contexts = baseline_contexts(release, protocol, data)
    results = results_document(
        protocol, data, predictions, risk, noise, contexts=contexts, warnings=notes,
        further_risks=further_risks_of(ranking_lock), description=_description(release, data, lock),
    )  # fmt: skip
    show(2, 4, "figures")
    rendered = render_files(
        release, protocol, results, latency=release.document(LATENCY_FILE), with_figures=with_figures
    )
    show(3, 4, "publication")
    kept = {path: content for path, content in files.items() if not _is_rendered(path)}
    workspace.publish(kept | {f"{BENCHMARK}/{name}": content for name, content in rendered.items()})
    workspace.drop(RISK)  # the ranking lock holds it
    inputs = ResultInputs.of(protocol, data, predictions)
    printed = _by_type(release, inputs, contexts) if with_types else []
    if with_clean_risk:
        from branchdrive_reference.benchmark.clean_risk import clean_sections

        printed += clean_sections(inputs, contexts)
    show(4, 4)
    return Evaluation(results, rendered, printed)


def evaluate_foreign(
    release: Release,
    protocol: BenchmarkProtocol,
    found: PredictionSet,
    data: BenchmarkData,
    *,
    with_figures: bool = True,
) -> Evaluation:
    """Evaluate predictions of others; nothing is published, and no test-set access is recorded.

    Published predictions stand beside them where they were evaluated under this protocol before: no
    outcome is compared with them by the way. Else the mean of the training outcomes, M0, stands beside them.

    Raises:
        DatasetError: Published predictions cannot be read.
    """
    ledger: Any = release.document(BENCHMARK_LEDGER_FILE) or {"entries": []}
    lock, ranking_lock = release.document(LOCK_FILE), release.document(RANKING_LOCK_FILE)
    predictions, changed, risk, noise = found, tuple[str, ...](), None, None
    further: Risks = {}
    unevaluated = _unevaluated(ledger, protocol, lock, ranking_lock)
    if unevaluated is None:
        predictions = published_predictions(release, protocol, data).joined(found)
        changed, risk, noise = _changed(release, lock), risk_fit_of(ranking_lock), _stored_noise(ranking_lock)
        further = further_risks_of(ranking_lock)
    elif protocol.partitions.fit in data.parts:
        predictions = mean_predictions(data, protocol).joined(found)
    published = () if lock is None or unevaluated is not None else unlocked_models(lock, predictions)
    unlocked = sorted({*found.models, *published})
    notes = _warnings(release, ledger, data, protocol, unlocked, changed)
    notes += [UNRECORDED, *([unevaluated] if unevaluated is not None and lock is not None else ())]
    results = results_document(
        protocol, data, predictions, risk, noise, contexts=baseline_contexts(release, protocol, data), warnings=notes,
        further_risks=further, description=_description(release, data, lock if unevaluated is None else None),
    )  # fmt: skip
    return Evaluation(results, render_files(release, protocol, results, with_figures=with_figures))


def _by_type(release: Release, inputs: ResultInputs, contexts: Contexts | None) -> list[Table | Passage]:
    """Tables of regret by scenario type."""
    table = from_arrow(read_layer_table(release.layer.folder, "contexts"), "contexts")
    types = dict(zip(table["group_id"].tolist(), table["scenario_type"].tolist(), strict=True))
    policies = release.layer.descriptor.action_bank.policies
    accelerating = [place for place, policy in enumerate(policies) if policy.family == ACCELERATE]
    return type_sections(inputs, contexts, types, accelerating)


def _description(release: Release, data: BenchmarkData, lock: Any | None) -> dict[str, Any]:
    """What is counted of the population, and of the models that `lock` names; without one, of the mean."""
    contents = {
        model: release.content(f"{BENCHMARK}/{file}")
        for model, file in ({} if lock is None else described_checkpoints(lock)).items()
    }
    parameters = {model: num_parameters(content, len(content)) for model, content in contents.items()} or {MEAN: 0}
    return describe(from_arrow(read_layer_table(release.layer.folder, "contexts"), "contexts"), data, parameters)


def _warnings(
    release: Release,
    ledger: Ledger,
    data: BenchmarkData,
    protocol: BenchmarkProtocol,
    unlocked: Sequence[str],
    changed: Sequence[str],
) -> list[str]:
    """What every table warns of; see `branchdrive.benchmark.warning.warnings`."""
    return warnings(
        ledger,
        unlocked=unlocked,
        changed=changed,
        of_release=release.document(LEDGER_FILE),
        has_calibration=protocol.partitions.calibrate in data.parts,
    )


def _unevaluated(ledger: Ledger, protocol: BenchmarkProtocol, lock: Any | None, ranking_lock: Any | None) -> str | None:
    """Why the published predictions are left out; ``None`` where they were evaluated under this protocol."""
    if lock is not None and lock["protocol_digest"] != protocol.digest:
        return "The published models are left out: they are locked under another protocol."
    locks = zip(BENCHMARK_ACCESSES, (lock, ranking_lock), strict=True)
    if not all(found is not None and (lock_digest(found),) in accesses(event, ledger) for event, found in locks):
        return "The published models are left out: they have not been evaluated yet."
    return None


def render_files(
    release: Release,
    protocol: BenchmarkProtocol,
    results: dict[str, Any],
    *,
    latency: dict[str, Any] | None = None,
    with_figures: bool,
) -> dict[str, bytes]:
    """Results as files by path in the benchmark layer, with latencies in the tables; figures take the extra `plots`."""
    files = {"results.json": dump_json(results), "TABLES.md": render_tables(results, latency).encode()}
    if not with_figures:
        return files
    from branchdrive_reference.benchmark.figure.gallery import figures

    drawn = figures(
        results,
        alpha=protocol.guard.alpha,
        population=release.document("quality/population.json"),
        leakage=release.document("quality/leakage.json"),
    )
    return files | {f"figures/{name}": content for name, content in drawn.items()}


def _is_rendered(path: str) -> bool:
    return path in (RESULTS_FILE, TABLES_FILE) or path.startswith(f"{BENCHMARK}/figures/")


def _ranking_lock(
    workspace: Workspace, protocol: BenchmarkProtocol, data: BenchmarkData, predictions: PredictionSet, lock: str
) -> dict[str, Any]:
    """The ranking lock; risk and noise of the published one stay, unless a new risk waits."""
    published = workspace.release.document(RANKING_LOCK_FILE)
    if published is not None and published["prediction_lock_digest"] != lock:
        published = None
    guard, first = protocol.guard, risk_fit_of(published)
    risks: Risks = waiting_risks(workspace, protocol) or {
        **({} if first is None else {(guard.model, guard.tolerance_m): first}),
        **further_risks_of(published),
    }
    noise = _stored_noise(published) or noise_of(
        workspace.release, data, tolerance_m=guard.tolerance_m, further_m=guard.tolerances_m[1:]
    )
    return ranking_lock_document(
        prediction_lock_digest=lock,
        predictions_digest=predictions.digest(data),
        scale=utility_scale(protocol, data),
        risk_fit=risks.get((guard.model, guard.tolerance_m)),
        noise=noise,
        further_risks={guarded: risks[guarded] for guarded in guard.further if guarded in risks},
    )


def _stored_noise(ranking_lock: Any | None) -> OutcomeNoise | None:
    if ranking_lock is None or ranking_lock["outcome_noise"] is None:
        return None
    return stored_noise(ranking_lock["outcome_noise"])


def _changed(release: Release, lock: Any) -> tuple[str, ...]:
    prefix = f"{BENCHMARK}/"
    return changed_checkpoints(lock, {path.removeprefix(prefix): d for path, d in release.manifest.files.items()})
