"""A release for models, once for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.reference_impl.learning.small_models import make_release


@pytest.fixture(scope="session")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_release(tmp_path_factory.mktemp("learning") / "release")
