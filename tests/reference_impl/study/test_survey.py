"""A study counts and ranks what a slow second reading of the same dataset finds."""

from __future__ import annotations

import math
from collections import defaultdict
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.reference_impl.study import samples
from tests.synthetic import BRANCH_TICK, NUM_TICKS, bare_descriptor, group_name
from tests.validator.driving import oracle_target

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.columns import TICK_TABLES
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.rollout import Rollout
from branchdrive_reference.study.study import Study
from branchdrive_reference.study.survey import study_dataset

FUTURE = [BRANCH_TICK + 5 * j for j in range(1, 11)]
NAMES = [f"g{index}.{key}.a{n}" for index in (0, 1) for key in load_action_bank().keys for n in (1, 2)]
FAMILIES = ["nominal", "accelerate", "brake", "steer_left", "steer_right"]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # One action touches something on the way, two others do so before and after the window.
    touches = {"brake_1.00": BRANCH_TICK + 50, "steer_left_0.05": BRANCH_TICK, "steer_right_0.05": BRANCH_TICK + 55}
    edits = [
        samples.replaced("collision", {f"g0.{key}.a1": True}, samples.rows_at(f"g0.{key}.a1", tick))
        for key, tick in touches.items()
    ]
    root = tmp_path_factory.mktemp("study") / "dataset"
    return samples.written(root, {"evidence": lambda table: reduce(lambda t, edit: edit(t), edits, table)})


@pytest.fixture(scope="module")
def study(root: Path) -> Study:
    return study_dataset(root, samples.unseen)


def candidates(group: BranchGroup) -> dict[str, Rollout]:
    """First attempts by action key."""
    return {"nominal": group.nominal} | {key: attempts[0] for key, attempts in group.interventions.items()}


def rows(rollout: Rollout, table: str, ticks: list[int], *columns: str) -> list[tuple[Any, ...]]:
    """Values at ticks, row by row, ``None`` where null."""
    at = rollout.tables[table]["tick"].to_pylist()
    lists = [rollout.tables[table][column].to_pylist() for column in columns]
    return [tuple(values[at.index(tick)] for values in lists) for tick in ticks]


def outcome(rollout: Rollout) -> list[float | None]:
    """The six targets by the oracle."""
    poses = rows(rollout, "observations", [BRANCH_TICK, *FUTURE], "x_m", "y_m", "yaw_rad", "speed_mps")
    evidence = rows(rollout, "evidence", FUTURE, "separation_m", "ttc_s")
    return oracle_target.scalars(poses, [s for s, _ in evidence], [t for _, t in evidence])  # type: ignore[arg-type]


def balanced(values: list[float | None], quantiles: list[tuple[float, float]]) -> float:
    """Balanced utility from separation, displacement, jerk, acceleration and yaw rate; NaN without separation."""
    if values[1] is None:
        return math.nan
    shares = [
        min(max((float(v) - low) / (high - low), 0.0), 1.0)  # type: ignore[arg-type]
        for v, (low, high) in zip(values[1:], quantiles, strict=True)
    ]
    return (shares[0] + shares[1] + (3 - sum(shares[2:])) / 3) / 3


def touches(rollout: Rollout, ticks: list[int] | None) -> bool:
    """Whether evidence tells of a touch at any of the ticks, at any tick where they are not given."""
    ticks = rollout.tables["evidence"]["tick"].to_pylist() if ticks is None else ticks
    return any(row[0] for row in rows(rollout, "evidence", ticks, "collision"))


@pytest.mark.parametrize(("tick", "is_within"), [(BRANCH_TICK + 50, True), (BRANCH_TICK + 55, False)])
def test_a_best_candidate_may_collide(tmp_path: Path, tick: int, is_within: bool) -> None:
    clear = samples.replaced("collision", dict.fromkeys(NAMES, False))
    touch = samples.replaced("collision", dict.fromkeys(NAMES, True), lambda rows: rows["tick"].to_numpy() == tick)
    before, after = (
        samples.studied(tmp_path / name, {"evidence": edit}).overall
        for name, edit in (("a", clear), ("b", lambda table: touch(clear(table))))
    )
    gain = 2 / after.num_ranked  # both groups of the shard
    assert gain <= 1
    assert before.best_collided is not None and before.best_collided_in_window is not None
    assert after.best_collided == pytest.approx(before.best_collided + gain)
    assert after.best_collided_in_window == pytest.approx(before.best_collided_in_window + is_within * gain)


