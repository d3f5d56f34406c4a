"""A small raw layer to build from, a release that was built from it undisturbed, and audits without a classifier."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.audits import remember_audits
from tests.content_cache import kept_folder
from tests.synthetic import seal_dataset
from tests.synthetic_release import raw_descriptor, raw_tables
from tests.validator.engine.rules.draft import Draft
from tests.validator.release.running import SHARDS, build

from branchdrive.leakage.classifier import Unavailable
from branchdrive.release.audit_process import audit_here
from branchdrive.release.builder import STAGES


@pytest.fixture(scope="session")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of a dataset with a raw layer alone; read-only by agreement."""

    def write(root: Path) -> None:
        Draft(raw_tables(), raw_descriptor()).write(root)

    return kept_folder("raw-dataset", write, tmp_path_factory.mktemp("raw") / "dataset")


@pytest.fixture(scope="session", autouse=True)
def _no_classifier() -> Iterator[None]:
    """Recurrent tests are the subject of others, and slow."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("branchdrive.release.leakage.sequence_classifier", lambda: Unavailable("none in this test"))
        yield


@pytest.fixture(autouse=True)
def _remembered_audits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The raw layer is the same in nearly every build."""
    remember_audits(monkeypatch)


@pytest.fixture
def audit_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a test can look at it, and sooner."""
    monkeypatch.setattr("branchdrive.release.leakage.audit_in_own_process", audit_here)


@pytest.fixture(scope="session")
def built(raw: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of the release of `raw` with every layer in place, without an audit; read-only by agreement."""

    def write(root: Path) -> None:
        shutil.copytree(raw, root)
        build(root)

    return kept_folder("built-release", write, tmp_path_factory.mktemp("built") / "dataset")


@pytest.fixture(scope="session")
def audited(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of the same release with an audit; read-only by agreement."""

    def write(root: Path) -> None:
        shutil.copytree(built, root)
        build(root, stages=STAGES)

    return kept_folder("audited-release", write, tmp_path_factory.mktemp("audited") / "dataset")


@pytest.fixture
def dataset(raw: Path, tmp_path: Path) -> Path:
    """A copy of `raw` of one's own."""
    return shutil.copytree(raw, tmp_path / "dataset")


@pytest.fixture
def release(built: Path, tmp_path: Path) -> Path:
    """A copy of `built` of one's own."""
    return shutil.copytree(built, tmp_path / "release")


@pytest.fixture(scope="module")
def two_parts(raw: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release of the same raw layer whose last shard is the first of another part; read-only by agreement."""
    root = shutil.copytree(raw, tmp_path_factory.mktemp("parts") / "dataset")
    for old, new in reversed(SHARDS.items()):
        (root / old).rename(root / new)
    seal_dataset(root)
    build(root)
    return root


@pytest.fixture
def copied(two_parts: Path, tmp_path: Path) -> Path:
    """A copy of one's own."""
    return shutil.copytree(two_parts, tmp_path / "dataset")
