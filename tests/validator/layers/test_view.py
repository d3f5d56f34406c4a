"""What rules share cannot be changed by one of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.validator.engine.release_view import release_view
from tests.validator.engine.rules.release import release_draft


def test_stored_rows_cannot_be_changed(tmp_path: Path) -> None:
    view = release_view(release_draft().write(tmp_path / "dataset"))
    for table in view.table_names:
        for values in view.frame(table).values():
            if len(values):
                with pytest.raises(ValueError, match="read-only"):
                    values[0] = values[-1]
