"""Pictures that nobody looks at."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure


@pytest.fixture
def blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures show nothing, where a test asks which of them there are."""
    monkeypatch.setattr("branchdrive_reference.drawing.picture.draw_scene", lambda scene: Figure(figsize=(1, 1)))
