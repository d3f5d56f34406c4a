"""Every wrong use of the writers in one table: what is done, which error, and what its message names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from tests.validator.writer.invented import (
    ATTEMPTS,
    actor_row,
    branch_fields,
    camera,
    control_rows,
    evidence_row,
    generator,
    identity_fields,
    make_descriptor,
    observation_rows,
    result_fields,
    write_rollout,
)

from branchdrive.contract.descriptor import Descriptor
from branchdrive.errors import BranchDriveError, ContractError, DatasetError, UsageError
from branchdrive.writer.group_writer import GroupWriter
from branchdrive.writer.rollout_writer import RolloutWriter
from branchdrive.writer.writer import DatasetWriter


@dataclass
class Scene:
    """A dataset that is being written: one closed group `done`, one group with an open nominal rollout."""

    root: Path
    writer: DatasetWriter
    group: GroupWriter
    rollout: RolloutWriter

    def append_ticks(self, **changes: Any) -> None:
        columns = control_rows(generator("scene"), 4, np.zeros(4, bool)) | changes
        self.rollout.append_ticks(**{name: value for name, value in columns.items() if value is not ...})

    def append_tick(self, **changes: Any) -> None:
        columns = control_rows(generator("scene"), 1, np.zeros(1, bool))
        scalars = {name: value[0] for name, value in columns.items()} | changes
        self.rollout.append_ticks(**scalars)

    def append_observations(self, **changes: Any) -> None:
        self.rollout.append_observations(**observation_rows(generator("scene"), 4) | changes)

    def finish(self, **changes: Any) -> None:
        self.rollout.finish(**result_fields() | branch_fields("g.nominal.v1.a1") | changes)

    def begin(self, **changes: Any) -> RolloutWriter:
        self.rollout.abandon()
        fields = identity_fields("nominal", "nominal", None) | changes
        return self.group.begin_rollout(**{name: value for name, value in fields.items() if value is not ...})


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    root = tmp_path / "dataset"
    with DatasetWriter(root, make_descriptor(), groups_per_shard=2) as writer:
        with writer.begin_group("done") as group:
            write_rollout(group, *ATTEMPTS[0])
        group = writer.begin_group("g")
        rollout = group.begin_rollout(**identity_fields("nominal", "nominal", None))
        yield Scene(root, writer, group, rollout)
        group.release()


def descriptor_of_long_camera() -> Descriptor:
    plain = make_descriptor(has_media=True)
    return plain.model_copy(update={"cameras": (*plain.cameras, camera("c" * 89, "rgb_top_down"))})


def foreign_folder(scene: Scene) -> DatasetWriter:
    folder = scene.root.parent / "foreign"
    folder.mkdir()
    (folder / "thesis.tex").write_text("")
    return DatasetWriter(folder, make_descriptor())


def damaged_descriptor(scene: Scene) -> DatasetWriter:
    folder = scene.root.parent / "damaged"
    folder.mkdir()
    (folder / "branchdrive.json").write_text("{")
    return DatasetWriter(folder, make_descriptor())


def after_finish(scene: Scene) -> None:
    scene.append_ticks()
    scene.finish()
    scene.append_ticks()


def finish_twice(scene: Scene) -> None:
    scene.finish()
    scene.finish()


def after_abandon(scene: Scene) -> None:
    scene.rollout.abandon()
    scene.append_ticks()


def after_release(scene: Scene) -> None:
    scene.group.release()
    scene.finish()


def after_close(scene: Scene) -> None:
    scene.finish()
    scene.group.close()
    scene.group.begin_rollout(**identity_fields("nominal", "nominal", None))


def writer_after_close(scene: Scene) -> None:
    scene.writer.close()
    scene.writer.commit()


def same_id_twice(scene: Scene) -> None:
    scene.finish()
    fields = identity_fields("nominal_replay", "nominal", "g.nominal.v1.a1")
    scene.group.begin_rollout(**fields, rollout_id="g.nominal.v1.a1")


def same_id_in_two_groups(scene: Scene) -> None:
    taken = scene.begin(rollout_id="done.nominal.v1.a1")
    taken.finish(**result_fields())
    scene.group.close()
    scene.writer.finalize()


def other_shard_size(scene: Scene) -> None:
    scene.finish()
    scene.group.close()
    scene.writer.finalize()
    DatasetWriter(scene.root, make_descriptor(), groups_per_shard=3)


def orphaned_group(scene: Scene) -> None:
    scene.finish()
    scene.group.close()
    scene.writer.finalize()
    GroupWriter(scene.root, make_descriptor(), "late", 7)


def actor_twice(scene: Scene) -> None:
    scene.append_observations()
    for _ in range(2):
        scene.rollout.append_actors(**actor_row(generator(), 0, 1))
    scene.rollout.append_evidence(**evidence_row(generator(), 0, 2))
    scene.finish()


def unclaimed_stream(scene: Scene) -> None:
    bare = make_descriptor(has_evidence=False)
    with DatasetWriter(scene.root.parent / "bare", bare) as writer, writer.begin_group("g") as group:
        rollout = group.begin_rollout(**identity_fields("nominal", "nominal", None))
        rollout.append_evidence(**evidence_row(generator(), 0, 0))


def place_of_nobody(scene: Scene) -> None:
    GroupWriter(scene.root.parent, make_descriptor(), "x", 9)


def group_of_another_dataset(scene: Scene) -> None:
    GroupWriter(scene.root, make_descriptor(dataset_id="b"), "x", 9)


def intervention_with_the_nominal_policy(scene: Scene) -> None:
    scene.begin(role="intervention", nominal_rollout_id="x").finish(**result_fields())


def append_and_finish(**columns: Any) -> Callable[[Scene], None]:
    def act(scene: Scene) -> None:
        scene.append_ticks(**columns)
        scene.finish()

    return act


def append_scalars_and_finish(**columns: Any) -> Callable[[Scene], None]:
    def act(scene: Scene) -> None:
        scene.append_tick(**columns)
        scene.finish()

    return act


def writer_at(name: str, descriptor: Descriptor, **options: Any) -> Callable[[Scene], DatasetWriter]:
    return lambda scene: DatasetWriter(scene.root.parent / name, descriptor, **options)


REFUSED, MISUSED = ContractError, UsageError
PLAIN = make_descriptor()
OTHER = make_descriptor(dataset_id="other")

TABLE: dict[str, tuple[Callable[[Scene], object], type[BranchDriveError], str]] = {
    # rows
    "unknown column": (lambda s: s.append_ticks(angle=0.0), REFUSED, r"`controls`.*unknown columns \['angle'\]"),
    "missing column": (lambda s: s.append_ticks(applied_steer=...), REFUSED, r"missing columns \['applied_steer'\]"),
    "rollout_id given": (lambda s: s.append_ticks(rollout_id=["x"] * 4), REFUSED, "unknown columns"),
    "lengths differ": (lambda s: s.append_ticks(tick=np.arange(3)), REFUSED, "different lengths: .*'tick': 3"),
    "two dimensions": (lambda s: s.append_ticks(tick=np.zeros((4, 1), int)), REFUSED, r"shape \(4, 1\)"),
    "floats for integers": (lambda s: s.append_ticks(tick=np.arange(4.0)), REFUSED, "`controls.tick`.*float64"),
    "numbers for flags": (lambda s: s.append_ticks(active=np.zeros(4, int)), REFUSED, "`controls.active`.*int64"),
    "flags for numbers": (lambda s: s.append_ticks(applied_brake=np.ones(4, bool)), REFUSED, "applied_brake.*bool"),
    "numbers for text": (lambda s: s.append_ticks(source=np.arange(4)), REFUSED, "`controls.source`.*int64"),
    "text for numbers": (lambda s: s.append_ticks(tick=["0"] * 4), REFUSED, "expected int32, found '0'"),
    "too wide an integer": (lambda s: s.append_ticks(tick=np.arange(4) + 2**40), REFUSED, "`controls.tick`.*int32"),
    "a scalar of the wrong type": (append_scalars_and_finish(tick=0.5), REFUSED, "int32, found 0.5"),
    "a numpy scalar of the wrong type": (append_scalars_and_finish(tick=np.float64(1)), REFUSED, "int32"),
    "an array scalar of the wrong type": (append_scalars_and_finish(tick=np.array(1.0)), REFUSED, "int32"),
    "a flag as a number": (append_scalars_and_finish(applied_brake=True), REFUSED, "float32, found True"),
    "a stream that is not claimed": (unclaimed_stream, REFUSED, "`evidence`.*belongs to none of the streams"),
    "append after finish": (after_finish, MISUSED, "`g.nominal.v1.a1` is finished or abandoned"),
    "append after abandon": (after_abandon, MISUSED, "`g.nominal.v1.a1` is finished or abandoned"),
    # finished rollouts
    "not finite": (append_and_finish(expert_steer=np.full(4, np.nan)), REFUSED, "finite.*expert_steer"),
    "out of range": (append_and_finish(expert_steer=np.full(4, 2.0)), REFUSED, "range.*expert_steer"),
    "not in the vocabulary": (append_and_finish(source=["human"] * 4), REFUSED, "declared categories.*human"),
    "null without availability": (append_and_finish(applied_steer=None), REFUSED, "hold no null"),
    "a key twice": (actor_twice, REFUSED, "unique"),
    "unknown field": (lambda s: s.finish(colour="red"), REFUSED, r"unknown columns \['colour'\]"),
    "field given twice": (lambda s: s.finish(town="Town13"), MISUSED, r"fields \['town'\] were given"),
    "missing field": (lambda s: s.rollout.finish(), REFUSED, "missing columns .*'result_completion'.*'status'"),
    "wrong type of a field": (lambda s: s.finish(status=1), REFUSED, "`rollouts.status`: expected string, found 1"),
    "half a branch": (lambda s: s.finish(trigger_signal=None), REFUSED, "trigger_signal"),
    "role against the action key": (intervention_with_the_nominal_policy, REFUSED, "agree with the role"),
    "finish twice": (finish_twice, MISUSED, "finished or abandoned"),
    "finish after the group was released": (after_release, MISUSED, "writer of group `g` is closed"),
    # rollouts of a group
    "two open rollouts": (lambda s: s.group.begin_rollout(), MISUSED, "`g.nominal.v1.a1` is open"),
    "no role": (lambda s: s.begin(role=...), REFUSED, r"missing columns \['role'\]"),
    "a field that is filled in": (lambda s: s.begin(attempt=3), REFUSED, r"unknown columns \['attempt'\]"),
    "a rollout id that is no id": (lambda s: s.begin(rollout_id="../x"), MISUSED, "'../x' does not match"),
    "a rollout id that is taken": (same_id_twice, MISUSED, "`g.nominal.v1.a1` is taken"),
    "a rollout id of another group": (same_id_in_two_groups, REFUSED, r"\['done.nominal.v1.a1'\] occur in two groups"),
    # groups
    "a group id that is no id": (lambda s: s.writer.begin_group("Group 1"), MISUSED, "'Group 1' does not match"),
    "a negative place": (lambda s: s.writer.begin_group("x", index=-1), MISUSED, "0 or more, found -1"),
    "a place in no shard": (lambda s: s.writer.begin_group("x", index=2 * 10**9), MISUSED, "at most 1999999999, found"),
    "a place that is taken": (lambda s: s.writer.begin_group("x", index=0), MISUSED, "taken by group `done`"),
    "another place": (lambda s: s.writer.begin_group("done", index=5), MISUSED, "`done` has place 0, not 5"),
    "a group that is open here": (lambda s: s.writer.begin_group("g"), MISUSED, "`g` is open in this process"),
    "closing with an open rollout": (lambda s: s.group.close(), MISUSED, "`g.nominal.v1.a1` is open"),
    "writing to a closed group": (after_close, MISUSED, "writer of group `g` is closed"),
    "a group without a dataset writer": (orphaned_group, MISUSED, "open the dataset with `DatasetWriter`"),
    "a group of another dataset": (group_of_another_dataset, MISUSED, "another descriptor"),
    "a group of no dataset": (place_of_nobody, MISUSED, "another descriptor or none"),
    # datasets
    "a second writer": (writer_at("dataset", PLAIN), MISUSED, "another `DatasetWriter` has"),
    "another descriptor": (writer_at("dataset", OTHER), MISUSED, r"\(dataset_id is '.*', not 'other'\)"),
    "a damaged descriptor": (damaged_descriptor, DatasetError, "is not a descriptor"),
    "no descriptor": (writer_at("new", cast(Descriptor, {})), MISUSED, "must be a `Descriptor`, found dict"),
    "a file for a folder": (writer_at("dataset/branchdrive.json", PLAIN), MISUSED, "is not a folder"),
    "another shard size": (other_shard_size, MISUSED, "has 2 groups per shard, not 3; pass 2"),
    "a foreign folder": (foreign_folder, MISUSED, "not empty and holds no dataset"),
    "no place in a shard": (writer_at("new", PLAIN, groups_per_shard=0), MISUSED, "at least 1, found 0"),
    "long camera": (writer_at("new", descriptor_of_long_camera()), MISUSED, "at most 88 characters"),
    "unclaimed media": (lambda s: s.rollout.append_frame(0, "bev", b""), MISUSED, "none of the streams"),
    "finishing with an open group": (lambda s: s.writer.finalize(), MISUSED, r"groups \['g'\] are open"),
    "finishing an empty dataset": (lambda s: writer_at("new", PLAIN)(s).finalize(), MISUSED, "no rollout"),
    "using a closed writer": (writer_after_close, MISUSED, "is closed; make another"),
}  # fmt: skip


@pytest.mark.parametrize("case", TABLE)
def test_wrong_use_is_refused_in_words(scene: Scene, case: str) -> None:
    action, error, message = TABLE[case]
    with pytest.raises(error, match=message):
        action(scene)


def test_a_refusal_says_where_expected_found_and_what_to_do(scene: Scene) -> None:
    scene.append_ticks(expert_brake=np.array([0, 0, 3, 0], np.float32), source=["human"] * 4)
    with pytest.raises(ContractError) as caught:
        scene.finish()
    lines = str(caught.value).splitlines()
    assert lines[0] == "rollout `g.nominal.v1.a1` breaks the format and was not written:"
    assert len(lines) - 1 == len(caught.value.findings) >= 2
    assert all("expected" in line and "found" in line and "; " in line for line in lines[1:])
    assert any("tick=2" in line and "column=expert_brake" in line for line in lines)


def test_a_refused_rollout_is_not_written(scene: Scene) -> None:
    scene.append_ticks(expert_brake=np.full(4, 3.0))
    with pytest.raises(ContractError):
        scene.finish()
    assert scene.group.rollouts == ()
    scene.rollout.abandon()
    assert scene.group.begin_rollout(**identity_fields("nominal", "nominal", None)).attempt == 1
