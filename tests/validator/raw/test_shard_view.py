"""What a view of a shard computes for several rules, it computes once."""

from __future__ import annotations

import pytest
from tests import synthetic

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.mismatch import PreconditionError
from branchdrive.raw.shard_view import ShardView


def test_a_result_and_the_reason_for_none_are_found_out_once() -> None:
    view = ShardView(next(iter(synthetic.base_tables().values())), Descriptor.model_validate(synthetic.descriptor()))
    asked: list[str] = []

    def counted(view: ShardView) -> int:
        asked.append("counted")
        return view.num_rollouts

    def refused(view: ShardView) -> int:
        asked.append("refused")
        raise PreconditionError("the map covers too much")

    for _ in range(2):
        assert view.cached(counted) == view.num_rollouts
        with pytest.raises(PreconditionError, match=r"^the map covers too much$"):
            view.cached(refused)
    assert asked == ["counted", "refused"]
