"""Rows that repeat what they name: what is looked at is bounded by ticks, and not by how many rows there are of one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.synthetic import BRANCH_TICK, STRIDE
from tests.validator.engine.rules.case import NOMINAL, SHARD_0, new_draft

from branchdrive.contract.timing import FUTURE_OFFSETS, HISTORY_OFFSETS
from branchdrive.engine.validate import validate
from branchdrive.raw.rules import tracks

TICKS = FUTURE_OFFSETS[-1] - HISTORY_OFFSETS[0] + 1
"""Ticks of a window."""


class Counted(float):
    """A range that notes how often it is compared with."""

    num_uses = 0

    def __sub__(self, other: Any) -> Any:
        type(self).num_uses += 1
        return float(self) - other


def test_a_tick_that_many_rows_repeat_is_looked_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draft = new_draft()
    (actor_id, *_) = draft.take("actors", rollout_id=NOMINAL, tick=BRANCH_TICK)["actor_id"].to_pylist()
    draft.drop("actors", rollout_id=NOMINAL, tick=BRANCH_TICK, actor_id=actor_id)
    place = {"rollout_id": NOMINAL, "tick": BRANCH_TICK}
    repeated = draft.take("observations", **place).take(np.zeros(TICKS, np.int64))
    draft.append("observations", repeated, folder=SHARD_0)
    draft.recount(NOMINAL)
    monkeypatch.setattr(tracks, "RANGE_M", Counted(tracks.RANGE_M))
    report = validate(draft.write(tmp_path / "dataset"))
    assert report.errors == ()
    assert 0 < Counted.num_uses <= TICKS // STRIDE
    (found,) = (f.location for f in report.findings if f.rule == "BD-ACT-003")
    assert (found["rollout_id"], found["actor_id"], found["tick"]) == (NOMINAL, actor_id, BRANCH_TICK + STRIDE)
