"""Normative files are found in a checkout and in a wheel, and their absence is said."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from branchdrive.contract import resources
from branchdrive.contract.resources import SPEC_VERSION, load_resource, schema_dir
from branchdrive.errors import BranchDriveError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def package_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installation of the package elsewhere, empty."""
    package = tmp_path / "site" / "branchdrive"
    package.mkdir(parents=True)
    monkeypatch.setattr(resources, "_PACKAGE_DIR", package)
    schema_dir.cache_clear()
    yield package
    schema_dir.cache_clear()


def _make_schemas(folder: Path) -> Path:
    version = folder / f"v{SPEC_VERSION}"
    version.mkdir(parents=True)
    (version / "columns.json").write_text("{}", encoding="utf-8")
    return version


def test_folder_is_the_one_of_the_implemented_version() -> None:
    assert schema_dir().name == f"v{SPEC_VERSION}" == "v0.1"
    assert load_resource("columns.json") is load_resource("columns.json")


def test_wheel_carries_its_own_files(package_dir: Path) -> None:
    expected = _make_schemas(package_dir / "_schemas")
    assert schema_dir() == expected


def test_checkout_is_read_by_an_editable_install(package_dir: Path) -> None:
    expected = _make_schemas(package_dir.parents[1] / "schemas")
    assert schema_dir() == expected


def test_missing_files_are_an_error_that_says_what_to_do(package_dir: Path) -> None:
    with pytest.raises(BranchDriveError, match="reinstall `branchdrive`"):
        schema_dir()
