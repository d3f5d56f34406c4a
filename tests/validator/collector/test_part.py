"""Parts of a collection, for several machines: merged, they are what one machine collects."""

from __future__ import annotations

from argparse import ArgumentTypeError
from pathlib import Path

import pytest
from tests.validator.collector.straight import EmptyRoad, descriptor

import branchdrive as bd
from branchdrive.collector.part import WHOLE, Part
from branchdrive.collector.program import collector_main
from branchdrive.writer.merge import merge_datasets

WORLDS = {"A": EmptyRoad, "B": EmptyRoad}
NUM_GROUPS = 4


def collect(root: Path, part: tuple[int, int] = WHOLE, num_groups: int = NUM_GROUPS) -> bd.CollectionReport:
    return bd.collect_dataset(
        root, descriptor(), WORLDS, num_groups=num_groups, groups_per_shard=1, part=part, max_ticks=200
    )


def contents(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("whole") / "dataset"
    collect(root)
    return root


@pytest.mark.parametrize("num_parts", [1, 2, 3])
def test_parts_make_the_collection_of_one_machine_file_by_file(tmp_path: Path, whole: Path, num_parts: int) -> None:
    roots = [tmp_path / f"part{k}" for k in range(1, num_parts + 1)]
    reports = [collect(root, (k, num_parts)) for k, root in enumerate(roots, start=1)]
    assert sum(len(report.groups) for report in reports) == NUM_GROUPS
    merge_datasets(roots, tmp_path / "merged")
    assert contents(tmp_path / "merged") == contents(whole)
    again = collect(tmp_path / "merged")
    assert (again.groups, again.num_found) == ((), NUM_GROUPS)


def test_a_part_does_not_depend_on_the_number_of_groups() -> None:
    for num_parts in (1, 2, 3, 5):
        parts = [Part(k, num_parts).places(40, groups_per_shard=4) for k in range(1, num_parts + 1)]
        assert sorted(place for part in parts for place in part) == list(range(40))
        for k, part in enumerate(parts, start=1):
            assert {place // 4 % num_parts for place in part} == {k - 1}
            assert Part(k, num_parts).places(37, groups_per_shard=4) == [place for place in part if place < 37]


def test_another_part_is_not_gone_on_with(tmp_path: Path) -> None:
    collect(tmp_path / "d", (1, 2), num_groups=2)
    with pytest.raises(bd.UsageError, match="has begun group 'g00000-a', which is of another part; ask for that part"):
        collect(tmp_path / "d", (2, 2), num_groups=2)


def test_parts_without_a_shard_and_parts_that_do_not_exist_are_refused(tmp_path: Path) -> None:
    for part, message in (
        ((3, 3), "part 3/3: has whole shards of 1 groups, and 2 groups leave none for it; ask for at most 2 parts"),
        ((3, 2), "part: parts of 2 are 1 to 2; found 3"),
        ((0, 2), "part: parts of 2 are 1 to 2; found 0"),
    ):
        with pytest.raises(bd.UsageError, match=message):
            collect(tmp_path / "d", part, num_groups=2)
    assert not (tmp_path / "d").exists()


def test_a_part_has_a_text() -> None:
    assert str(Part.parse("2/3")) == "2/3"
    assert Part.parse("12/12") == (12, 12)
    for text in ("0/2", "3/2", "1", "1/", "1/02", "a/b", "-1/2", "1/2 ", "1/1000000"):
        with pytest.raises(ArgumentTypeError, match="is not K/N, part K of N, such as 1/3"):
            Part.parse(text)


def test_the_program_collects_a_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "d"
    arguments = [str(root), "--groups", "2", "--part", "2/2"]
    assert collector_main(lambda _: descriptor(), WORLDS, arguments, groups_per_shard=1, max_ticks=200) == 0
    assert capsys.readouterr().err.startswith("0 groups of part 2/2, 0 ticks\n")
    assert bd.open_dataset(root).groups == ("g00001-b",)


def test_parts_have_one_map_of_a_town(tmp_path: Path) -> None:
    streams = ("ego_route_state", "actor_risk_evidence", "map", "controls", "route_result")
    for k, speed_limit in ((1, 13.5), (2, 8.5)):
        town = [bd.lane_element(f"lane-{y}", [-50.0, 250.0], [y, y], 10.5, speed_limit) for y in range(0, 4000, 100)]
        bd.collect_dataset(
            tmp_path / str(k), descriptor(streams=streams), WORLDS, num_groups=3, groups_per_shard=1, part=(k, 2),
            max_ticks=200, maps={"StraightRoad": town},
        )  # fmt: skip
    merge_datasets([tmp_path / "1"], tmp_path / "one")
    found = (
        r"2/raw/shard-00001: has another map of town 'StraightRoad' than .*1/raw/shard-00000; use one map in all parts"
    )
    with pytest.raises(bd.UsageError, match=found):
        merge_datasets([tmp_path / "1", tmp_path / "2"], tmp_path / "both")