def test_population_is_counted(study: Study) -> None:
    population = study.population
    assert (population.num_groups, population.num_integrity_complete, population.num_without_nominal) == (3, 3, 0)
    assert population.scenario_types == {"CutIn": 3}
    assert population.towns == {"Town12": 2, "Town13": 1}
    assert population.num_route_clusters == 3
    assert population.attempts == {"complete": 46}
    assert population.num_ticks == 46 * NUM_TICKS


def test_collisions_are_those_of_the_evidence(root: Path, study: Study) -> None:
    dataset, bank = open_dataset(root), load_action_bank()
    ever, within = defaultdict(list), defaultdict(list)
    for group_id in dataset.groups:
        for key, rollout in candidates(dataset.group(group_id)).items():
            family = bank[key].family
            ever[family].append(any(rollout.tables["evidence"]["collision"].to_pylist()))
            within[family].append(any(row[0] for row in rows(rollout, "evidence", FUTURE, "collision")))
    assert study.overall.collided == {family: pytest.approx(np.mean(ever[family])) for family in FAMILIES}
    assert study.overall.collided_in_window == {family: pytest.approx(np.mean(within[family])) for family in FAMILIES}
    assert study.overall.collided_in_window["brake"] == pytest.approx(1 / 9)


def test_best_and_worst_families_are_those_of_a_second_ranking(root: Path, study: Study) -> None:
    dataset, bank = open_dataset(root), load_action_bank()
    outcomes = {
        group_id: {key: outcome(rollout) for key, rollout in candidates(dataset.group(group_id)).items()}
        for group_id in dataset.groups
    }
    columns = [
        [values[k] for bank_of in outcomes.values() for values in bank_of.values() if values[k] is not None]
        for k in range(1, 6)
    ]
    quantiles = [(float(np.quantile(c, 0.05)), float(np.quantile(c, 0.95))) for c in columns]  # type: ignore[arg-type]
    best, worst, num_ranked = dict.fromkeys(FAMILIES, 0.0), dict.fromkeys(FAMILIES, 0.0), 0
    touched: list[float] = []
    touched_within: list[float] = []
    for group_id, bank_of in outcomes.items():
        utilities = {key: balanced(values, quantiles) for key, values in bank_of.items()}
        if any(map(math.isnan, utilities.values())):
            continue
        num_ranked += 1
        for share, extreme in ((best, max(utilities.values())), (worst, min(utilities.values()))):
            tied = [key for key, value in utilities.items() if abs(value - extreme) <= 1e-9]
            for key in tied:
                share[bank[key].family] += 1 / len(tied)
        winners = [key for key, value in utilities.items() if abs(value - max(utilities.values())) <= 1e-9]
        for tally, ticks in ((touched, None), (touched_within, FUTURE)):
            for key in winners:
                tally.append(touches(candidates(dataset.group(group_id))[key], ticks) / len(winners))
    assert study.overall.num_ranked == num_ranked > 0
    assert study.overall.best_collided == pytest.approx(sum(touched) / num_ranked)
    assert study.overall.best_collided_in_window == pytest.approx(sum(touched_within) / num_ranked)
    for found, expected in ((study.overall.best, best), (study.overall.worst, worst)):
        assert found == {family: pytest.approx(share / num_ranked) for family, share in expected.items()}


def test_discrepancies_are_those_of_the_recorded_windows(root: Path, study: Study) -> None:
    dataset = open_dataset(root)
    ticks = list(range(BRANCH_TICK - 75, BRANCH_TICK + 1, 5))
    distances, steers = [], []
    for group_id in dataset.groups:
        group = dataset.group(group_id)
        for replay in group.replays:
            here, there = (rows(r, "observations", ticks, "x_m", "y_m") for r in (replay, group.nominal))
            distances.append(max(map(math.dist, here, there)))
            mine, own = (group.control_history(r)[:, 0].astype(float) for r in (replay, group.nominal))
            steers.append(float(np.abs(mine - own).max()))
    spreads = {spread.variable: spread for spread in study.nominal_replays}
    assert spreads["position_m"].num == len(distances) == 6
    for variable, values in (("position_m", distances), ("steer", steers)):
        assert spreads[variable].max == pytest.approx(max(values))
        assert spreads[variable].median == pytest.approx(sorted(values)[3])
        assert spreads[variable].q90 == pytest.approx(sorted(values)[5])
        assert spreads[variable].zero == pytest.approx(np.mean([value == 0 for value in values]))
    assert min(spreads[variable].max or 0 for variable in ("position_m", "steer")) > 0
    assert [spread.variable for spread in study.interventions] == list(spreads)
    assert study.interventions[0].num == 36  # twelve in each group


