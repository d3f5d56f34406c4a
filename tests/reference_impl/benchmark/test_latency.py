"""Latencies are measured by a command of their own, published beside results that stay as they are, and judged."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.reference_impl.benchmark.small_release import contents, invoke, invoke_both, is_clean
from tests.sampling import sampled

from branchdrive import UsageError, validate
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.machine_trace import trace_mismatches
from branchdrive_reference.benchmark import latency

NAME, TABLES = "benchmark/latency.json", "benchmark/TABLES.md"


def statuses(root: Path, *rules: str) -> list[str]:
    found = {tally.rule_id: tally.status for tally in validate(root).tallies}
    return [found[rule] for rule in rules]


@pytest.mark.parametrize("is_exporting", sampled([False, True], every=2))
def test_every_model_is_timed_and_the_exported_ones_twice(
    benchmarked: Path, is_exporting: bool, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("onnxruntime")
    if not is_exporting:  # it takes seconds, and the command compares what it is given with torch
        selector = (request.getfixturevalue("exported") / "selector.onnx").read_bytes()
        monkeypatch.setattr(latency, "export_selector", lambda *_, **__: selector)
    before = contents(benchmarked)
    said, printed = invoke_both("latency", benchmarked, "--repeats", "2")
    assert printed == "".join(
        f"timing {model}, model {i + 1} of 4\n" for i, model in enumerate(("M0", "M1", "M2", "M3"))
    )
    after = contents(benchmarked)
    assert {path for path in after if before.get(path) != after[path]} == {NAME, TABLES, "MANIFEST.sha256"}
    assert is_clean(benchmarked)
    document = json.loads(after[NAME])
    assert schema_mismatches(document, "latency.schema.json") == []
    assert list(trace_mismatches(document)) == []
    assert [(found["model"], found["num_seeds"]) for found in document["models"]] == [
        ("M0", 1), ("M1", 2), ("M2", 2), ("M3", 2),
    ]  # fmt: skip
    assert [found["model"] for found in document["models"] if found["exported"] is not None] == ["M3"]
    assert {"python", "numpy", "torch", "onnxruntime"} == set(document["software"])
    for found in document["models"]:
        assert 0 < found["torch"]["median_ms"] <= found["torch"]["quantile_95_ms"]
    assert "## Latency" in after[TABLES].decode() and "not recomputed by a validator" in after[TABLES].decode()
    assert said.startswith("Latency\n") and "over 2 rankings" in said
    assert statuses(benchmarked, "BD-BMK-013", "BD-BMK-016", "BD-LYR-005") == ["pass"] * 3


def test_an_evaluation_keeps_them_and_another_lock_drops_them(
    benchmarked: Path, small_protocol: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(latency, "EXPORT", ("no_such_package",))
    invoke("latency", benchmarked, "--repeats", "1")
    measured = contents(benchmarked)
    assert all(found["exported"] is None for found in json.loads(measured[NAME])["models"])
    assert "onnxruntime" not in json.loads(measured[NAME])["software"]
    invoke("evaluate", benchmarked, "--no-figures")
    assert contents(benchmarked) == measured
    (tmp_path / "same.json").write_text(json.dumps({**json.loads(small_protocol.read_text()), "version": "9.0.0"}))
    invoke("benchmark", benchmarked, "--protocol", tmp_path / "same.json", "--no-guard", "--no-figures")
    after = contents(benchmarked)
    assert NAME not in after and b"## Latency" not in after[TABLES]


def test_an_export_that_fails_is_not_passed_over(benchmarked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise UsageError("trained under another split")

    monkeypatch.setattr(latency, "EXPORT", ())
    monkeypatch.setattr(latency, "export_selector", refuse)
    before = contents(benchmarked)
    with pytest.raises(UsageError, match="trained under another split"):
        invoke("latency", benchmarked, "--repeats", "1")
    assert contents(benchmarked) == before


def test_nothing_is_timed_before_models_are_published(release: Path) -> None:
    with pytest.raises(UsageError, match=r"has no locked models; run `branchdrive predict` first"):
        invoke("latency", release)
    assert is_clean(release)
