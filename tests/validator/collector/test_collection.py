"""Groups and datasets of a world: two passes, seeds without a branch, retries, resumption, worker processes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.validator.collector.straight import NUM_FEW, BrittleRoad, EmptyRoad, ShortRoad, few_policies

import branchdrive as bd
from branchdrive.collector.collection import plan_groups
from branchdrive.collector.program import collector_main
from branchdrive.collector.report import CLUSTERS_TO_CONCLUDE
from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive.statistics.split import assign_split

ROLES = {"nominal": 1, "intervention": NUM_FEW, "nominal_replay": 2}


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bd.CollectionReport]:
    root = tmp_path_factory.mktemp("collected") / "dataset"
    worlds = {"Parked Car": ShortRoad, "Empty": EmptyRoad}
    return root, bd.collect_dataset(root, few_policies(), worlds, num_groups=3)


def rollouts(root: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = bd.open_dataset(root).rollouts().to_pylist()
    return rows


def test_scenario_types_take_turns_with_seeds_of_their_own() -> None:
    plans = plan_groups(7, 4, ("Parked Car", "Empty"))
    assert [plan.group_id for plan in plans] == [
        "g00000-parked-car",
        "g00001-empty",
        "g00002-parked-car",
        "g00003-empty",
    ]
    assert len({plan.seed for plan in plans}) == 4
    assert all(0 <= plan.seed < 2**31 for plan in plans)
    assert plans[:2] == plan_groups(7, 2, ("Parked Car", "Empty"))
    assert plan_groups(8, 1, ("Empty",))[0].seed != plans[0].seed


def test_the_dataset_is_valid_and_its_branched_groups_qualify(collected: tuple[Path, bd.CollectionReport]) -> None:
    root, report = collected
    verdict = bd.validate(root)
    assert verdict.verdict == "valid"
    assert verdict.funnel is not None
    assert list(verdict.funnel.groups.values()) == [3, 2, 2, 2, 2]
    assert report.identity == verdict.dataset.identity
    assert {finding.rule for finding in verdict.findings} == {"BD-BNK-001", "BD-TIC-003"}


def test_a_seed_without_a_branch_leaves_its_nominal_and_a_reason(collected: tuple[Path, bd.CollectionReport]) -> None:
    root, report = collected
    counts = Counter((row["group_id"], row["role"]) for row in rollouts(root))
    assert counts == {
        **{(group, role): n for group in ("g00000-parked-car", "g00002-parked-car") for role, n in ROLES.items()},
        ("g00001-empty", "nominal"): 1,
    }
    reasons = [group.unbranched_because for group in report.groups]
    assert [bool(reason) for reason in reasons] == [False, True, False]
    assert reasons[1] == "the trigger found no manoeuvre of the expert with its windows in the rollout"


def test_chosen_groups_are_the_same_in_any_order(tmp_path: Path, collected: tuple[Path, bd.CollectionReport]) -> None:
    worlds = {"Parked Car": ShortRoad, "Empty": EmptyRoad}
    only = ["g00002-parked-car", "g00001-empty"]
    bd.collect_dataset(tmp_path / "dataset", few_policies(), worlds, num_groups=3, only=only)
    whole, chosen = bd.open_dataset(collected[0]), bd.open_dataset(tmp_path / "dataset")
    assert sorted({row["group_id"] for row in rollouts(tmp_path / "dataset")}) == sorted(only)
    x_m = [dataset.group(only[0]).nominal.column("observations", "x_m") for dataset in (whole, chosen)]
    assert (x_m[0] == x_m[1]).all()


@pytest.mark.parametrize(
    ("only", "found"), [(["g7"], "there is no 'g7'"), (["g00000-empty"] * 2, "one is named twice")]
)
def test_chosen_groups_exist_once(tmp_path: Path, only: list[str], found: str) -> None:
    with pytest.raises(bd.UsageError, match=found):
        bd.collect_dataset(tmp_path, few_policies(), {"Empty": EmptyRoad}, num_groups=1, only=only)


def test_replays_equal_their_nominal(collected: tuple[Path, bd.CollectionReport]) -> None:
    dataset = bd.open_dataset(collected[0])
    group = dataset.group("g00000-parked-car")
    for replay in group.replays:
        assert (replay.column("observations", "x_m") == group.nominal.column("observations", "x_m")).all()


def test_a_kill_between_rollouts_changes_nothing(tmp_path: Path, collected: tuple[Path, bd.CollectionReport]) -> None:
    class KilledError(Exception):
        pass

    class Dying(ShortRoad):
        left = 4

        def reset(self, seed: int) -> bd.Scene:
            Dying.left -= 1
            if Dying.left < 0:
                raise KilledError
            return super().reset(seed)

    root, worlds = tmp_path / "dataset", {"Parked Car": ShortRoad, "Empty": EmptyRoad}
    with pytest.raises(KilledError):
        bd.collect_dataset(root, few_policies(), {**worlds, "Parked Car": Dying}, num_groups=3)
    report = bd.collect_dataset(root, few_policies(), worlds, num_groups=3)
    assert report.identity == collected[1].identity
    assert (report.groups[0].num_reused, report.groups[0].num_simulated) == (4, sum(ROLES.values()) - 4)


def test_worker_processes_write_the_same_bytes(tmp_path: Path, collected: tuple[Path, bd.CollectionReport]) -> None:
    worlds = {"Parked Car": ShortRoad, "Empty": EmptyRoad}
    report = bd.collect_dataset(tmp_path / "dataset", few_policies(), worlds, num_groups=3, jobs=2)
    assert (report.identity, report.num_workers) == (collected[1].identity, 2)


def test_failed_attempts_are_kept_and_made_again(tmp_path: Path) -> None:
    """The second rollout fails twice, then three attempts at the third policy, which ends the group."""
    root = tmp_path / "dataset"
    report = bd.collect_dataset(root, few_policies(), {"Parked": BrittleRoad}, num_groups=1)
    made = [(row["action_key"], row["attempt"], row["status"]) for row in rollouts(root)]
    assert made == [
        ("accelerate_0.30", 1, "partial"),
        ("accelerate_0.30", 2, "partial"),
        ("accelerate_0.30", 3, "complete"),
        ("accelerate_0.50", 1, "complete"),
        ("accelerate_0.80", 1, "partial"),
        ("accelerate_0.80", 2, "partial"),
        ("accelerate_0.80", 3, "partial"),
        ("nominal", 1, "complete"),
    ]
    assert report.groups[0].stopped_because == "no attempt at accelerate_0.80 was complete: 3 made"
    assert bd.validate(root).verdict == "valid"


def test_a_start_that_failed_leaves_nothing_in_the_way_of_the_next(tmp_path: Path) -> None:
    class Unready(ShortRoad):
        def observe(self) -> bd.Observation:
            raise bd.UsageError("not yet")

    root = tmp_path / "dataset"
    with pytest.raises(bd.UsageError, match="not yet"):
        bd.collect_dataset(root, few_policies(), {"Parked": Unready}, num_groups=2, groups_per_shard=4)
    changed = few_policies(title="Another title", streams=("ego_route_state", "controls", "route_result"))
    worlds = {"Car": ShortRoad}
    again = bd.collect_dataset(root, changed, worlds, num_groups=1)
    assert bd.open_dataset(root).groups == ("g00000-car",)
    assert again.identity == bd.collect_dataset(tmp_path / "fresh", changed, worlds, num_groups=1).identity
    with pytest.raises(bd.UsageError, match="holds a dataset with another descriptor"):
        bd.collect_dataset(root, few_policies(), worlds, num_groups=1)


def test_the_summary_says_how_many_route_clusters_there_are(collected: tuple[Path, bd.CollectionReport]) -> None:
    assert (collected[1].num_branched, collected[1].num_route_clusters) in ((2, 1), (2, 2))
    many = replace(collected[1], num_branched=9, num_route_clusters=5)
    assert many.routes_text.startswith("5 route clusters in 9 branched groups; a release takes at least 5")
    assert many.routes_text.endswith(
        "a benchmark that concludes something about 60: 15 % of them are for test, of which replay fidelity may take a "
        "third"
    )


def test_from_so_many_groups_on_different_routes_a_benchmark_can_conclude_something() -> None:
    for seed in range(5):
        ids = [f"g{i}" for i in range(CLUSTERS_TO_CONCLUDE)]
        num_test = [*assign_split(ids, range(len(ids)), ["a"] * len(ids), seed=seed).values()].count("test")
        assert num_test - num_test // 3 >= LEAST_UNITS


class LitRoad(ShortRoad):
    """Reports a traffic light that its map does not have."""

    def observe(self) -> bd.Observation:
        seen: bd.Observation = super().observe()
        return replace(seen, traffic_light="green")


def test_a_nominal_that_breaks_a_rule_on_the_map_costs_no_replays(tmp_path: Path) -> None:
    roads = [bd.lane_element(f"lane-{y}", [-100.0, 400.0], [y, y], 10.5, 13.5) for y in range(0, 4000, 100)]
    streams = ("ego_route_state", "actor_risk_evidence", "controls", "route_result", "map")
    report = bd.collect_dataset(
        tmp_path / "dataset", few_policies(streams=streams), {"Lit": LitRoad}, num_groups=1,
        maps={"StraightRoad": roads},
    )  # fmt: skip
    assert report.groups[0].refused_because.startswith("BD-MAP-009")
    assert report.groups[0].num_simulated == 1


def test_signals_lines_and_crossings_that_helpers_make_are_a_whole_map(tmp_path: Path) -> None:
    roads = [
        *(bd.lane_element(f"lane-{y}", [-100.0, 400.0], [y, y], 10.5, 13.5) for y in range(0, 4000, 100)),
        bd.sign_element("signal", "light", 390.0, -7.0, lane_id="lane-0"),
        bd.stop_line_element("line", [388.0, 388.0], [-5.0, 5.0], lane_id="lane-0", marking="solid"),
        bd.crossing_element("zebra", [390.0, 394.0, 394.0, 390.0], [-6.0, -6.0, 6.0, 6.0]),
    ]
    streams = ("ego_route_state", "actor_risk_evidence", "controls", "route_result", "map")
    root = tmp_path / "dataset"
    report = bd.collect_dataset(
        root, few_policies(streams=streams), {"Lit": LitRoad}, num_groups=1, maps={"StraightRoad": roads}
    )
    assert not report.groups[0].refused_because
    judged = {tally.rule_id: tally.status for tally in bd.validate(root).tallies}
    assert {judged[f"BD-MAP-{number:03}"] for number in (1, 2, 3)} == {"pass"}
    assert judged["BD-MAP-009"] != "fail"
    stored = bd.open_dataset(root).table("map").read()
    assert sorted({*stored["kind"].to_pylist()}) == ["crossing", "lane", "signal", "stop_line"]


def test_a_finished_dataset_stays_as_it_is(collected: tuple[Path, bd.CollectionReport]) -> None:
    root, report = collected
    worlds = {"Parked Car": ShortRoad, "Empty": EmptyRoad}
    again = bd.collect_dataset(root, few_policies(), worlds, num_groups=3)
    assert (again.identity, again.groups, again.num_found) == (report.identity, (), 3)
    with pytest.raises(bd.UsageError, match="is a finished dataset of 3 groups, which stays as it is"):
        bd.collect_dataset(root, few_policies(), worlds, num_groups=4)
    with pytest.raises(bd.UsageError, match="has begun 3 groups, more than the 2 asked for"):
        bd.collect_dataset(root, few_policies(), worlds, num_groups=2)


@pytest.mark.parametrize(("worlds", "num_groups"), [({}, 1), ({"A": ShortRoad}, 0)])
def test_nothing_to_collect_is_refused(tmp_path: Path, worlds: Any, num_groups: int) -> None:
    with pytest.raises(bd.UsageError, match="takes a world and a group"):
        bd.collect_dataset(tmp_path / "dataset", few_policies(), worlds, num_groups=num_groups)
    assert not (tmp_path / "dataset").exists()


def test_one_group_alone(tmp_path: Path) -> None:
    with bd.DatasetWriter(tmp_path / "dataset", few_policies()) as writer:
        with writer.begin_group("one") as group:
            report = bd.collect_group(
                group, few_policies(), ShortRoad, scenario_type="Parked", seed=5, num_replays=0, max_ticks=400
            )
        writer.finalize()
    assert (report.num_simulated, report.unbranched_because) == (1 + NUM_FEW, "")
    assert {row["seed"] for row in rollouts(tmp_path / "dataset")} == {5}


def test_the_program_says_what_it_did_and_what_comes_next(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "dataset"
    arguments = [str(root), "--groups", "1", "--seed", "9"]
    assert collector_main(lambda _: few_policies(), {"Empty": EmptyRoad}, arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "groups    1 collected: 0 with a branch, 1 without, 0 refused; 0 found finished"
    assert lines[4].startswith("          g00000-empty has no branch: the trigger found no manoeuvre")
    assert lines[5].startswith("routes    0 route clusters in 0 branched groups; a release parts whole clusters")
    assert lines[6] == f"next      branchdrive-validate {root}"


class DriftingRoad(ShortRoad):
    """Its speedometer shows twice the speed."""

    def observe(self) -> bd.Observation:
        seen: bd.Observation = super().observe()
        return replace(seen, speed_mps=2 * seen.speed_mps)


def test_a_nominal_that_breaks_a_rule_is_refused_and_counted_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "dataset"
    assert collector_main(lambda _: few_policies(), {"Parked": DriftingRoad}, [str(root)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "groups    1 collected: 0 with a branch, 0 without, 1 refused; 0 found finished"
    assert lines[4].startswith("          g00000-parked is refused: BD-MOT-001 ")
    assert [row["role"] for row in rollouts(root)] == ["nominal"]


def test_ten_groups_are_told_and_the_others_counted() -> None:
    groups = tuple(bd.GroupReport(f"g{i}", note="images stand still") for i in range(12))
    remarks = bd.CollectionReport(groups, 0, 1, 1.0, "").remarks("refused_because", "note")
    assert remarks[0] == "g0 is collected, with a note: images stand still"
    assert (len(remarks), remarks[-1]) == (11, "2 more: is collected, with a note")


def test_the_program_refuses_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "other.txt").write_text("mine")
    assert collector_main(lambda _: few_policies(), {"Empty": EmptyRoad}, [str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith("is not empty and holds no dataset; choose another folder\n")


def test_an_interrupted_program_says_how_to_go_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    class Interrupted(ShortRoad):
        def reset(self, seed: int) -> bd.Scene:
            raise KeyboardInterrupt

    assert collector_main(lambda _: few_policies(), {"A": Interrupted}, [str(tmp_path / "dataset")]) == 130
    assert capsys.readouterr().err.endswith("interrupted; run the same command to go on\n")
