"""Steps one by one come to what one command comes to, go on after an interruption, and leave nothing behind."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from tests.reference_impl.benchmark.small_release import (
    contents,
    invoke,
    invoke_both,
    is_clean,
    protocol,
    smallest_protocol,
    write_protocol,
)
from tests.sampling import THOROUGH

from branchdrive import DatasetError, PlatformError, UsageError
from branchdrive.contract.document import dump_json, schema_mismatches
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive_reference.learning.training import EpochReport


def test_one_command_makes_a_whole_layer(bare: Path, done: Path) -> None:
    assert is_clean(done)
    assert read_descriptor(Folder(done)).layers == (*read_descriptor(Folder(bare)).layers, "benchmark")
    before, after = contents(bare), contents(done)
    changed = {path for path in before if before[path] != after[path]}
    assert changed == {"branchdrive.json", "MANIFEST.sha256"}
    for name in ("lock", "ranking_lock", "ledger", "results", "protocol"):
        schema = "lock" if name == "ranking_lock" else name
        assert not schema_mismatches(json.loads(after[f"benchmark/{name}.json"]), f"{schema}.schema.json")
    assert sum(path.endswith(".safetensors") for path in after) == 7
    results = json.loads(after["benchmark/results.json"])
    assert results["warnings"] == []
    assert [model["id"] for model in results["models"]] == ["M0", "M1", "M2", "M3"]
    further = json.loads(after["benchmark/ranking_lock.json"])["further_risk_fits"]
    assert [(fit["model"], fit["tolerance_m"], fit["risk_fit"]["tolerance_m"]) for fit in further] == [("M3", 0.5, 0.5)]
    assert [len(guard["profiles"]) for guard in (results["guard"], *results["further_guards"])] == [5, 5]
    assert results["noise"] is None  # a detached release has no raw layer


def test_single_steps_come_to_the_same_bytes(
    release: Path, done: Path, small_protocol: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a training was interrupted, which goes on."""
    said = invoke("train", release, "--protocol", small_protocol, "--models", "M0", "M1")
    assert "3 of 3 models and seeds trained in " in said
    with pytest.raises(UsageError, match=r"M2, seed 11 has no checkpoint; run `branchdrive train` first"):
        invoke("lock", release)
    interrupt_training(release, monkeypatch)
    waiting = [path for path in contents(release) if path.startswith(".staging/") and "seed" in path]
    assert sorted(Path(path).name for path in waiting) == [
        "M0-seed0.safetensors", "M1-seed11.safetensors", "M1-seed23.safetensors", "M2-seed11.training",
    ]  # fmt: skip
    assert "10 folds and the risk of the guard" in invoke("train", release)
    with pytest.raises(UsageError, match="nothing is locked"):
        invoke("predict", release)
    assert "7 checkpoints" in invoke("lock", release)
    invoke("predict", release)
    invoke("evaluate", release, "--no-figures")
    assert is_clean(release)
    assert contents(release) == contents(done)


def test_again_changes_nothing(benchmarked: Path) -> None:
    before = contents(benchmarked)
    said = invoke("benchmark", benchmarked, "--no-figures", "--format", "json")
    assert said.encode() == before["benchmark/results.json"]
    assert contents(benchmarked) == before


