"""What makes a reader's work short: groups by what they are, times, actors, outcomes, data frames, notebooks."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from tests import synthetic
from tests.validator.engine.datasets import write
from tests.validator.engine.rules.release import release_draft

from branchdrive.driving.target import TARGETS
from branchdrive.errors import PlatformError, UnknownNameError, UsageError
from branchdrive.raw.reader import Dataset, open_dataset
from branchdrive.tables import data_frame


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return release_draft().write(tmp_path_factory.mktemp("release") / "dataset")


@pytest.fixture(scope="module")
def release(root: Path) -> Dataset:
    return open_dataset(root)


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return open_dataset(write(tmp_path_factory.mktemp("raw") / "dataset"))


def test_groups_are_selected_by_what_they_are(release: Dataset) -> None:
    rollouts = release.rollouts().to_pylist()
    wanted = {row["group_id"] for row in rollouts if row["town"] == "Town12" and row["scenario_type"] == "CutIn"}
    found = release.select(town="Town12", scenario_type="CutIn")
    assert set(found.groups) == wanted
    assert 0 < len(found) < len(release)
    assert [group.group_id for group in found] == [*found.groups]
    either = release.select(scenario_type=["CutIn", "Crossing"])
    kinds = {release.contexts[group_id]["scenario_type"] for group_id in either.groups}
    assert kinds == {"CutIn", "Crossing"}
    assert len(release.select()) == len(release)


def test_groups_are_selected_by_what_the_quality_layer_says(release: Dataset, root: Path) -> None:
    rows = [row for path in root.glob("quality/group_quality-*.parquet") for row in pq.read_table(path).to_pylist()]
    train = {row["group_id"] for row in rows if row["partition"] == "train" and row["core_valid"]}
    found = release.select(partition="train", core_valid=True)
    assert set(found.groups) == train
    assert set(found.select(town="Town12").groups) < train


@pytest.mark.parametrize("table", ["rollouts", "controls", "observations", "actors", "evidence"])
def test_tables_of_a_selection_hold_its_rows_alone(table: str, release: Dataset) -> None:
    found = release.select(town="Town13")
    of_group = {row["rollout_id"]: row["group_id"] for row in release.rollouts().to_pylist()}
    expected = [row for row in release.table(table).read().to_pylist() if of_group[row["rollout_id"]] in found.groups]
    assert found.table(table).read().to_pylist() == expected


def test_a_group_outside_of_a_selection_is_not_in_it(release: Dataset) -> None:
    found = release.select(town="Town13")
    outside = next(group_id for group_id in release.groups if group_id not in found.groups)
    with pytest.raises(UsageError, match="no group"):
        found.group(outside)


def test_names_that_do_not_exist_are_answered_with_those_that_do(release: Dataset, raw: Dataset) -> None:
    with pytest.raises(UsageError, match=r"no group has town 'Town1'; did you mean 'Town12' or 'Town13'\?"):
        release.select(town="Town1")
    with pytest.raises(UsageError, match=r"groups have no 'scenario'; did you mean 'scenario_type'\?"):
        release.select(scenario="CutIn")
    with pytest.raises(UsageError, match="run `branchdrive build`"):
        raw.select(partition="train")
    with pytest.raises(UsageError, match=r"no table 'obs' in this dataset; did you mean 'observations'\?"):
        raw.table("obs")
    group = raw.group(raw.groups[0])
    with pytest.raises(UnknownNameError, match=r"no intervention 'brake' in this group; did you mean 'brake_0"):
        group.interventions["brake"]
    with pytest.raises(AttributeError, match="no attribute 'open_datset'") as caught:
        import branchdrive

        branchdrive.open_datset  # noqa: B018
    assert caught.value.name == "open_datset"


def test_times_are_in_seconds_from_the_beginning(raw: Dataset) -> None:
    rollout = raw.group(raw.groups[0]).nominal
    ticks = rollout.tables["observations"]["tick"].to_pylist()
    assert rollout.t_s.tolist() == pytest.approx([0.05 * tick for tick in ticks])
    assert rollout.branch_s == pytest.approx(0.05 * rollout.record["branch_tick"])


def test_actors_are_found_by_tick(raw: Dataset) -> None:
    rollout = raw.group(raw.groups[0]).nominal
    found = rollout.actors
    assert [*found] == rollout.tables["observations"]["tick"].to_pylist()
    rows = rollout.tables["actors"].to_pylist()
    for tick, actors in found.items():
        assert actors.to_pylist() == [row for row in rows if row["tick"] == tick]
    assert any(len(actors) for actors in found.values())


def test_outcomes_of_candidates_are_those_of_the_model_layer(release: Dataset, root: Path) -> None:
    stored = [row for path in root.glob("model/scalars-*.parquet") for row in pq.read_table(path).to_pylist()]
    by_key = {(row["group_id"], row["action_key"]): row for row in stored}
    records = [row for path in root.glob("canonical/records-*.parquet") for row in pq.read_table(path).to_pylist()]
    selected = {(row["group_id"], row["action_key"]): row["rollout_id"] for row in records}
    num_compared = 0
    for group in release:
        for row in group.outcomes().to_pylist():
            key = group.group_id, row["action_key"]
            if selected.get(key) != row["rollout_id"] or key not in by_key:
                continue
            num_compared += 1
            assert row["result_completion"] == group.candidates[row["action_key"]].record["result_completion"]
            for target in TARGETS:
                expected = by_key[key][target.name]
                assert row[target.name] == (None if expected is None else pytest.approx(expected, rel=1e-9))
    assert num_compared > 0.8 * len(stored) > 0


def test_a_target_without_its_rows_is_null(tmp_path: Path) -> None:
    tables = {folder: dict(shard) for folder, shard in synthetic.base_tables().items()}
    folder = next(iter(tables))
    first = tables[folder]["rollouts"]["rollout_id"][0].as_py()
    evidence = tables[folder]["evidence"]
    tables[folder]["evidence"] = evidence.filter(np.array(evidence["rollout_id"].to_pylist()) != first)
    dataset = open_dataset(write(tmp_path / "dataset", tables))
    rows = {row["rollout_id"]: row for group in dataset for row in group.outcomes().to_pylist()}
    assert rows[first]["min_separation_m"] is None
    assert rows[first]["displacement_m"] is not None


def test_candidates_are_the_first_complete_attempts(release: Dataset) -> None:
    group = release.group("g8")  # its first attempt at braking was cut short
    assert group.candidates["brake_0.50"].record["attempt"] == 2
    assert next(iter(group.candidates)) == "nominal"
    assert len(group.candidates) == 13


def test_a_stream_of_a_group_says_whose_rows_are_whose(raw: Dataset) -> None:
    group = raw.group(raw.groups[0])
    rows = group.table("observations")
    assert rows.column_names[:4] == ["role", "action_key", "attempt", "rollout_id"]
    assert len(rows) == sum(len(rollout.tables["observations"]) for rollout in group.rollouts)
    of_rollout = {rollout.rollout_id: rollout.record["action_key"] for rollout in group.rollouts}
    assert all(of_rollout[row["rollout_id"]] == row["action_key"] for row in rows.to_pylist())


def test_tables_are_data_frames_of_pandas(raw: Dataset) -> None:
    group = raw.group(raw.groups[0])
    for frame, table in (
        (raw.table("evidence").to_pandas(), raw.table("evidence").read()),
        (group.to_pandas("controls"), group.table("controls")),
    ):
        assert [*frame.columns] == table.column_names
        assert frame.isna().sum().to_dict() == {name: table[name].null_count for name in table.column_names}
        assert len(frame) == len(table)


def test_tables_are_data_frames_of_polars(raw: Dataset) -> None:
    pytest.importorskip("polars", reason="polars is heavy: run `pip install '.[frames]'` to try its data frames")
    group = raw.group(raw.groups[0])
    assert raw.table("evidence").to_polars().to_arrow().num_rows == raw.table("evidence").read().num_rows
    assert group.to_polars("controls").columns == group.table("controls").column_names


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_without_the_library_the_command_that_installs_it_is_named(
    library: str, raw: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, library, None)
    with pytest.raises(PlatformError, match=rf"a data frame of {library} needs the package .*\[frames\]"):
        getattr(data_frame, f"to_{library}")(raw.rollouts())


def test_notebooks_show_names_as_text(tmp_path: Path) -> None:
    hostile = "<script>alert(1)</script>"
    dataset = open_dataset(write(tmp_path / "dataset", None, {**synthetic.descriptor(), "title": hostile}))
    for shown in (dataset, dataset.group(dataset.groups[0])):
        html = shown._repr_html_()
        assert html.startswith("<div>")
        assert html.endswith("</div>")
        assert not re.search(r"<script|<img|on\w+=", html)
    assert "&lt;script&gt;" in dataset._repr_html_()
