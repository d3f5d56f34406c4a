"""What of a history is written: that of the nominal and of marked attempts whole, of others what every group shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from branchdrive.contract.bank import load_action_bank
from branchdrive_reference.report.encode import encoded_scene
from branchdrive_reference.report.scene import Future, Scene, Track


def driven(place: int, *, is_marked: bool = False) -> Future:
    """A candidate of a drive along the x axis that is seen from 120 ticks before the branch, with one actor."""
    tick = np.arange(-120, 131, 5)
    zero = np.zeros(len(tick))
    tracks = {7: Track("vehicle", 4.0, 2.0, tick, 0.5 * tick, zero + 3.0, zero, 3.0)}
    return Future(
        load_action_bank().policies[place], f"a{place}", 200, tick, 0.5 * tick, zero, zero, zero + 10.0, zero + 1.0,
        zero > 0, np.arange(-120, 131), np.zeros((3, 251)), tracks, is_marked,
    )  # fmt: skip


def moved(future: Future) -> Future:
    """The same 1 m to the left."""
    return replace(future, y_m=future.y_m + 1.0)


def test_an_early_history_is_written_where_a_finding_or_the_nominal_has_it() -> None:
    alike, other, marked = driven(1), moved(driven(2)), moved(driven(3, is_marked=True))
    document = encoded_scene(Scene("g", (driven(0), alike, other, marked)))
    found = [(one["shares"], one["rows"], one["commands"]) for one in document["futures"]]
    assert found == [(False, 51, 251), (True, 26, 131), (False, 43, 211), (False, 51, 251)]
    assert document["futures"][2]["actors"] == [[7, -1, -80, 130]]
    assert document["branch"] == 200
