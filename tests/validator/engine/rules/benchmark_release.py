"""The synthetic release with a benchmark layer, and what follows of it computed again after an edit."""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tests.content_cache import kept, remembered
from tests.validator.benchmark.samples import GUARD, noise, paper_protocol, paths_of, risk_fit
from tests.validator.engine.rules.release import (
    BUILT,
    ENDINGS,
    LEAKAGE,
    SPLIT,
    STEPS,
    ReleaseDraft,
    built,
    release_draft,
)

from branchdrive.benchmark.checkpoint import CheckpointFacts
from branchdrive.benchmark.lock import LockedCheckpoint, LockFacts, lock_document, ranking_lock_document, risk_fit_of
from branchdrive.benchmark.prediction.data import TABLES, BenchmarkData, groups_digest
from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.prediction.metric.outcome import Predictions
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import TABLES as PREDICTED
from branchdrive.benchmark.prediction.rows import PredictionRows
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol, read_protocol
from branchdrive.benchmark.ranking.context import Contexts, contexts_of
from branchdrive.benchmark.ranking.noise import noise_of
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.contract.bank import ActionBank
from branchdrive.contract.identity import claimed_files, content_identity, derived_content, document_digest
from branchdrive.formats.table_file import parts_of
from branchdrive.quality.ledger import PREDICTION_ACCESS, SELECTION_ACCESS, with_benchmark_access
from branchdrive.tables.content import table_digest
from branchdrive.testing.drive import on_grid

FOLDER = "benchmark"
PROTOCOL, LOCK, RANKING_LOCK, BENCHMARK_LEDGER, RESULTS, LATENCY = (
    f"{FOLDER}/{name}.json" for name in ("protocol", "lock", "ranking_lock", "ledger", "results", "latency")
)
TABLES_FILE = f"{FOLDER}/TABLES.md"


SCALARS = "benchmark/predictions-00000.parquet"


class BenchmarkDraft(ReleaseDraft):
    """A release with a benchmark to edit.

    `checkpoints` are bytes by path in the layer's folder; `warnings` are what results and tables say.
    """

    def __init__(self) -> None:
        self.checkpoints: dict[str, bytes] = {}
        self.warnings: list[str] = []
        super().__init__(["raw", *BUILT, FOLDER])
        self.tables[FOLDER] = {}
        made = _made()
        for name in PREDICTED:
            self.put_first(name, made.frames[name])
        self.checkpoints = dict(made.checkpoints)
        self.documents.update(pickle.loads(pickle.dumps(made.documents)))
        self.texts[TABLES_FILE] = made.text
        self.before_seal(self._write_checkpoints)

    def put_first(self, table: str, frame: Any) -> None:
        """Add a table of the layer."""
        self.tables[FOLDER][table] = None
        self.put(table, frame)

    @property
    def protocol(self) -> BenchmarkProtocol:
        protocol: BenchmarkProtocol = remembered(read_protocol)(self.documents[PROTOCOL])
        return protocol

    @property
    def data(self) -> BenchmarkData:
        bank = ActionBank.model_validate(self.descriptor["action_bank"])
        tables = (*TABLES, *([ENDINGS] if ENDINGS in self.tables["model"] else []))
        return BenchmarkData.of({name: [self.frame(name)] for name in tables}, bank)

    @property
    def contexts(self) -> Contexts | None:
        declared = self.protocol.baselines
        return contexts_of(self.frame, self.data.groups, declared) if declared else None

    @property
    def predictions(self) -> PredictionSet:
        return PredictionSet.of_rows(PredictionRows({name: [self.frame(name)] for name in PREDICTED}, self.data))

    def follow(self, start: str, *, keep: Collection[str] = ()) -> None:
        """Compute again what follows, from the step `start` on, but for the steps in `keep`."""
        names = list(FOLLOWING)
        for name in names[names.index(start) :]:
            if name not in keep:
                FOLLOWING[name](self)

    def add_endings(self) -> None:
        """Add what was recorded of whole drives, and evaluate under a lock of the release that has it."""
        super().add_endings()
        self.documents[LOCK]["release_identity"] = identity(self)
        self.follow("lock")

    def add_latencies(self, **changes: Any) -> None:
        """Add latencies of the locked models, with the tables that show them; `changes` replace members."""
        timed = {"median_ms": 1.5, "quantile_95_ms": 1.5}
        self.documents[LATENCY] = {
            "prediction_lock_digest": self.digest(LOCK),
            "machine": {"processor": None, "architecture": "x86_64", "device": "cpu", "num_threads": 1},
            "software": {"python": "3.11.9", "torch": "2.5.1+cpu"},
            "num_candidates": len(self.data.candidates),
            "num_repeats": 500,
            "models": [
                {"model": model.id, "num_seeds": len(model.seeds), "torch": timed, "exported": None}
                for model in self.protocol.models
            ],
            **changes,
        }
        self.follow("tables")

    def _write_checkpoints(self, root: Path) -> None:
        for name, content in self.checkpoints.items():
            (root / FOLDER / name).parent.mkdir(exist_ok=True)
            (root / FOLDER / name).write_bytes(content)


