"""Training and benchmarking in a folder full of hostile module names: nothing there runs, and nothing changes."""

from __future__ import annotations

from pathlib import Path

from tests.hostile_folder import infest, marks, run_command
from tests.reference_impl.benchmark.small_release import contents


def test_train_and_benchmark_run_nothing_of_a_folder(
    release: Path, done: Path, small_protocol: Path, tmp_path: Path
) -> None:
    packages = infest(tmp_path, tmp_path / "marks")
    options = ("--no-guard", "--jobs", 2)
    trained = run_command(
        "branchdrive", "train", release.name, "--protocol", small_protocol, *options, cwd=tmp_path, path=""
    )
    assert (trained.returncode, trained.stderr) == (0, "")
    finished = run_command("branchdrive", "benchmark", release, *options, cwd=packages, path="")
    assert finished.returncode == 0, finished.stderr
    found, expected = (
        {path: content for path, content in contents(root).items() if path.endswith(".safetensors")}
        for root in (release, done)
    )
    assert found
    assert found == {path: expected[path] for path in found}
    assert marks(tmp_path / "marks") == []


def test_reading_commands_run_nothing_of_a_folder(benchmarked: Path, tmp_path: Path) -> None:
    packages = infest(tmp_path, tmp_path / "marks")
    for place in (tmp_path, packages):
        (place / "matplotlibrc").write_bytes(b"\xff\xfe: not text\n")
    ended = {
        command: run_command("branchdrive", command, benchmarked, *options, cwd=packages, path="")
        for command, *options in (
            ("evaluate", "--no-figures"),
            ("export", "--output", tmp_path / "selector.onnx"),
            ("lock",),
            ("predict",),
            ("study",),
            ("draw", "--output", tmp_path / "pictures"),
        )
    }
    assert {command: done.returncode for command, done in ended.items() if "Traceback" in done.stderr} == {}
    assert {command: done.returncode for command, done in ended.items()} == {
        "evaluate": 0, "export": 0, "lock": 0, "predict": 0,
        "study": 2, "draw": 2,  # a release without its raw layer has nothing to show
    }  # fmt: skip
    assert marks(tmp_path / "marks") == []
