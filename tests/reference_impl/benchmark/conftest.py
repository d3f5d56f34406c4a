"""A benchmarked release, once for all tests of this folder."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.content_cache import kept_folder
from tests.reference_impl.benchmark.small_release import invoke, make_release, protocol, write_protocol


@pytest.fixture(scope="session")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release without a benchmark; read-only by agreement."""
    return kept_folder("bare-release", make_release, tmp_path_factory.mktemp("bare") / "release")


@pytest.fixture(scope="session")
def small_protocol(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File of the small protocol."""
    return write_protocol(tmp_path_factory.mktemp("protocol") / "protocol.json", protocol())


@pytest.fixture(scope="session")
def done(bare: Path, small_protocol: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same release with its benchmark, by one command and without figures; read-only by agreement."""

    def benchmark(root: Path) -> None:
        shutil.copytree(bare, root)
        invoke("benchmark", root, "--protocol", small_protocol, "--no-figures")

    return kept_folder("benchmarked-release", benchmark, tmp_path_factory.mktemp("done") / "release")


@pytest.fixture(scope="session")
def exported(done: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the selector `selector.onnx` of that benchmark, and what the command said of it."""

    def export(folder: Path) -> None:
        folder.mkdir()
        said = invoke("export", done, "--output", folder / "selector.onnx")
        (folder / "said.txt").write_text(said)

    return kept_folder("exported-selector", export, tmp_path_factory.mktemp("exported") / "selector")


@pytest.fixture
def release(bare: Path, tmp_path: Path) -> Path:
    """A release without a benchmark of one's own."""
    return shutil.copytree(bare, tmp_path / "release")


@pytest.fixture
def benchmarked(done: Path, tmp_path: Path) -> Path:
    """A release with a benchmark of one's own."""
    return shutil.copytree(done, tmp_path / "benchmarked")