def _lock(d: BenchmarkDraft) -> None:
    lock = d.documents[LOCK]
    lock["protocol_digest"] = d.digest(PROTOCOL)
    for entry in lock["checkpoints"]:
        entry["sha256"] = hashlib.sha256(d.checkpoints[entry["file"]]).hexdigest()


def _ranking(d: BenchmarkDraft) -> None:
    lock, scale = d.documents[RANKING_LOCK], utility_scale(d.protocol, d.data)
    lock["prediction_lock_digest"] = d.digest(LOCK)
    lock["predictions_digest"] = d.predictions.digest(d.data)
    lock["utility_scale"].update(q05=scale.q05.tolist(), q95=scale.q95.tolist())


def _accesses(d: BenchmarkDraft) -> None:
    ledger = with_benchmark_access(None, PREDICTION_ACCESS, d.digest(LOCK))
    d.documents[BENCHMARK_LEDGER] = with_benchmark_access(ledger, SELECTION_ACCESS, d.digest(RANKING_LOCK))


def _results(d: BenchmarkDraft) -> None:
    lock = d.documents[RANKING_LOCK]
    found = risk_fit_of(lock), noise_of(lock["outcome_noise"])
    d.documents[RESULTS] = remembered(results_document)(
        d.protocol, d.data, d.predictions, *found, contexts=d.contexts, warnings=d.warnings
    )


def _tables(d: BenchmarkDraft) -> None:
    d.texts[TABLES_FILE] = render_tables(d.documents[RESULTS], d.documents.get(LATENCY))
    STEPS["card"](d)


FOLLOWING: dict[str, Callable[[BenchmarkDraft], None]] = {
    "lock": _lock, "ranking": _ranking, "accesses": _accesses, "results": _results, "tables": _tables,
}  # fmt: skip
"""What follows from what."""


def checkpoint(facts: CheckpointFacts, payload: bytes = b"") -> bytes:
    """A safetensors file with one tensor of bytes."""
    about = json.dumps({"document": {"provenance": facts._asdict()}, "digest": hashlib.sha256(payload).hexdigest()})
    tensor = {"dtype": "U8", "shape": [len(payload)], "data_offsets": [0, len(payload)]}
    content = json.dumps({"__metadata__": {"branchdrive": about}, "weights": tensor}).encode()
    return len(content).to_bytes(8, "little") + content + payload


