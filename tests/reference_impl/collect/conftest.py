"""What collections in the process of the tests run under."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from tests.content_cache import remembered

from branchdrive_reference.simulation.rollout import run


@pytest.fixture(scope="module")
def remembered_runs() -> Iterator[None]:
    """Collections in this process simulate equal rollouts once, and get a copy of their own each time.

    That equal rollouts have equal bytes is shown by the tests of the simulation.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("branchdrive_reference.collect.effect.run", remembered(run))
        yield
