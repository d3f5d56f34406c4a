"""The bytes of a dataset depend on its rollouts and places, and on nothing else."""

from __future__ import annotations

import random
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from tests.sampling import sampled
from tests.validator.writer.invented import (
    ATTEMPTS,
    identity_fields,
    make_descriptor,
    result_fields,
    write_dataset,
    write_group,
    write_rollout,
)
from tests.waiting import PATIENCE_S

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.errors import ContractError
from branchdrive.writer.writer import DatasetWriter

NUM_GROUPS = 3
REPOSITORY = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Manifest of three groups, written one after the other."""
    root = tmp_path_factory.mktemp("expected")
    write_dataset(root, NUM_GROUPS)
    return (root / MANIFEST_FILE).read_bytes()


def manifest(root: Path) -> bytes:
    return (root / MANIFEST_FILE).read_bytes()


@pytest.mark.parametrize("seed", sampled(range(3), every=3))
def test_the_order_of_groups_attempts_and_commits_means_nothing(tmp_path: Path, expected: bytes, seed: int) -> None:
    rng = random.Random(seed)
    attempts: Sequence[tuple[str, str]] = rng.sample(ATTEMPTS, len(ATTEMPTS))
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
        for index in rng.sample(range(NUM_GROUPS), NUM_GROUPS):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group, attempts)
            if rng.random() < 0.5:
                writer.commit()
        writer.finalize()
    assert manifest(tmp_path) == expected


def test_places_are_given_in_order_by_default(tmp_path: Path, expected: bytes) -> None:
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
        for index in range(NUM_GROUPS):
            with writer.begin_group(f"g{index}") as group:
                assert group.index == index
                write_group(group)
        writer.finalize()
    assert manifest(tmp_path) == expected


def test_abandoned_and_refused_rollouts_leave_nothing(tmp_path: Path, expected: bytes) -> None:
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
        for index in range(NUM_GROUPS):
            with writer.begin_group(f"g{index}") as group:
                group.begin_rollout(role="nominal", action_key="nominal", protocol_variant="v1").abandon()
                refused = group.begin_rollout(**identity_fields("nominal", "nominal", None))
                with pytest.raises(ContractError):
                    refused.finish(**result_fields() | {"result_route_fraction": 2.0})
                refused.abandon()
                write_group(group)
        writer.finalize()
    assert manifest(tmp_path) == expected


def test_a_writer_per_group_and_exceptions_in_between_mean_nothing(tmp_path: Path, expected: bytes) -> None:
    for index in range(NUM_GROUPS):
        with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
            with pytest.raises(ZeroDivisionError), writer.begin_group(f"g{index}") as group:
                write_rollout(group, *ATTEMPTS[0])
                group.begin_rollout(role="intervention", action_key="brake_0.50", protocol_variant="v1")
                1 / 0  # noqa: B018
            assert not writer.is_closed(f"g{index}")
            with writer.begin_group(f"g{index}") as group:
                assert [rollout.record["role"] for rollout in group.rollouts] == ["nominal"]
                write_group(group)
            assert writer.is_closed(f"g{index}")
            writer.commit()
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
        writer.finalize()
    assert manifest(tmp_path) == expected


def test_empty_groups_leave_no_trace(tmp_path: Path, expected: bytes) -> None:
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
        with writer.begin_group("empty", index=NUM_GROUPS + 4):
            pass
        assert writer.is_closed("empty")
        for index in range(NUM_GROUPS):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group)
        writer.finalize()
    assert manifest(tmp_path) == expected


WORKER = """
import sys
from pathlib import Path
from branchdrive.writer.group_writer import GroupWriter
from tests.validator.writer.invented import make_descriptor, write_group

for index in map(int, sys.argv[2:]):
    with GroupWriter(Path(sys.argv[1]), make_descriptor(), f"g{index}", index) as group:
        write_group(group)
"""


def test_several_processes_write_the_same_bytes(tmp_path: Path, expected: bytes) -> None:
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
        # Both processes take group 1: the second waits for the first and finds its rollouts.
        workers = [
            subprocess.Popen([sys.executable, "-c", WORKER, str(tmp_path), *shares], cwd=REPOSITORY)
            for shares in (["2", "1"], ["1", "0"])
        ]
        assert [worker.wait(timeout=PATIENCE_S) for worker in workers] == [0, 0]
        assert writer.commit() == 1
        writer.finalize()
    assert manifest(tmp_path) == expected


def test_a_second_writer_of_a_group_waits_for_the_first(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path, make_descriptor()) as writer:
        group = writer.begin_group("g0")
        worker = subprocess.Popen([sys.executable, "-c", WORKER, str(tmp_path), "0"], cwd=REPOSITORY)
        with pytest.raises(subprocess.TimeoutExpired):
            worker.wait(timeout=1)
        write_rollout(group, *ATTEMPTS[0])
        group.close()
        assert worker.wait(timeout=PATIENCE_S) == 0
        with writer.begin_group("g0") as group:
            assert len(group.rollouts) == len(ATTEMPTS)


def test_commit_writes_complete_shards_only(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=2) as writer:
        numbers = []
        for index in range(3):
            with writer.begin_group(f"g{index}") as group:
                write_group(group)
            numbers.append(writer.commit())
        assert numbers == [0, 1, 0]
        assert [path.name for path in (tmp_path / "raw").iterdir()] == ["shard-00000"]
        assert all(writer.is_closed(f"g{index}") for index in range(3))
        assert not writer.is_closed("g3")
