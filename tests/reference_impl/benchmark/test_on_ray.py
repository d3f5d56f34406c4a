"""Training on Ray, in a folder full of hostile module names: the weights of one process, and nothing there runs."""

from __future__ import annotations

from pathlib import Path

from tests.engines import needs_ray
from tests.hostile_folder import infest, marks, run_command
from tests.reference_impl.benchmark.small_release import contents, smallest_protocol, write_protocol


@needs_ray
def test_models_have_the_weights_of_one_process_and_nothing_of_a_folder_runs(
    release: Path, done: Path, tmp_path: Path
) -> None:
    protocol = write_protocol(tmp_path / "protocol.json", smallest_protocol())
    infest(tmp_path, tmp_path / "marks")
    options = ("--protocol", protocol, "--no-guard", "--jobs", 2, "--executor", "ray")
    trained = run_command("branchdrive", "train", release.name, *options, cwd=tmp_path, path="")
    assert trained.returncode == 0, trained.stderr
    published = run_command("branchdrive", "benchmark", release.name, *options, "--no-figures", cwd=tmp_path, path="")
    assert published.returncode == 0, published.stderr
    weights = {path: content for path, content in contents(release).items() if path.endswith(".safetensors")}
    assert {Path(path).stem for path in weights} == {"M0-seed0", "M3-seed11"}
    assert weights.items() <= contents(done).items()
    assert marks(tmp_path / "marks") == []
