"""A release for models, once for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.reference_impl.learning.small_models import make_release, make_visual_release


@pytest.fixture(scope="session")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_release(tmp_path_factory.mktemp("learning") / "release")


@pytest.fixture(scope="session")
def visual_release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same release with images; read-only by agreement, but for the features beside it."""
    return make_visual_release(tmp_path_factory.mktemp("visual") / "release")
