"""Replay fidelity of a release: analytic thresholds, who passes, and the retention that the paper reports."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.validator.quality.release import (
    ACTIONS,
    DIGEST,
    concat,
    numbered,
    pairs_of,
    paper_groups,
    paper_pairs,
    reaching,
    shuffled,
    texts,
)
from tests.validator.quality.whole import retention_document, threshold_document

from branchdrive.contract.document import dump_json, parse_json
from branchdrive.quality.fidelity import (
    bank_rows,
    thresholds_of,
    with_passes,
    with_validity,
)
from branchdrive.quality.partition import assignment_of
from branchdrive.quality.threshold import VARIABLES
from branchdrive.statistics.split import split_digest
from branchdrive.tables.frame import sort_rows, take

Table = dict[str, Any]


def small_groups(**sizes: int) -> Table:
    """Eligible groups by partition, and one training group that is integrity-complete but not eligible."""
    sizes = sizes or {"train": 6, "val": 3, "test": 3}
    parts = [reaching(name, 4, count, name) for name, count in sizes.items()]
    return numbered(concat([*parts, reaching("unfit", 3, 1, "train"), reaching("lost", 1, 2)]))


def noisy(groups: Table, seed: int = 0) -> Table:
    pairs = pairs_of(groups)
    rng = np.random.default_rng(seed)
    for variable in VARIABLES:
        pairs[variable.name][:] = rng.uniform(size=len(pairs["group_id"]))
    pairs["tick_offset"][:] = 0
    return pairs


def of_group(pairs: Table, prefix: str) -> Any:
    return np.array([group_id.startswith(prefix) for group_id in pairs["group_id"]])


def value(document: Table, name: str) -> Any:
    return next(v["value"] for v in document["variables"] if v["name"] == name)


def retained(pairs: Table, groups: Table, seed: int = 1) -> Table:
    return retention_document(pairs, groups, thresholds_digest=DIGEST, split_digest=DIGEST, seed=seed)


def test_a_threshold_is_the_higher_order_statistic_of_group_maxima() -> None:
    groups = numbered(reaching("train", 4, 200, "train"))
    pairs = pairs_of(groups)
    pairs["position_m"][:] = np.repeat(np.arange(200.0), len(ACTIONS))
    pairs["position_m"][::2] = 0
    document = threshold_document(pairs, groups)
    assert value(document, "position_m") == 198  # ceil(0.99 * 199) = 198 of 0 .. 199
    assert value(document, "tick_offset") == 0
    assert document["num_groups"] == 200
    assert [v["criterion"] for v in document["variables"]] == ["core"] * 7 + ["extended"] * 5
    assert document["split_digest"] == split_digest(assignment_of(groups))


@pytest.mark.parametrize(("support", "judged"), [(99, False), (100, True)])
def test_the_pedestrian_gap_is_judged_from_100_supporting_groups_on(support: int, judged: bool) -> None:
    groups = numbered(reaching("train", 4, 120, "train"))
    pairs = pairs_of(groups)
    pairs["pedestrian_gap_m"][:] = 2.5
    pairs["has_pedestrian"][: support * len(ACTIONS)] = True
    document = threshold_document(pairs, groups)
    assert document["pedestrian_support"] == support
    assert document["variables"][-1] == {
        "name": "pedestrian_gap_m", "unit": "m", "criterion": "extended", "judged": judged,
        "floor": 0.002, "value": 2.5 if judged else None,
    }  # fmt: skip


def test_a_threshold_that_is_not_finite_is_null_and_lets_finite_discrepancies_pass() -> None:
    groups = small_groups()
    pairs = noisy(groups)
    pairs["vehicle_gap_m"][of_group(pairs, "train")] = np.ma.masked
    document = threshold_document(pairs, groups)
    assert value(document, "vehicle_gap_m") is None
    assert parse_json(dump_json(document)) == document
    pairs["vehicle_gap_m"][of_group(pairs, "val")] = 1e9
    for name in (variable.name for variable in VARIABLES):
        pairs[name][of_group(pairs, "val")] = 1e9 if name == "vehicle_gap_m" else 0
    passed = with_passes(pairs, thresholds_of(document))
    assert not passed["extended_pass"][of_group(pairs, "train")].any()
    assert passed["extended_pass"][of_group(pairs, "val")].all()


@settings(max_examples=20)
@given(st.integers(0, 2**32), st.sampled_from(["val", "test", "unfit"]), st.sampled_from(VARIABLES))
def test_thresholds_are_of_eligible_training_groups_only(seed: int, other: str, variable: Any) -> None:
    groups = small_groups()
    pairs = noisy(groups)
    document = threshold_document(pairs, groups)
    changed = noisy(groups)
    changed[variable.name][of_group(changed, other)] = np.random.default_rng(seed).uniform(0, 1e6)
    changed["has_pedestrian"][of_group(changed, other)] = True
    assert threshold_document(changed, groups) == document
    assert threshold_document(take(changed, ~of_group(changed, other)), groups) == document


def test_thresholds_depend_on_training_groups() -> None:
    groups = small_groups()
    pairs = noisy(groups)
    before = threshold_document(pairs, groups)
    pairs["steer"][of_group(pairs, "train")] += 1
    assert value(threshold_document(pairs, groups), "steer") == value(before, "steer") + 1


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_the_order_of_the_rows_decides_nothing(order: int) -> None:
    groups = small_groups()
    pairs = noisy(groups)
    document = threshold_document(pairs, groups)
    other_pairs, other_groups = shuffled(pairs, order), shuffled(groups, order + 1)
    assert threshold_document(other_pairs, other_groups) == document
    passed, other = (with_passes(p, thresholds_of(document)) for p in (pairs, other_pairs))
    assert retained(other, other_groups) == retained(passed, groups)
    valid, others = with_validity(groups, passed), with_validity(other_groups, other)
    for name in ("core_valid", "extended_valid"):
        assert sort_rows(others, ["group_id"])[name].tolist() == sort_rows(valid, ["group_id"])[name].tolist()


def test_thresholds_come_back_from_the_stored_document() -> None:
    groups = small_groups()
    document = threshold_document(noisy(groups), groups)
    found = thresholds_of(parse_json(dump_json(document)))
    assert np.array_equal(found.values, thresholds_of(document).values, equal_nan=True)
    assert found.num_groups == 6
    assert found.judged.tolist() == [True] * 11 + [False]


def test_thresholds_of_other_variables_are_refused() -> None:
    groups = small_groups()
    document = threshold_document(noisy(groups), groups)
    with pytest.raises(ValueError, match="thresholds of"):
        thresholds_of({**document, "variables": document["variables"][::-1]})


def test_nominal_replays_are_judged_but_decide_nothing() -> None:
    groups = small_groups()
    pairs = noisy(groups)
    replay = take(pairs, np.arange(1))
    replay |= {"kind": texts(["nominal_replay"]), "rollout_id": texts(["replay"]), "position_m": np.array([1e6])}
    both = concat([pairs, replay])
    document = threshold_document(both, groups)
    assert document == threshold_document(pairs, groups)
    passed = with_passes(both, thresholds_of(document))
    assert not passed["core_pass"][-1]
    alone = with_passes(pairs, thresholds_of(document))
    assert with_validity(groups, passed)["core_valid"].tolist() == with_validity(groups, alone)["core_valid"].tolist()
    assert retained(passed, groups) == retained(alone, groups)


def test_a_group_is_valid_if_eligible_and_every_pair_passes() -> None:
    groups = small_groups()
    pairs = pairs_of(groups)
    pairs["brake"][np.flatnonzero(of_group(pairs, "val-0001"))[4]] = 1
    pairs["actor_count_share"][np.flatnonzero(of_group(pairs, "test-0000"))[11]] = 1
    passed = with_passes(pairs, thresholds_of(threshold_document(pairs, groups)))
    found = with_validity(groups, passed)
    ids = found["group_id"]
    eligible = ids[groups["eligible"]].tolist()
    assert set(ids[found["core_valid"]]) == {*eligible} - {"val-0001"}
    assert set(ids[found["extended_valid"]]) == {*eligible} - {"val-0001", "test-0000"}
    assert "unfit-0000" not in ids[found["core_valid"]]


def test_no_eligible_training_group_is_refused() -> None:
    groups = small_groups(val=2, test=2)
    with pytest.raises(ValueError, match="no training group is structurally eligible"):
        threshold_document(pairs_of(groups), groups)


BROKEN: dict[str, tuple[Any, str]] = {
    "a group without pairs": (lambda p: take(p, ~of_group(p, "train-0002")), "'train-0002' has no pair"),
    "a pair is missing": (lambda p: take(p, np.arange(len(p["group_id"])) != 13), "'train-0001' one alone has a pair"),
    "a pair twice": (lambda p: concat([p, take(p, np.array([3]))]), "'train-0000' has two pairs of the action"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_bank_that_is_not_whole_is_refused(case: str) -> None:
    groups = small_groups()
    edit, message = BROKEN[case]
    pairs = edit(with_passes(pairs_of(groups), thresholds_of(threshold_document(pairs_of(groups), groups))))
    for call in (threshold_document, retained, lambda p, g: with_validity(g, p)):
        with pytest.raises(ValueError, match=message):
            call(pairs, groups)


def test_rows_of_a_bank_follow_the_sorted_actions() -> None:
    groups = small_groups()
    pairs = shuffled(pairs_of(groups), 3)
    rows = bank_rows(pairs, ["val-0001", "train-0000"])
    assert [pairs["group_id"][row].tolist() for row in rows] == [["val-0001"] * 12, ["train-0000"] * 12]
    assert [pairs["action_key"][row].tolist() for row in rows] == [ACTIONS, ACTIONS]
    assert bank_rows(pairs, []).shape == (0, 0)


def test_retention_is_that_of_the_paper() -> None:
    groups = paper_groups()
    document = retained(paper_pairs(groups), groups)
    found = {(r["criterion"], r["partition"], r["unit"]): r for r in document["rows"]}
    shares = {key: (row["num_passed"], row["num_units"], row["met"]) for key, row in found.items()}
    assert shares["core", "val", "pair"] == (1116, 1140, False)
    assert shares["core", "val", "bank"] == (88, 95, True)
    assert shares["core", "test", "pair"] == (1078, 1140, False)
    assert shares["core", "test", "bank"] == (87, 95, True)
    assert shares["extended", "test", "pair"] == (1067, 1140, False)
    assert shares["extended", "test", "bank"] == (85, 95, False)
    bank = found["core", "test", "bank"]
    assert (bank["low"], bank["high"]) == pytest.approx((0.8629, 0.9684), abs=0.011)
    assert [r["partition"] for r in document["rows"]] == ["train", "train", "val", "val", "test", "test"] * 2
    assert (document["level"], document["num_resamples"], document["seed"]) == (0.95, 2000, 1)
    assert parse_json(dump_json(document)) == document


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_retention_counts_add_up(seed: int) -> None:
    groups = small_groups(train=5, val=2, test=3, calibration=2)
    pairs = noisy(groups, seed)
    rng = np.random.default_rng(seed)
    pairs["core_pass"] = rng.uniform(size=len(pairs["group_id"])) < 0.9
    pairs["extended_pass"] = pairs["core_pass"] & (rng.uniform(size=len(pairs["group_id"])) < 0.9)
    rows = retained(pairs, groups)["rows"]
    for criterion in ("core", "extended"):
        of_pairs = [r for r in rows if (r["criterion"], r["unit"]) == (criterion, "pair")]
        assert [r["partition"] for r in of_pairs] == ["train", "val", "test", "calibration"]
        assert sum(r["num_passed"] for r in of_pairs) == pairs[f"{criterion}_pass"].sum()
        assert sum(r["num_units"] for r in of_pairs) == len(pairs["group_id"])
        assert sum(r["num_groups"] for r in of_pairs) == groups["integrity_complete"].sum()
    assert all(r["low"] <= r["share"] <= r["high"] for r in rows if r["unit"] == "pair")
    assert all(r["met"] == (r["share"] >= r["target"]) for r in rows)


def test_without_partitions_nothing_is_retained() -> None:
    groups = reaching("lost", 1, 2)
    pairs = take(noisy(small_groups()), np.zeros(0, int)) | {
        "core_pass": np.zeros(0, bool),
        "extended_pass": np.zeros(0, bool),
    }
    assert retained(pairs, groups)["rows"] == []
