"""The state of an observation as it is recorded, and recordings that cannot be drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.synthetic_map import map_tables

from branchdrive.contract.timing import WINDOW_OFFSETS
from branchdrive.errors import UsageError
from branchdrive.raw.rollout import Rollout, RolloutTables
from branchdrive_reference.rendering.snapshot import Playback


def first_rollout(table: str = "", **changes: Any) -> Rollout:
    """The first rollout of the synthetic dataset, with changed columns of one table or, by default, of its record."""
    tables = next(iter(map_tables().values()))
    record = tables["rollouts"].slice(0, 1).to_pylist()[0]
    own: dict[str, Any] = {}
    for name in ("observations", "actors", "evidence"):
        rows = tables[name].filter([one == record["rollout_id"] for one in tables[name]["rollout_id"].to_pylist()])
        listed = [row | (changes if name == table else {}) for row in rows.to_pylist()]
        own[name] = type(rows).from_pylist(listed, schema=rows.schema)
    return Rollout(record | ({} if table else changes), RolloutTables(own))


def test_a_snapshot_is_what_is_recorded() -> None:
    rollout = first_rollout()
    recording = Playback(rollout)
    ticks = recording.window(WINDOW_OFFSETS)
    assert [tick - (rollout.branch_tick or 0) for tick in ticks] == list(WINDOW_OFFSETS)
    assert recording.window(None) == rollout.column("observations", "tick").tolist()
    state = recording.at(ticks[3])
    row = rollout.column("observations", "tick").tolist().index(ticks[3])
    assert state.x_m == rollout.column("observations", "x_m")[row]
    assert len(state.actors) == (rollout.column("actors", "tick") == ticks[3]).sum()
    assert np.isfinite(state.actors.height_m).all()


def test_without_a_branch_there_is_no_window() -> None:
    assert Playback(first_rollout(branch_tick=None)).window(WINDOW_OFFSETS) == []


@pytest.mark.parametrize(
    ("table", "changes", "fault"),
    [
        ("", {"route_x_m": [0.0]}, "a route without two whole vertices"),
        ("", {"ego_length_m": float("nan")}, "no numbers"),
        ("observations", {"x_m": float("inf")}, "no numbers"),
        ("observations", {"route_progress_m": float("nan")}, "no numbers"),
        ("actors", {"length_m": float("nan")}, "no numbers"),
        ("actors", {"actor_class": "dragon"}, "actors of unknown classes"),
    ],
)
def test_what_cannot_be_drawn_is_refused(table: str, changes: dict[str, Any], fault: str) -> None:
    with pytest.raises(UsageError, match=fault):
        Playback(first_rollout(table, **changes))