def test_replays_that_start_elsewhere_are_not_bit_equal(study: Study) -> None:
    assert (study.equality.num_replays, study.equality.num_compared, study.equality.num_equal) == (6, 6, 0)
    assert study.equality.differing["observations"] == 6
    assert study.equality.differing["actors"] == 0


def _copies() -> dict[str, samples.Edit]:
    """Edits that make the replays of group 0 repeat its nominal, the rows of one in another order."""
    nominal, replays = f"{group_name(0)}.nominal.a1", [f"{group_name(0)}.nominal_replay.a{n}" for n in (1, 2)]

    def repeated(table: pa.Table) -> pa.Table:
        kept = table.filter(pa.array([owner not in replays for owner in table["rollout_id"].to_pylist()]))
        own = table.filter(pa.array([owner == nominal for owner in table["rollout_id"].to_pylist()]))
        index = table.schema.get_field_index("rollout_id")
        renamed = [own.set_column(index, table.schema.field(index), pa.array([name] * len(own))) for name in replays]
        return pa.concat_tables([kept, renamed[0], renamed[1].take(list(range(len(own)))[::-1])])

    return dict.fromkeys(TICK_TABLES, repeated)


def test_replays_that_repeat_their_nominal_are_bit_equal_in_any_order_of_rows(tmp_path: Path) -> None:
    study = samples.studied(tmp_path / "dataset", _copies())
    assert (study.equality.num_compared, study.equality.num_equal) == (6, 2)
    assert {spread.variable: spread.zero for spread in study.nominal_replays}["position_m"] == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("observations", "route_offset_m", 0.125),
        ("controls", "expert_brake", 0.75),
        ("controls", "nominal_steer", 0.0),  # null in the nominal
        ("evidence", "lane_id", "elsewhere"),
        ("actors", "vel_x_mps", -0.0),  # 0 in the nominal
    ],
)
def test_one_other_bit_is_a_difference(tmp_path: Path, table: str, column: str, value: Any) -> None:
    edits = _copies()
    replay = f"{group_name(0)}.nominal_replay.a2"
    repeat, change = edits[table], samples.replaced(column, {replay: value}, samples.rows_at(replay, 10))
    if column == "vel_x_mps":
        nominal = f"{group_name(0)}.nominal.a1"
        zero = samples.replaced(column, {nominal: 0.0}, samples.rows_at(nominal, 10))
        edits[table] = lambda rows: change(repeat(zero(rows)))
    else:
        edits[table] = lambda rows: change(repeat(rows))
    study = samples.studied(tmp_path / "dataset", edits)
    assert study.equality.num_equal == 1
    assert study.equality.differing[table] == {"actors": 1}.get(table, 5)


def test_without_evidence_the_rest_is_still_told(tmp_path: Path) -> None:
    study = samples.studied(tmp_path / "dataset", document=bare_descriptor())
    assert study.population.num_integrity_complete == 3
    assert study.overall.completed == 0
    assert set(study.overall.collided.values()) == {None}
    assert (study.overall.num_ranked, set(study.overall.best.values())) == (0, {None})
    assert [spread.variable for spread in study.nominal_replays][-1] == "tick_offset"
    assert set(study.equality.differing) == {"controls", "observations"}


def test_results_that_are_not_monitored_soil_no_nominal(tmp_path: Path) -> None:
    nominals = [f"{group_name(index)}.nominal.a1" for index in (0, 1)]
    edits = {
        "rollouts": lambda table: samples.replaced(
            "result_num_vehicle_collisions", {nominals[0]: None, nominals[1]: 2}
        )(samples.replaced("result_completion", dict.fromkeys(nominals, "completed"))(table))
    }
    study = samples.studied(tmp_path / "dataset", edits)
    assert study.not_monitored == ("vehicle collisions", "stop signs")
    assert study.overall.completed == pytest.approx(2 / 3)
    assert study.overall.clean == pytest.approx(1 / 3)
