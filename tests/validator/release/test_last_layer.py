"""A benchmark stays while its release is the same, and goes with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import build, contents

from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import BENCHMARK_LEDGER_FILE, CARD_FILE, RESULTS_FILE
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import check_against_manifest
from branchdrive.release.publish import benchmark_area, lock_area, publish_layer

FILES = {"benchmark/TABLES.md": b"tables\n", "benchmark/figures/one.svg": b"<svg/>\n"}


def test_a_layer_is_added_replaced_and_dropped(release: Path) -> None:
    before = contents(release)
    identity = check_against_manifest(Folder(release)).identity
    with lock_area(release):
        publish_layer(Folder(release), "benchmark", FILES)
    assert check_against_manifest(Folder(release)).identity == identity
    assert read_descriptor(Folder(release)).layers[-1] == "benchmark"
    with lock_area(release):
        publish_layer(Folder(release), "benchmark", {"benchmark/TABLES.md": b"others\n"})
    assert sorted(path for path in contents(release) if path.startswith("benchmark/")) == ["benchmark/TABLES.md"]
    with lock_area(release):
        publish_layer(Folder(release), "benchmark", {})
    with lock_area(release):
        pass  # what publication left goes
    assert contents(release) == before


def test_the_card_tells_what_selections_do_while_a_benchmark_says_so(release: Path) -> None:
    before = (release / CARD_FILE).read_text()
    rate = {"value": 0.25, "low": 0.1, "high": 0.5}
    oracle = {"selector": "oracle", "outcomes": {"targets": [], "contact": rate, "avoidable_contact": rate}}
    profile = {"profile": "balanced", "num_ranked": 8, "entries": [oracle]}
    results = {"warnings": [], "ranking": {"contact_m": 0.0, "profiles": [profile]}}
    with lock_area(release):
        publish_layer(Folder(release), "benchmark", {RESULTS_FILE: dump_json(results)})
    after = (release / CARD_FILE).read_text()
    assert "| oracle | 25.0% [10.0%, 50.0%] |" in after
    assert "although a candidate without one exists: the oracle in 25.0% of groups" in after
    check_against_manifest(Folder(release))
    with lock_area(release):
        publish_layer(Folder(release), "benchmark", {})
    assert (release / CARD_FILE).read_text() == before


def test_what_waits_stays_until_the_release_is_another(release: Path) -> None:
    area = benchmark_area(Folder(release))
    area.mkdir(parents=True)
    (area / "checkpoint").write_bytes(b"weights")
    build(release)
    assert (area / "checkpoint").read_bytes() == b"weights"
    with lock_area(release):
        assert area.is_dir()
    build(release, seed=SEED + 1)
    assert not area.parent.exists()


@pytest.fixture
def benchmarked(release: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A release with a benchmark layer that needs its protocol and ledger, and nothing else."""
    from branchdrive.release import built_layers as module
    from branchdrive.release import publish as other

    whole = module.LAYERS["benchmark"]
    documents = {name: whole.documents[name] for name in ("protocol.json", "ledger.json")}
    small = {**module.LAYERS, "benchmark": replace(whole, documents=documents, tables={})}
    monkeypatch.setattr(module, "LAYERS", small)
    monkeypatch.setattr(other, "LAYERS", small)
    with lock_area(release):
        protocol = {"benchmark/protocol.json": dump_json(default_protocol().document)}
        publish_layer(
            Folder(release), "benchmark", {**FILES, **protocol, BENCHMARK_LEDGER_FILE: dump_json({"entries": []})}
        )
    return release


def test_a_build_that_changes_nothing_keeps_it(benchmarked: Path) -> None:
    before = contents(benchmarked)
    build(benchmarked)
    assert contents(benchmarked) == before
    check_against_manifest(Folder(benchmarked))


def test_a_build_of_another_release_drops_it(benchmarked: Path) -> None:
    build(benchmarked, seed=SEED + 1)
    assert not (benchmarked / "benchmark").exists()
    assert "benchmark" not in read_descriptor(Folder(benchmarked)).layers
    check_against_manifest(Folder(benchmarked))


def test_a_benchmark_of_damaged_files_is_dropped(benchmarked: Path) -> None:
    (benchmarked / "benchmark" / "TABLES.md").write_bytes(b"others\n")
    build(benchmarked)
    assert not (benchmarked / "benchmark").exists()
    check_against_manifest(Folder(benchmarked))