def test_what_a_population_lacks_is_said_before_training(
    release: Path, small_protocol: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained: list[int] = []
    monkeypatch.setattr(
        "branchdrive_reference.benchmark.step.train", lambda *arguments, **_: trained.append(len(arguments[2]))
    )
    said = invoke_both("train", release, "--protocol", small_protocol, "--models", "M0", "--no-guard")[1]
    assert "The release has 12 groups in 10 route clusters in `train`, 3 groups in " in said
    assert "Nothing can be concluded: `test` has 4 groups in 4 route clusters" in said
    assert "guard" not in said
    assert trained == [1]
    monkeypatch.setattr("branchdrive_reference.benchmark.guard.fold.NUM_FOLDS", 11)
    with pytest.raises(UsageError, match="10 route clusters in training are too few for the 11 folds of the guard"):
        invoke("train", release)
    assert trained == [1]  # nothing was trained before that


def test_trees_without_their_library_are_refused_before_anything_is_trained(
    release: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive_reference.benchmark.step.train", lambda *_, **__: pytest.fail("trained"))
    monkeypatch.setitem(sys.modules, "sklearn", None)
    monkeypatch.delitem(sys.modules, "sklearn.ensemble", raising=False)
    with pytest.raises(PlatformError, match="boosted trees"):
        invoke("train", release, "--protocol", "trees", "--no-guard")


def test_a_risk_without_its_library_is_refused_before_anything_is_evaluated(
    benchmarked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "branchdrive_reference.benchmark.evaluation.evaluate_published", lambda *_, **__: pytest.fail("evaluated")
    )
    monkeypatch.setitem(sys.modules, "sklearn", None)
    monkeypatch.delitem(sys.modules, "sklearn.ensemble", raising=False)
    with pytest.raises(PlatformError, match="the risk of a whole drive"):
        invoke("evaluate", benchmarked, "--no-figures", "--clean-risk")


def test_regret_by_type_is_printed_and_changes_no_file(benchmarked: Path) -> None:
    before = contents(benchmarked)
    with pytest.raises(UsageError, match="leave out `--predictions` and JSON"):
        invoke("evaluate", benchmarked, "--no-figures", "--by-type", "--format", "json")
    tables = invoke("evaluate", benchmarked, "--no-figures", "--by-type", "--format", "markdown")
    assert tables.startswith(before["benchmark/TABLES.md"].decode())
    assert tables.count("\n## Regret by scenario type, profile ") == 5
    assert "| all types | 4 | 4 |" in tables
    with pytest.raises(UsageError, match="does not tell how drives end; build it with `--endings`"):
        invoke("evaluate", benchmarked, "--no-figures", "--clean-risk")
    assert "Regret by scenario type, profile balanced\n" in invoke("evaluate", benchmarked, "--no-figures", "--by-type")
    assert contents(benchmarked) == before


def interrupt_training(release: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Train, and stop after the first epoch of M2."""

    def interrupt(report: EpochReport) -> None:
        if (report.model, report.epoch) == ("M2", 1):
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("branchdrive_reference.benchmark.training._watch", lambda tasks, show: interrupt)
        with pytest.raises(KeyboardInterrupt):
            invoke("train", release, "--no-guard")


@THOROUGH
def test_one_command_goes_on_from_an_interrupted_training(
    release: Path, done: Path, small_protocol: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    invoke("train", release, "--protocol", small_protocol, "--models", "M0", "--no-guard")
    interrupt_training(release, monkeypatch)
    invoke("benchmark", release, "--no-figures")
    assert contents(release) == contents(done)


def test_without_a_guard_the_results_say_so(release: Path, tmp_path: Path) -> None:
    protocol_file = write_protocol(tmp_path / "protocol.json", smallest_protocol())
    said = invoke("benchmark", release, "--protocol", protocol_file, "--no-guard", "--no-figures")
    assert " m\nNot judged: No risk was fitted." in said
    assert "Noise of outcomes\nUnknown; no ranking lock holds one" in said
    assert not (release / "benchmark" / "figures").exists()
    invoke("train", release)  # the folds alone, since the models are there
    invoke("evaluate", release, "--no-figures")
    entries = json.loads((release / "benchmark" / "ledger.json").read_bytes())["entries"]
    assert [entry["event"].split("_")[-1] for entry in entries] == ["predictions", "selections", "selections"]


def test_a_second_access_is_in_every_table(benchmarked: Path, tmp_path: Path) -> None:
    (tmp_path / "same.json").write_text(json.dumps({**protocol(), "version": "9.0.0"}))
    options = ("--no-guard", "--no-figures", "--format", "markdown")
    said = invoke("benchmark", benchmarked, "--protocol", tmp_path / "same.json", *options)
    num_tables, num_said = said.count("\n| ---"), said.count("was accessed 2 times for predictions")
    assert num_said == num_tables > 10
    assert is_clean(benchmarked)


def test_what_another_protocol_changes_is_trained_anew(benchmarked: Path, tmp_path: Path) -> None:
    before, document = contents(benchmarked / "benchmark"), protocol(learning_rate=1e-3)
    document["models"][2:] = protocol()["models"][2:]  # M0 has no training, and M1 another one than before
    document["profiles"][0] |= {"separation": 0.2, "displacement": 0.6, "comfort": 0.2}
    (tmp_path / "other.json").write_text(json.dumps(document))
    said = invoke("train", benchmarked, "--protocol", tmp_path / "other.json")
    assert "10 folds and the risk of the guard" in said and "; 2 trained again, because their configuration" in said
    invoke("benchmark", benchmarked, "--no-figures")
    after = contents(benchmarked / "benchmark")
    changed = {path for path in before if path.endswith("safetensors") and before[path] != after[path]}
    assert changed == {f"checkpoints/M1-seed{seed}.safetensors" for seed in (11, 23)}
    assert before["ranking_lock.json"] != after["ranking_lock.json"]
    assert json.loads(after["ranking_lock.json"])["risk_fit"] is not None
    assert is_clean(benchmarked)


def test_a_ranking_lock_of_another_form_is_named(benchmarked: Path) -> None:
    file = benchmarked / "benchmark" / "ranking_lock.json"
    document = json.loads(file.read_bytes())
    document["outcome_noise"] = {"tolerance": [0.1] * 6}
    file.write_bytes(dump_json(document))
    write_manifest(Folder(benchmarked), build_manifest(Folder(benchmarked)))
    with pytest.raises(DatasetError, match=r"'benchmark/ranking_lock.json' at /.*: expected .*; restore the file"):
        invoke("evaluate", benchmarked, "--no-figures")


def test_two_commands_do_not_work_at_once(release: Path, small_protocol: Path) -> None:
    from branchdrive.release.publish import lock_area

    with lock_area(release), pytest.raises(UsageError, match="a build or a benchmark is running there"):
        invoke("train", release, "--protocol", small_protocol)
    assert is_clean(release)
