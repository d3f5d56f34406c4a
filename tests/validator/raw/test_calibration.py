"""Sign, unit and clock of recorded motion, against analytic cases."""

from __future__ import annotations

import numpy as np
import pytest
from tests.synthetic import base_tables, descriptor

from branchdrive.contract.descriptor import Descriptor
from branchdrive.raw.calibration import QUANTITIES, calibration
from branchdrive.raw.shard_view import ShardView


@pytest.fixture(scope="module")
def view() -> ShardView:
    return ShardView(next(iter(base_tables().values())), Descriptor.model_validate(descriptor()))


def test_a_consistent_world_is_right_in_every_quantity(view: ShardView) -> None:
    found = calibration(view, np.zeros(view.num_rollouts, bool))
    assert set(found) == set(QUANTITIES)
    for name, values in found.items():
        assert len(values)
        assert (values >= QUANTITIES[name].least).all()
        assert (values <= QUANTITIES[name].most).all()


def test_attempts_that_break_a_structure_rule_say_nothing(view: ShardView) -> None:
    found = calibration(view, np.ones(view.num_rollouts, bool))
    assert [len(values) for values in found.values()] == [0] * len(QUANTITIES)
