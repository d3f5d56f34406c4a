"""Faulty collections: a study skips and counts what it cannot use, and never fails."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.reference_impl.study import samples
from tests.reference_impl.study.samples import Edit, dropped, replaced, rows_at
from tests.sampling import sampled
from tests.synthetic import BRANCH_TICK, descriptor, group_name

from branchdrive.contract.columns import TICK_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.driving.discrepancy import CORE, EXTENDED
from branchdrive.driving.target import TARGETS
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.facts import Facts, shard_facts
from branchdrive_reference.study.summary import summarise

NOMINAL, BRAKE = f"{group_name(0)}.nominal.a1", f"{group_name(0)}.brake_1.00.a1"
TWICE, AGAIN = (f"{group_name(1)}.brake_0.50.a{attempt}" for attempt in (1, 2))


def doubled(rollout_id: str, tick: int) -> Edit:
    """Edit that repeats a row."""
    marks = rows_at(rollout_id, tick)
    return lambda table: pa.concat_tables([table, table.filter(pa.array(marks(table)))])


FAULTS: dict[str, tuple[Mapping[str, Edit], int, int]] = {
    # Edits, integrity-complete groups, groups without a compliant nominal.
    "no observation at t_b": ({"observations": dropped(rows_at(BRAKE, BRANCH_TICK))}, 2, 0),
    "no predecessor": ({"observations": dropped(rows_at(BRAKE, BRANCH_TICK - 80))}, 2, 0),
    "no last observation": ({"observations": dropped(rows_at(BRAKE, BRANCH_TICK + 50))}, 2, 0),
    "no evidence in the window": ({"evidence": dropped(rows_at(BRAKE, BRANCH_TICK + 25))}, 2, 0),
    "no control in the history": ({"controls": dropped(rows_at(BRAKE, BRANCH_TICK - 1))}, 2, 0),
    "an observation twice": ({"observations": doubled(BRAKE, BRANCH_TICK + 5)}, 2, 0),
    "an observation twice before the windows": ({"observations": doubled(BRAKE, 10)}, 2, 0),
    "a control twice in the active window": ({"controls": doubled(BRAKE, BRANCH_TICK + 7)}, 2, 0),
    "active one tick too long": (
        {"controls": replaced("active", {BRAKE: True}, rows_at(BRAKE, BRANCH_TICK + 50))}, 2, 0,
    ),
    "active one tick too short": (
        {"controls": replaced("active", {BRAKE: False}, rows_at(BRAKE, BRANCH_TICK + 49))}, 2, 0,
    ),
    "active one tick late": (
        {
            "controls": lambda table: replaced("active", {BRAKE: False}, rows_at(BRAKE, BRANCH_TICK))(
                replaced("active", {BRAKE: True}, rows_at(BRAKE, BRANCH_TICK + 50))(table)
            )
        }, 2, 0,
    ),
    "an active nominal": ({"controls": replaced("active", {NOMINAL: True}, rows_at(NOMINAL, 3))}, 2, 1),
    "an attempt that ended early": ({"rollouts": replaced("status", {BRAKE: "partial"})}, 2, 0),
    "a nominal that ended early": ({"rollouts": replaced("status", {NOMINAL: "partial"})}, 2, 1),
    "another branch tick": ({"rollouts": replaced("branch_tick", {BRAKE: BRANCH_TICK + 5})}, 2, 0),
    "a branch one observation later": (
        {
            "rollouts": replaced("branch_tick", {BRAKE: BRANCH_TICK + 5}),
            "controls": lambda table: replaced(
                "active", {BRAKE: False}, rows_at(BRAKE, *range(BRANCH_TICK, BRANCH_TICK + 5))
            )(replaced("active", {BRAKE: True}, rows_at(BRAKE, *range(BRANCH_TICK + 50, BRANCH_TICK + 55)))(table)),
        }, 2, 0,
    ),
    "no branch": ({"rollouts": replaced("branch_tick", {BRAKE: None})}, 2, 0),
    "a branch at tick 0": ({"rollouts": replaced("branch_tick", {NOMINAL: 0})}, 2, 1),
    "a branch beyond the end": ({"rollouts": replaced("branch_tick", {NOMINAL: 1_000_000})}, 2, 1),
    "a nominal that nobody has": ({"rollouts": replaced("nominal_rollout_id", {BRAKE: "nobody"})}, 2, 0),
    "another attempt as nominal": ({"rollouts": replaced("nominal_rollout_id", {BRAKE: AGAIN})}, 2, 0),
    "an action that the bank lacks": ({"rollouts": replaced("action_key", {BRAKE: "hop"})}, 2, 0),
    "an unknown role": ({"rollouts": replaced("role", {NOMINAL: "guest"})}, 2, 1),
    "the first of two attempts is bad": ({"controls": dropped(rows_at(TWICE, BRANCH_TICK))}, 3, 0),
    "both attempts are bad": (
        {"controls": lambda t: dropped(rows_at(TWICE, BRANCH_TICK))(dropped(rows_at(AGAIN, BRANCH_TICK))(t))}, 2, 0,
    ),
    "no route": ({"rollouts": replaced("route_x_m", {NOMINAL: []})}, 2, 1),
    "a route of another length": ({"rollouts": replaced("route_y_m", {NOMINAL: [0.0, 1.0, 2.0]})}, 2, 1),
    "a rollout without rows": ({"observations": dropped(rows_at(NOMINAL)), "controls": dropped(rows_at(BRAKE))}, 2, 1),
    "no observations at all": ({"observations": lambda table: table[:0]}, 1, 2),
    "no controls at all": ({"controls": lambda table: table[:0]}, 1, 2),
    "no evidence at all": ({"evidence": lambda table: table[:0]}, 1, 2),
    "no actors at all": ({"actors": lambda table: table[:0]}, 1, 2),
    "no rollouts in a shard": ({"rollouts": lambda table: table[:0]}, 1, 0),
    "a place that is not a number": (
        {"observations": replaced("x_m", {BRAKE: float("nan")}, rows_at(BRAKE, BRANCH_TICK + 5))}, 2, 0,
    ),
    "a speed beyond all numbers": ({"observations": replaced("speed_mps", {BRAKE: float("inf")})}, 2, 0),
    "rows of nobody": ({"controls": replaced("rollout_id", {BRAKE: "nobody"})}, 2, 0),
}  # fmt: skip


@pytest.mark.parametrize(("edits", "good", "without_nominal"), sampled(FAULTS.values(), every=5), ids=FAULTS)
def test_a_fault_is_skipped_and_counted(
    tmp_path: Path, edits: Mapping[str, Edit], good: int, without_nominal: int
) -> None:
    study = samples.studied(tmp_path / "dataset", edits)
    assert (study.population.num_integrity_complete, study.population.num_without_nominal) == (good, without_nominal)
    assert study.overall.num_groups == good
    assert json.loads(json.dumps(study.to_json(), allow_nan=False))["population"]["num_integrity_complete"] == good


DESCRIPTOR = Descriptor.model_validate(descriptor())


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> Facts:
    """What the shards of a sound dataset contribute."""
    dataset = open_dataset(samples.written(tmp_path_factory.mktemp("facts") / "dataset"))
    views = [
        ShardView({name: shard.decode(name) for name in DESCRIPTOR.tables}, DESCRIPTOR) for shard in dataset.shards
    ]
    return Facts.merged([shard_facts(view) for view in views])


BOTH = {"rollouts": replaced("status", {TWICE: "partial", AGAIN: "partial"})}


@pytest.mark.parametrize(
    ("edits", "without_complete", "noncompliant"),
    [
        ({}, 0, 0),
        (BOTH, 1, 0),
        ({"observations": dropped(rows_at(BRAKE, BRANCH_TICK))}, 0, 1),
        ({**BOTH, "observations": dropped(rows_at(BRAKE, BRANCH_TICK))}, 1, 1),
        ({"rollouts": replaced("status", {TWICE: "partial"})}, 0, 0),
        ({"rollouts": replaced("action_key", {BRAKE: "hop"})}, 1, 0),
        ({"rollouts": replaced("branch_tick", {NOMINAL: None})}, 0, 1),
    ],
    ids=["none", "partial", "truncated", "both", "retried", "another action", "no branch"],
)
def test_a_skipped_group_has_one_reason(
    tmp_path: Path, edits: Mapping[str, Edit], without_complete: int, noncompliant: int
) -> None:
    population = samples.studied(tmp_path / "dataset", edits).population
    assert (population.num_without_complete, population.num_noncompliant) == (without_complete, noncompliant)
    assert population.num_integrity_complete == population.num_groups - without_complete - noncompliant


def test_a_group_without_separation_leaves_the_ranking_alone(facts: Facts) -> None:
    targets = facts.banks.targets.copy()
    whole = summarise(facts, DESCRIPTOR)
    targets[0, 3, [target.name for target in TARGETS].index("min_separation_m")] = np.nan
    lacking = summarise(replace(facts, banks=replace(facts.banks, targets=targets)), DESCRIPTOR)
    assert lacking.overall.num_groups == whole.overall.num_groups
    assert lacking.overall.num_ranked == whole.overall.num_ranked - 1


def test_a_group_with_a_bad_nominal_is_compared_with_nothing(tmp_path: Path) -> None:
    study = samples.studied(tmp_path / "dataset", {"observations": dropped(rows_at(NOMINAL, BRANCH_TICK - 30))})
    assert (study.interventions[0].num, study.nominal_replays[0].num) == (24, 4)
    assert study.equality.num_compared == 6
    assert study.equality.differing["observations"] == 6


def test_what_one_side_lacks_is_told_apart(facts: Facts) -> None:
    names = [variable.name for variable in (*CORE, *EXTENDED)]
    replays = facts.fidelity.replays.copy()
    replays[0, names.index("vehicle_gap_m")] = np.inf
    study = summarise(replace(facts, fidelity=replace(facts.fidelity, replays=replays)), DESCRIPTOR)
    gap = next(spread for spread in study.nominal_replays if spread.variable == "vehicle_gap_m")
    assert (gap.max, gap.num_infinite) == (None, 1)
    assert gap.median is not None


@pytest.mark.parametrize("seed", sampled(range(6), every=4))
def test_any_mixture_of_lost_rows_is_survived(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)

    def thinned(table: pa.Table) -> Any:
        kept = rng.random(len(table)) > rng.choice([1e-3, 0.2, 0.9])
        return table.filter(pa.array(kept)).take(rng.permutation(int(kept.sum())))

    edits = {name: thinned for name in ("rollouts", *TICK_TABLES) if rng.random() < 0.7}
    study = samples.studied(tmp_path / "dataset", edits)
    assert 1 <= study.population.num_integrity_complete <= study.population.num_groups
