"""Training and benchmarking in a folder full of hostile module names: nothing there runs, and nothing changes."""

from __future__ import annotations

from pathlib import Path

from tests.hostile_folder import infest, marks, run_command, run_commands
from tests.reference_impl.benchmark.small_release import contents, smallest_protocol, write_protocol
from tests.sampling import THOROUGH


def test_commands_run_nothing_of_a_folder(release: Path, done: Path, tmp_path: Path) -> None:
    """A model that is a mean and one that is learned, in two processes; then all other commands in another place."""
    protocol = write_protocol(tmp_path / "protocol.json", smallest_protocol())
    packages = infest(tmp_path, tmp_path / "marks")
    options = ("--protocol", protocol, "--no-guard", "--jobs", 2)
    trained = run_command("branchdrive", "train", release.name, *options, cwd=tmp_path, path="")
    assert trained.returncode == 0, trained.stderr
    assert [line.split(" ", 2)[0] for line in trained.stderr.splitlines()] == [
        "The",
        "Nothing",
    ]  # what it is too small for
    for place in (tmp_path, packages):
        (place / "matplotlibrc").write_bytes(b"\xff\xfe: not text\n")
    commands = (
        ("evaluate", release, "--no-figures"),  # nothing is published yet
        ("benchmark", release, "--no-guard"),
        ("lock", release),
        ("predict", release),
        ("study", release),
        ("draw", release, "--output", tmp_path / "pictures"),
    )
    codes, said = run_commands(*commands, cwd=packages)
    assert "Traceback" not in said
    assert codes == [2, 0, 0, 0, 2, 2], said  # a release without its raw layer has nothing to study or draw
    assert (release / "benchmark/figures/prediction.png").is_file()
    found, expected = (
        {path: content for path, content in contents(root).items() if path.endswith(".safetensors")}
        for root in (release, done)
    )
    assert {Path(path).stem for path in found} == {"M0-seed0", "M3-seed11"}
    assert found == {path: expected[path] for path in found}
    assert marks(tmp_path / "marks") == []


@THOROUGH
def test_an_export_runs_nothing_of_a_folder(benchmarked: Path, tmp_path: Path) -> None:
    packages = infest(tmp_path, tmp_path / "marks")
    codes, said = run_commands(("export", benchmarked, "--output", tmp_path / "selector.onnx"), cwd=packages)
    assert codes == [0], said
    assert marks(tmp_path / "marks") == []
