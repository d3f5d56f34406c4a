"""What collections in the process of the tests run under."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from tests.content_cache import remembered

from branchdrive.writer.buffer import map_table
from branchdrive_reference.simulation.rollout import run


@pytest.fixture(scope="module")
def remembered_runs() -> Iterator[None]:
    """Collections in this process simulate equal rollouts and convert equal maps once, and get copies of their own.

    That equal rollouts have equal bytes is shown by the tests of the simulation.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("branchdrive_reference.collect.effect.run", remembered(run))
        patch.setattr("branchdrive.writer.writer.map_table", remembered(map_table))
        yield
