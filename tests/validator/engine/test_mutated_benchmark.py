"""Documents of a benchmark with any small change: a finding or none, and never a failure of the validator."""

from __future__ import annotations

import copy
import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.validator.contract.mutation import mutated
from tests.validator.engine.rules.benchmark_release import (
    BENCHMARK_LEDGER,
    LOCK,
    PROTOCOL,
    RANKING_LOCK,
    RESULTS,
    BenchmarkDraft,
)
from tests.validator.engine.rules.case import judged_folder

from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import LEDGER_FILE
from branchdrive.engine.report import Report
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest

DOCUMENTS = (PROTOCOL, LOCK, RANKING_LOCK, BENCHMARK_LEDGER, RESULTS, LEDGER_FILE)
RULES = ("BD-LAY-002", "BD-LYR", "BD-BMK", "BD-FID-010", "BD-FID-012")


NUM_CHANGES = settings.default.max_examples // 8
"""Changes of every document; each takes a judgement."""


@cache
def originals() -> dict[str, Any]:
    """Documents of the release by path; not to be changed."""
    draft = BenchmarkDraft()
    return {path: draft.documents[path] for path in DOCUMENTS}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A valid release with a benchmark, whose documents are written again by every case."""
    return BenchmarkDraft().write(tmp_path_factory.mktemp("mutated") / "dataset")


def judged(root: Path, path: str, content: bytes) -> Report:
    """Report on the release with other bytes of a document, and a manifest that agrees with them."""
    before = (root / path).read_bytes()
    try:
        (root / path).write_bytes(content)
        write_manifest(Folder(root), build_manifest(Folder(root)))
        return judged_folder(root, select=RULES)
    finally:
        (root / path).write_bytes(before)


def changes(path: str) -> st.SearchStrategy[Any]:
    """A document of the release with one or two changes; most of them conform, so that rules are reached."""
    original = st.just(originals()[path])
    layer, name = path.split("/")
    schema = LAYERS[layer].documents[name].schema
    conforming = mutated(original).filter(lambda document: not schema_mismatches(document, schema))
    return st.one_of(conforming, conforming, conforming, mutated(original))


def test_the_release_is_sound(root: Path) -> None:
    report = judged(root, RESULTS, (root / RESULTS).read_bytes())
    assert report.errors == ()
    assert not [tally.rule_id for tally in report.tallies if tally.num_findings and tally.info.decides]


@pytest.mark.parametrize("path", DOCUMENTS)
@settings(max_examples=NUM_CHANGES, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@given(draw=st.data())
def test_a_document_with_a_small_change_is_judged(root: Path, path: str, draw: Any) -> None:
    report = judged(root, path, json.dumps(draw.draw(changes(path))).encode())
    assert report.errors == ()


@pytest.mark.parametrize(
    ("place", "key"),
    [
        (("population", "clusters"), "val"),
        (("models", 0), "id"),
        (("prediction", "estimates", 3), "model"),
        (("diagnostics", "shuffles", 3), "model"),
    ],
)
def test_results_that_lack_what_tables_show_are_not_rendered(root: Path, place: tuple[Any, ...], key: str) -> None:
    document = copy.deepcopy(originals()[RESULTS])
    part = document
    for step in place:
        part = part[step]
    name = part.pop(key)
    if key != "val":
        part[key] = f"Not{name}"
    report = judged(root, RESULTS, json.dumps(document).encode())
    tallies = {tally.rule_id: tally for tally in report.tallies}
    assert report.errors == ()
    assert "which the tables show" in str(tallies["BD-BMK-013"].reason)
    assert tallies["BD-BMK-012"].num_findings
