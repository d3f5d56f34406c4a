"""Datasets and reports that several tests look at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.audits import remember_audits
from tests.reference_impl.report.browser import chromium
from tests.reference_impl.report.reading import Page, made
from tests.reference_impl.report.samples import damaged, written


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small valid dataset."""
    return written(tmp_path_factory.mktemp("report") / "d")


@pytest.fixture(scope="session")
def page(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Its report."""
    return made(dataset, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="session")
def damaged_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One with faults of many kinds."""
    return damaged(tmp_path_factory.mktemp("report") / "damaged")


@pytest.fixture(scope="session")
def damaged_page(damaged_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Its report."""
    return made(damaged_dataset, tmp_path_factory.mktemp("report") / "damaged.html")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A running browser."""
    with chromium() as found:
        yield found


@pytest.fixture(autouse=True)
def _remembered_audits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports are made in this process; workers make `page`."""
    remember_audits(monkeypatch)
