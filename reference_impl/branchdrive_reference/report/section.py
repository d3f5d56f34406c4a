"""The sections of a report below findings and funnel, as tables and paragraphs that every form shows.

The same values make the text, the Markdown and the page; none of them counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from branchdrive.benchmark.latency import latency_table
from branchdrive.benchmark.shortage import inconclusive_sentence
from branchdrive.benchmark.tables import result_sections
from branchdrive.cli.population import population_table, retention_table
from branchdrive.contract.layout import FILTERING_FILE, LATENCY_FILE, LEAKAGE_FILE, LEDGER_FILE, RESULTS_FILE
from branchdrive.contract.text import count_text, printable
from branchdrive.engine.report import POPULATION_BASIS
from branchdrive.engine.response_table import IN_DOUBT, response_doubt, response_table
from branchdrive.leakage.text import leakage_sentences
from branchdrive.quality.text import (
    PARTITION_TITLES,
    access_sentence,
    benchmark_sentences,
    calibration_sentences,
    filtering_sentences,
    population_sentences,
    target_sentences,
    threshold_text,
)
from branchdrive.text.table import Column, Passage, Table
from branchdrive_reference.report.facts import DatasetReport
from branchdrive_reference.study.text import study_sections

__all__ = ["Section", "sections"]

Part = Table | Passage


@dataclass(frozen=True)
class Section:
    """One topic.

    Attributes:
        name: What links lead to.
        title: One line.
        parts: Tables and paragraphs in order.
        warnings: Sentences that every table of the section is to be read with.
    """

    name: str
    title: str
    parts: tuple[Part, ...]
    warnings: tuple[str, ...] = ()


def sections(report: DatasetReport) -> list[Section]:
    """Every section that the dataset has something for, in order."""
    documents = report.documents
    found = [_response(report), _holdings(report)]
    if "quality/population.json" in documents:
        found.append(Section("population", "Population of the release", tuple(_population(documents))))
        found.append(Section("split", "Split", tuple(_split(documents))))
        found.append(Section("fidelity", "Replay fidelity", tuple(_fidelity(documents))))
        found.append(
            Section("leakage", "Action leakage", (Passage("", leakage_sentences(documents.get(LEAKAGE_FILE))),))
        )
    if RESULTS_FILE in documents:
        found.append(_benchmark(documents))
    return [section for section in found if section.parts]


def _response(report: DatasetReport) -> Section:
    response = report.validation.response
    parts: list[Part] = []
    if response is not None and response.actions:
        parts.append(response_table(response))
        if response.constant:
            listed = ", ".join(f"{name} {value:.4g}" for name, value in sorted(response.constant.items()))
            parts.append(Passage("", [f"The same in every observation: {listed}."]))
    doubt = response_doubt(report.validation).removeprefix(IN_DOUBT)
    return Section("response", "Action response", tuple(parts), (doubt,) if doubt else ())


def _holdings(report: DatasetReport) -> Section:
    if report.study is None:
        return Section("holdings", "What the dataset holds", (Passage("", [f"Not counted: {report.not_studied}."]),))
    return Section("holdings", "What the dataset holds", tuple(study_sections(report.study)))


def _population(documents: Mapping[str, Any]) -> Iterator[Part]:
    population = documents["quality/population.json"]
    yield population_table(population)
    yield Passage("", [*population_sentences(population), f"These numbers are {POPULATION_BASIS}."])
    if LEDGER_FILE in documents:
        ledger = documents[LEDGER_FILE]
        yield Passage("Test-set access", [access_sentence(ledger), *benchmark_sentences(ledger)])


def _split(documents: Mapping[str, Any]) -> Iterator[Part]:
    if "quality/split.json" not in documents:
        return
    split = documents["quality/split.json"]
    rows = [
        [PARTITION_TITLES[name], count_text(part["groups"]), count_text(part["clusters"])]
        for name in PARTITION_TITLES
        if (part := split["partitions"].get(name)) is not None
    ]
    notes = [
        f"Drawn with seed {split['seed']} by `{printable(str(split['algorithm']))}` before any threshold was fitted; "
        f"groups on the same route geometry form one of {split['num_clusters']:,} clusters and stay together.",
        *calibration_sentences(split),
        f"Digest of the assignment: {printable(str(split['digest']))}.",
    ]
    yield Table(
        "Groups and route clusters", [Column.name("Partition"), Column("Groups"), Column("Clusters")], rows, notes
    )


def _fidelity(documents: Mapping[str, Any]) -> Iterator[Part]:
    if "quality/retention.json" in documents:
        retention = documents["quality/retention.json"]
        yield retention_table(retention)
        if targets := target_sentences(retention):
            yield Passage("", [f"On the test partition {sentence}" for sentence in targets])
    if "quality/thresholds.json" in documents:
        thresholds = documents["quality/thresholds.json"]
        rows = [[v["name"], v["criterion"], threshold_text(v, thresholds)] for v in thresholds["variables"]]
        columns = [Column.name("Variable", is_code=True), Column("Criterion", is_text=True), Column("Threshold")]
        notes = [f"Fitted on {thresholds['num_groups']:,} structurally eligible training groups."]
        if FILTERING_FILE in documents:
            notes += filtering_sentences(documents[FILTERING_FILE])
        yield Table("Thresholds", columns, rows, notes)


def _benchmark(documents: Mapping[str, Any]) -> Section:
    results = documents[RESULTS_FILE]
    population = results["population"]
    warning = inconclusive_sentence(population["groups"], population["clusters"])
    timed = [latency_table(documents[LATENCY_FILE])] if LATENCY_FILE in documents else []
    parts: list[Part] = [*([Passage("", [warning])] if warning else []), *result_sections(results), *timed]
    return Section("benchmark", "Benchmark", tuple(parts), tuple(results["warnings"]))
