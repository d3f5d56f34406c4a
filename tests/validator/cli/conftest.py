"""Datasets for the command line, and validation without worker processes where they are not the subject."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.audits import remember_audits
from tests.validator.engine import datasets


@pytest.fixture(scope="session")
def valid_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of the valid dataset; read-only by agreement."""
    return datasets.write(tmp_path_factory.mktemp("valid") / "dataset")


@pytest.fixture(scope="session")
def invalid_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of a dataset with a violation, and with attempts that do not qualify; read-only by agreement."""
    tables = datasets.DEPARTURES["speed out of range"].tables()
    controls = tables[datasets.FOLDER]["controls"]
    two_ticks_each = dict.fromkeys((r + more for r in range(30, len(controls), 201) for more in (0, 1)), 0.75)
    tables[datasets.FOLDER]["controls"] = datasets.with_cells(controls, "applied_brake", two_ticks_each)
    return datasets.write(tmp_path_factory.mktemp("invalid") / "dataset", tables)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Validate in this process, what was audited before not again."""
    remember_audits(monkeypatch)
