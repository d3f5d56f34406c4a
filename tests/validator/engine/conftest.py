"""The valid dataset, written once: tests that change files write their own."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.validator.engine import datasets


@pytest.fixture(scope="session")
def valid_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of the valid dataset; read-only by agreement."""
    return datasets.write(tmp_path_factory.mktemp("valid") / "dataset")