class _Made:
    """The layer, made once."""

    def __init__(self) -> None:
        self.draft = release_draft()
        bank = ActionBank.model_validate(self.draft.descriptor["action_bank"])
        self.data = BenchmarkData.of({name: [self.draft.frame(name)] for name in TABLES}, bank)
        self.protocol = _protocol()
        self.predictions = _predictions(self.protocol, self.data)
        self.frames = self.predictions.to_frames(self.data)
        normalisation, features = (self.draft.digest(f"model/{name}.json") for name in ("normalisation", "features"))
        split = self.draft.documents[SPLIT]["digest"]
        trained = groups_digest(self.data.part("train").groups)
        self.checkpoints = {
            f"checkpoints/{model.id}-seed{seed}.safetensors": checkpoint(
                CheckpointFacts(model.id, seed, split, normalisation, model.config_digest, trained)
            )
            for model in self.protocol.models
            for seed in model.seeds
        }
        self.documents: dict[str, Any] = {PROTOCOL: self.protocol.document}
        facts = LockFacts("", identity(self.draft), split, normalisation, features, bank.keys)
        locked = [
            LockedCheckpoint(
                model.id,
                seed,
                (file := f"checkpoints/{model.id}-seed{seed}.safetensors"),
                hashlib.sha256(self.checkpoints[file]).hexdigest(),
                trained,
            )
            for model in self.protocol.models
            for seed in model.seeds
        ]
        risk = risk_fit().model_copy(
            update={"grids": {name: risk_fit().grids[name] for name in self.protocol.preferences}}
        )
        lock = lock_document(self.protocol, facts, locked, package="invented", version="1.0.0")
        self.documents[LOCK] = lock
        d = self.draft
        d.documents.update(self.documents)
        ranking = ranking_lock_document(
            prediction_lock_digest=d.digest(LOCK),
            predictions_digest=self.predictions.digest(self.data),
            scale=utility_scale(self.protocol, self.data),
            risk_fit=risk,
            noise=noise(),
        )
        d.documents[RANKING_LOCK] = self.documents[RANKING_LOCK] = ranking
        _accesses(d)
        self.documents[BENCHMARK_LEDGER] = d.documents[BENCHMARK_LEDGER]
        results = results_document(self.protocol, self.data, self.predictions, risk, noise())
        self.documents[RESULTS] = results
        self.text = render_tables(results)


@cache
def _made() -> _Made:
    return kept(f"benchmark-{document_digest(built().documents[LEAKAGE])[:16]}", _Made)  # see `Maker`


def _protocol() -> BenchmarkProtocol:
    """The protocol of the paper with few draws, and without the parts that one may do without; cases add them."""
    document = paper_protocol()
    del document["outcomes"]
    near = {weights["name"] for weights in document["profiles"] if "near_m" in weights}
    document["profiles"] = [weights for weights in document["profiles"] if weights["name"] not in near]
    document["families"] = [f for f in document["families"] if near.isdisjoint(m.get("profile") for m in f["members"])]
    document["statistics"] = {"seed": 0, "resamples": 100, "level": 0.95, "flips": 100}
    document["shuffles"]["seeds"] = [0]
    document["guard"] = {name: document["guard"][name] for name in GUARD}
    return read_protocol(document)


def _predictions(protocol: BenchmarkProtocol, data: BenchmarkData) -> PredictionSet:
    by_model: dict[str, dict[int, dict[str, Predictions]]] = {}
    for place, model in enumerate(protocol.models):
        for seed in model.seeds:
            rng = np.random.default_rng([place, seed])
            for partition in ("val", "test"):
                truth = data.part(partition).outcomes.scalars
                values = on_grid(truth + rng.normal(scale=2.0 / (1 + place), size=truth.shape))
                predicted = Predictions.of(values, on_grid(paths_of(values)))
                by_model.setdefault(model.id, {}).setdefault(seed, {})[partition] = predicted
    return PredictionSet(by_model)


def identity(draft: ReleaseDraft) -> str | None:
    """Identity of the content of the derived layers."""
    tables = {name: table for layer in BUILT for name, table in draft.tables[layer].items()}
    files = {
        path: table_digest(name, rows) for name, table in tables.items() for path, rows in parts_of(name, table).items()
    }
    files |= {path: document_digest(document) for path, document in draft.documents.items()}
    return content_identity(derived_content(files, claimed_files(BUILT, files)), BUILT)


def first_of(d: BenchmarkDraft, partition: str) -> str:
    """The first group of a partition."""
    return d.data.part(partition).groups[0]
