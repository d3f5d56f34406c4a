"""Where tracks begin and end, against the scene of the small valid dataset."""

from __future__ import annotations

import numpy as np
import pytest
from tests.synthetic import BRANCH_TICK, base_tables, descriptor

from branchdrive.contract.descriptor import Descriptor
from branchdrive.driving.track_end import CLASSES, TrackEnds
from branchdrive.raw.motion.track_ends import track_ends
from branchdrive.raw.shard_view import ShardView


@pytest.fixture(scope="module")
def view() -> ShardView:
    """Two groups, of 15 and of 16 attempts."""
    return ShardView(next(iter(base_tables().values())), Descriptor.model_validate(descriptor()))


def test_tracks_of_the_whole_window_neither_begin_nor_end(view: ShardView) -> None:
    """Of the second group a pedestrian comes at tick 130, right before the ego."""
    ends = track_ends(view, np.zeros(view.num_rollouts, bool))
    assert len(ends.kind) == 16
    assert ends.is_begin.all()
    assert ends.in_range.all()
    assert {CLASSES[code] for code in ends.kind} == {"pedestrian"}
    assert (ends.beyond_m < 40.0).all()


def test_the_farthest_rows_are_measured(view: ShardView) -> None:
    """The parked vehicle behind the first ego is the farthest, from the last pose of the fastest."""
    ends = track_ends(view, np.zeros(view.num_rollouts, bool))
    centres_m, boxes_m = ends.farthest_m[CLASSES.index("vehicle")]
    last = view.observations.tick == BRANCH_TICK + 50
    first_group = np.array([name.startswith("g0.") for name in view.rollout_ids])[view.observations.rollout]
    x_m, y_m = (view.observations[name][last & first_group] for name in ("x_m", "y_m"))
    assert centres_m == pytest.approx(np.hypot(x_m + 60.0, y_m - 40.0).max())
    assert centres_m - 5.0 < boxes_m < centres_m


def test_attempts_that_break_a_structure_rule_say_nothing(view: ShardView) -> None:
    ends = track_ends(view, np.ones(view.num_rollouts, bool))
    assert not len(ends.kind)
    assert not ends.farthest_m.any()


def test_shards_are_joined(view: ShardView) -> None:
    ends = track_ends(view, np.zeros(view.num_rollouts, bool))
    joined = TrackEnds.of_all([ends, ends])
    assert len(joined.kind) == 32
    assert len(np.unique(joined.group)) == 1
    assert (joined.farthest_m == ends.farthest_m).all()
    assert not len(TrackEnds.of_all([]).kind)
