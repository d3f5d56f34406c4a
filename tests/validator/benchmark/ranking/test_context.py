"""What baselines see is read from the model layer: labels at the branch, histories of the contract, and no more."""

from __future__ import annotations

import numpy as np
import pytest
from tests.model_release import BARE, DESCRIPTOR, make_frames
from tests.validator.benchmark.samples import in_one_frame

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.protocol.selection import Baseline, Neighbours, Prior, Ridge
from branchdrive.benchmark.ranking.context import contexts_of, summaries
from branchdrive.errors import DatasetError
from branchdrive.model.arrays import pack_history
from branchdrive.tables.frame import Frame, take

ROUTE = ("town", "command", "speed_limit")
DECLARED: tuple[Baseline, ...] = (
    Prior(name="a", kind="prior", by=ROUTE, strength=1.0),
    Neighbours(name="b", kind="neighbours", contract="sensor", neighbours=3),
    Ridge(name="c", kind="ridge", contract="privileged", strength=1.0),
)


def test_labels_and_histories_are_those_of_the_groups() -> None:
    frames = make_frames()
    data = BenchmarkData.of(in_one_frame(frames), DESCRIPTOR.action_bank)
    found = contexts_of(frames.__getitem__, data.groups, DECLARED)
    groups = data.part("train").groups
    context = frames["contexts"]
    towns = dict(zip(context["group_id"].tolist(), context["town"].tolist(), strict=True))
    state = frames["state"]
    for group, (town, command, limit) in zip(groups, found.cells(ROUTE, groups), strict=True):
        (row,) = np.flatnonzero((state["group_id"] == group) & (state["offset_ticks"] == 0))
        assert (town, limit) == (towns[group], state["speed_limit_mps"][row])
        names = sorted(name for name in state if name.startswith("command_"))
        assert command == tuple(bool(state[name][row] > 0) for name in names)
    sensor, privileged = found.history("sensor", groups), found.history("privileged", groups)
    assert sensor is not None and privileged is not None
    assert (sensor.shape[1], privileged.shape[1]) == (5 * (21 + 3), 5 * (21 + 3 + 4 + 11))
    known = summaries(pack_history([state], "state", sorted(found.row)))[[found.row[group] for group in groups]]
    np.testing.assert_array_equal(sensor[:, : known.shape[1]], known)


def test_tables_that_no_baseline_sees_are_not_read() -> None:
    frames = make_frames()
    data = BenchmarkData.of(in_one_frame(frames), DESCRIPTOR.action_bank)
    read: list[str] = []

    def frame_of(name: str) -> Frame:
        read.append(name)
        return frames[name]

    by_type = Prior(name="t", kind="prior", by=("scenario_type",), strength=1.0)
    assert list(contexts_of(frame_of, data.groups, [by_type]).labels) == ["scenario_type"]
    assert read == ["contexts"]
    read.clear()
    contexts_of(frame_of, data.groups, DECLARED[1:2])
    assert read == ["state", "past_controls"]


def test_what_a_dataset_lacks_is_a_label_of_its_own_or_no_history() -> None:
    frames = make_frames(bare=True)
    size = len(frames["state"]["group_id"])
    frames["state"]["speed_limit_mps"] = np.ma.masked_array(np.zeros(size), np.ones(size, bool))
    data = BenchmarkData.of(in_one_frame(frames), BARE.action_bank)
    found = contexts_of(frames.__getitem__, data.groups, DECLARED)
    assert set(found.labels["speed_limit"]) == {None}
    assert found.history("privileged", data.part("train").groups) is None


def test_group_without_a_state_at_the_branch_is_refused() -> None:
    frames = make_frames()
    state = frames["state"]
    data = BenchmarkData.of(in_one_frame(frames), DESCRIPTOR.action_bank)
    lost = {**frames, "state": take(state, (state["group_id"] != "g1") | (state["offset_ticks"] != 0))}
    with pytest.raises(DatasetError, match="no row of `group_id` 'g1' at the branch"):
        contexts_of(lost.__getitem__, data.groups, DECLARED[:1])
