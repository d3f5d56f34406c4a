"""A release that is built again is another one, and what its benchmark accessed stays on record."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from tests.content_cache import kept_folder
from tests.reference_impl.benchmark.small_release import contents, invoke, smallest_protocol, write_protocol
from tests.sampling import THOROUGH, sampled
from tests.synthetic_release import SEED, raw_descriptor, raw_tables
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import BENCHMARK_LEDGER_FILE, LEDGER_FILE
from branchdrive.engine.validate import validate
from branchdrive.formats.descriptor_file import read_descriptor, render_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.quality.ledger import BENCHMARK_ACCESSES
from branchdrive.quality.variants import Variant
from branchdrive.release.builder import STAGES, build_release
from branchdrive.release.stage import BuildOptions

OPTIONS = ("--no-guard", "--no-figures", "--format", "markdown")

COMPLETE = Variant("complete", "Every complete group", {"integrity_complete": True})


def build(root: Path, *variants: Variant, output: Path | None = None) -> None:
    stages = [stage for stage in STAGES if stage != "leakage"]
    build_release(root, output=output, stages=stages, options=BuildOptions(SEED, variants=variants))


def locks(root: Path, path: str) -> list[tuple[str, str]]:
    """Accesses for a benchmark in a ledger: event and lock."""
    entries: list[dict[str, Any]] = json.loads((root / path).read_bytes())["entries"]
    return [(entry["event"], entry["lock_digest"]) for entry in entries if entry["event"] in BENCHMARK_ACCESSES]


def findings(root: Path, verdict: str) -> set[str]:
    """Rules that find something in a release of this verdict."""
    report = validate(root)
    assert (report.verdict, report.errors) == (verdict, ())
    return {tally.rule_id for tally in report.tallies if tally.num_findings}


@pytest.fixture(scope="module")
def protocol(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File of a protocol."""
    return write_protocol(tmp_path_factory.mktemp("protocol") / "protocol.json", smallest_protocol())


@pytest.fixture(scope="module")
def evaluated(protocol: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release with its raw layer and a benchmark; read-only by agreement."""

    def evaluate(root: Path) -> None:
        Draft(raw_tables(), raw_descriptor()).write(root)
        build(root)
        invoke("benchmark", root, "--protocol", protocol, *OPTIONS)

    return kept_folder("evaluated-release", evaluate, tmp_path_factory.mktemp("evaluated") / "dataset")


@pytest.fixture(scope="module")
def rebuilt(evaluated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same dataset as another release, without a benchmark; read-only by agreement."""

    def rebuild(root: Path) -> None:
        shutil.copytree(evaluated, root)
        build(root, COMPLETE)

    return kept_folder("rebuilt-release", rebuild, tmp_path_factory.mktemp("rebuilt") / "dataset")


def test_accesses_move_to_the_ledger_and_to_the_card(evaluated: Path, rebuilt: Path) -> None:
    before = locks(evaluated, BENCHMARK_LEDGER_FILE)
    assert [event for event, _ in before] == list(BENCHMARK_ACCESSES) and locks(evaluated, LEDGER_FILE) == []
    assert not (rebuilt / "benchmark").exists()
    assert locks(rebuilt, LEDGER_FILE) == before
    assert (
        "earlier builds accessed the test partition 1 time for predictions and 1 time"
        in (rebuilt / "README.md").read_text()
    )
    assert findings(rebuilt, "valid") == findings(evaluated, "valid")


def test_the_same_build_again_changes_nothing(rebuilt: Path, tmp_path: Path) -> None:
    root = shutil.copytree(rebuilt, tmp_path / "dataset")
    build(root, COMPLETE)
    assert contents(root) == contents(rebuilt)


def test_the_next_benchmark_counts_them_in_every_table(
    rebuilt: Path, evaluated: Path, protocol: Path, tmp_path: Path
) -> None:
    root = shutil.copytree(rebuilt, tmp_path / "dataset")
    said = invoke("benchmark", root, "--protocol", protocol, *OPTIONS)
    for subject in ("predictions", "selections"):
        assert said.count(f"was accessed 2 times for {subject}") == said.count("\n| ---") > 10
    assert findings(root, "valid") == findings(evaluated, "valid") | {"BD-BMK-014"}


@THOROUGH
def test_every_further_release_counts_them_all(rebuilt: Path, evaluated: Path, protocol: Path, tmp_path: Path) -> None:
    root = shutil.copytree(rebuilt, tmp_path / "dataset")
    invoke("benchmark", root, "--protocol", protocol, *OPTIONS)
    build(root)  # as it was before, and yet another release than the first one
    assert locks(root, LEDGER_FILE) == [*locks(evaluated, BENCHMARK_LEDGER_FILE), *locks(root, LEDGER_FILE)[2:]]
    said = invoke("benchmark", root, "--protocol", protocol, *OPTIONS)
    assert "was accessed 3 times for predictions" in said and "was accessed 3 times for selections" in said

    ledger = json.loads((root / LEDGER_FILE).read_bytes())
    ledger["entries"] = ledger["entries"][:-4]
    (root / LEDGER_FILE).write_bytes(dump_json(ledger))
    write_manifest(Folder(root), build_manifest(Folder(root)))
    assert {"BD-BMK-002", "BD-BMK-012"} <= findings(root, "invalid")


def test_a_release_in_another_folder_takes_them_over(evaluated: Path, tmp_path: Path) -> None:
    build(evaluated, output=tmp_path / "other")
    assert locks(tmp_path / "other", LEDGER_FILE) == locks(evaluated, BENCHMARK_LEDGER_FILE)
    build(evaluated, COMPLETE, output=tmp_path / "other")
    assert locks(tmp_path / "other", LEDGER_FILE) == locks(evaluated, BENCHMARK_LEDGER_FILE)


def test_a_benchmark_that_lies_in_both_folders_is_counted_once(evaluated: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(evaluated, other, ignore=shutil.ignore_patterns("raw"))
    descriptor = read_descriptor(Folder(other))
    layers = [layer for layer in descriptor.layers if layer != "raw"]
    (other / "branchdrive.json").write_bytes(
        render_descriptor(descriptor.model_validate({**descriptor.model_dump(mode="json"), "layers": layers}))
    )
    write_manifest(Folder(other), build_manifest(Folder(other)))
    before = contents(other / "benchmark")
    build(evaluated, output=other)
    assert contents(other / "benchmark") == before
    assert locks(other, LEDGER_FILE) == []


@pytest.mark.parametrize(
    "damage", sampled(["benchmark/lock.json", "benchmark/TABLES.md", "canonical/source.json"], every=3)
)
def test_accesses_outlive_damaged_files(evaluated: Path, tmp_path: Path, damage: str) -> None:
    root = shutil.copytree(evaluated, tmp_path / "dataset")
    (root / damage).unlink()
    build(root)
    assert locks(root, LEDGER_FILE) == locks(evaluated, BENCHMARK_LEDGER_FILE)
    assert not (root / "benchmark").exists()
    build(root)
    assert locks(root, LEDGER_FILE) == locks(evaluated, BENCHMARK_LEDGER_FILE)
