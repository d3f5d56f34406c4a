"""What thresholds filter: counts of failing pairs, thresholds over what nominals move, and the sentences on both."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.validator.quality.release import NUM_POLICIES, concat, numbered, pairs_of, reaching, shuffled
from tests.validator.quality.whole import filtering_document, retention_document, threshold_document

from branchdrive.contract.document import schema_mismatches
from branchdrive.quality.fidelity import (
    fitting_groups,
    largest_of,
    passing_counts,
    retention_document_of,
    threshold_document_of,
    thresholds_of,
    with_passes,
)
from branchdrive.quality.filtering import (
    FilterFigures,
    filtering_document_of,
    mean_share,
    shares_above,
)
from branchdrive.quality.partition import assignment_of
from branchdrive.quality.replay_frames import FRAMED, MATCHED
from branchdrive.quality.text import filtering_sentences
from branchdrive.quality.threshold import VARIABLES
from branchdrive.statistics.split import split_digest
from branchdrive.tables.frame import take

NUM_ACTIONS = NUM_POLICIES - 1
GROUPS = numbered(
    concat([reaching("train", 6, 20, "train"), reaching("val", 6, 3, "val"), reaching("test", 6, 4, "test")])
)


def pairs(**values: dict[str, float]) -> Any:
    """Identical replays, but for the largest differences of a variable by rollout."""
    found = pairs_of(GROUPS)
    for name, differences in values.items():
        for rollout, value in differences.items():
            found[name][found["rollout_id"] == rollout] = value
    return with_passes(found, thresholds_of(threshold_document(found, GROUPS)))


def frames(found: Any, **columns: Any) -> Any:
    """Frames of replays that move by 2 in every variable and never differ."""
    count = len(found["rollout_id"])
    return {
        "rollout_id": found["rollout_id"],
        **{f"above_{name}": np.zeros(count) for name in FRAMED},
        **{f"variation_{name}": np.full(count, 2.0) for name in FRAMED},
        **{f"largest_{name}": np.zeros(count) for name in MATCHED},
        **columns,
    }


def filtering(found: Any, **columns: Any) -> dict[str, Any]:
    thresholds = threshold_document(found, GROUPS)
    return filtering_document(found, GROUPS, frames(found, **columns), thresholds)


def variables(document: dict[str, Any]) -> dict[str, Any]:
    return {variable["name"]: variable for variable in document["variables"]}


WIDE = {"train-0003.action_00": 0.5, "val-0001.action_02": 0.9}
"""A training replay that sets a threshold of 0.5, and another one beyond it."""


def test_document_conforms_and_names_every_variable_in_order() -> None:
    found = filtering(pairs(throttle=WIDE))
    assert schema_mismatches(found, "filtering.schema.json") == []
    assert [v["name"] for v in found["variables"]] == [*(variable.name for variable in VARIABLES), *MATCHED]
    assert (found["num_groups"], found["num_pairs"]) == (20, 27 * NUM_ACTIONS)


def test_a_threshold_filters_where_a_pair_fails_by_it_alone() -> None:
    throttle = variables(filtering(pairs(throttle=WIDE)))["throttle"]
    assert (throttle["threshold"], throttle["num_failing"], throttle["num_failing_alone"]) == (0.5, 1, 1)
    assert throttle["over_variation"] == 0.25
    assert throttle["filters"] is True


def test_a_threshold_that_no_pair_fails_alone_filters_nothing() -> None:
    both = pairs(throttle=WIDE, brake={"train-0003.action_00": 0.1, "val-0001.action_02": 0.9})
    found = filtering(both)
    for name in ("throttle", "brake"):
        assert (variables(found)[name]["num_failing"], variables(found)[name]["num_failing_alone"]) == (1, 0)
        assert variables(found)[name]["filters"] is False
    assert "The threshold of `throttle`, 0.5, filters nothing: no pair fails by it alone." in filtering_sentences(found)


def test_a_threshold_as_large_as_what_nominals_move_filters_nothing() -> None:
    found_pairs = pairs(throttle=WIDE)
    moves = np.full(len(found_pairs["rollout_id"]), 0.4)
    found = filtering(found_pairs, variation_throttle=moves)
    assert variables(found)["throttle"]["over_variation"] == pytest.approx(1.25)
    assert variables(found)["throttle"]["filters"] is False
    sentence = "The threshold of `throttle`, 0.5, filters nothing: it is 1.2 times what nominals move in the window."
    assert sentence in filtering_sentences(found)


def test_a_threshold_at_its_floor_filters_whatever_is_no_noise() -> None:
    found = variables(filtering(pairs()))
    assert all(variable["filters"] is True for variable in found.values() if variable["decides"])
    assert found["pedestrian_gap_m"]["filters"] is None  # without support it is not judged


def test_figures_are_of_eligible_training_groups_alone() -> None:
    found_pairs = pairs(throttle=WIDE)
    is_training = np.array([rollout.startswith("train") for rollout in found_pairs["rollout_id"]])
    above = np.where(is_training, 0.25, 1.0)
    above[found_pairs["rollout_id"] == "train-0007.action_05"] = 0.75
    moves = np.where(is_training, 3.0, 100.0)
    throttle = variables(filtering(found_pairs, above_throttle=above, variation_throttle=moves))["throttle"]
    assert throttle["mean_share_above"] == pytest.approx(0.25 + 0.5 / (20 * NUM_ACTIONS))
    assert (throttle["share_above"], throttle["variation"]) == (0.75, 3.0)


def test_what_is_not_known_is_null() -> None:
    found_pairs = pairs(throttle=WIDE)
    nothing = np.full(len(found_pairs["rollout_id"]), np.nan)
    found = variables(filtering(found_pairs, variation_throttle=nothing, variation_brake=nothing * 0 + 0.0))
    assert found["throttle"]["variation"] is found["throttle"]["over_variation"] is None
    assert found["throttle"]["filters"] is True
    assert found["tick_offset"]["mean_share_above"] is found["actor_count_share"]["variation"] is None
    still = variables(filtering(found_pairs, variation_throttle=np.zeros(len(nothing))))["throttle"]
    assert (still["variation"], still["over_variation"]) == (0.0, None)


def test_a_matched_vehicle_decides_nothing_and_has_a_threshold_of_its_own() -> None:
    found_pairs = pairs(vehicle_rel_speed_mps={"train-0003.action_00": 25.0})
    largest = np.zeros(len(found_pairs["rollout_id"]))
    largest[found_pairs["rollout_id"] == "train-0009.action_01"] = 0.75
    largest[found_pairs["rollout_id"] == "val-0002.action_01"] = np.inf
    found = filtering(found_pairs, largest_matched_vehicle_rel_speed_mps=largest)
    matched = variables(found)["matched_vehicle_rel_speed_mps"]
    assert (matched["threshold"], matched["decides"], matched["filters"]) == (0.75, False, None)
    assert (matched["num_failing"], matched["num_failing_alone"], matched["num_unmatched"]) == (1, None, 1)
    (sentence,) = (s for s in filtering_sentences(found) if s.startswith("`vehicle_rel_speed_mps`"))
    assert (
        "at 25 m/s; of the same vehicle, matched by actor, the threshold would be 0.75 m/s, with 1 of 324" in sentence
    )


def test_a_matched_vehicle_that_changes_nothing_is_not_told() -> None:
    assert not [said for said in filtering_sentences(filtering(pairs())) if "matched by actor" in said]


def test_an_unmatched_training_group_leaves_an_infinite_threshold_null() -> None:
    found_pairs = pairs()
    largest = np.zeros(len(found_pairs["rollout_id"]))
    largest[found_pairs["rollout_id"] == "train-0009.action_01"] = np.inf
    matched = variables(filtering(found_pairs, largest_matched_vehicle_gap_m=largest))["matched_vehicle_gap_m"]
    assert matched["threshold"] is matched["over_variation"] is None
    assert matched["num_unmatched"] == 1


def test_the_order_of_rows_decides_nothing_and_a_missing_row_is_named() -> None:
    found_pairs = pairs(throttle=WIDE)
    thresholds = threshold_document(found_pairs, GROUPS)
    here = filtering_document(found_pairs, GROUPS, frames(found_pairs), thresholds)
    assert filtering_document(shuffled(found_pairs, 1), GROUPS, shuffled(frames(found_pairs), 2), thresholds) == here
    fewer = {name: values[1:] for name, values in frames(found_pairs).items()}
    with pytest.raises(ValueError, match=r"the pair of 'train-0000\.action_00' has no frames"):
        filtering_document(found_pairs, GROUPS, fewer, thresholds)


def test_parts_give_the_document_of_all_groups() -> None:
    found, others = pairs(throttle=WIDE), np.random.default_rng(1)
    count = len(found["rollout_id"])
    every = frames(
        found,
        above_steer=others.integers(0, 81, count) / 80,
        variation_speed_mps=np.where(others.random(count) < 0.2, np.nan, others.random(count)),
        largest_matched_vehicle_gap_m=others.random(count),
    )
    thresholds, assignment = threshold_document(found, GROUPS), assignment_of(GROUPS)
    training = fitting_groups(GROUPS, assignment)
    halves = [sorted(assignment)[::2], [], sorted(assignment)[1::2]]
    fitted = [[group for group in training if group in half] for half in halves]
    parts = [take(found, np.isin(found["group_id"], half)) for half in halves]
    above = [shares_above(p, every, f) for p, f in zip(parts, fitted, strict=True)]
    figures = [
        FilterFigures.of(p, every, a, f, half, thresholds)
        for p, a, f, half in zip(parts, above, fitted, halves, strict=True)
    ]
    gathered = np.concatenate([above[0], above[2]])[np.argsort(fitted[0] + fitted[2])]
    means = [mean_share(gathered[:, i]) for i in range(len(FRAMED))]
    digest = split_digest(assignment)
    assert filtering_document_of(figures, means, thresholds, digest) == filtering_document(
        found, GROUPS, every, thresholds
    )


def test_parts_give_the_thresholds_and_retention_of_all_groups() -> None:
    found = pairs(throttle=WIDE)
    assignment = assignment_of(GROUPS)
    training, digest = fitting_groups(GROUPS, assignment), split_digest(assignment)
    parts = [largest_of(found, training[1::2]), largest_of(found, []), largest_of(found, training[::2])]
    assert threshold_document_of(parts, digest) == threshold_document(found, GROUPS)
    order = [*assignment][1::2], [*assignment][::2]
    counts = np.concatenate([passing_counts(found, groups).values for groups in order])
    homes = [assignment[group] for groups in order for group in groups]
    options: dict[str, Any] = {"thresholds_digest": digest, "split_digest": digest, "seed": 3}
    assert retention_document_of(counts, homes, **options) == retention_document(found, GROUPS, **options)


def test_parts_of_different_banks_have_no_thresholds() -> None:
    found = pairs()
    training = fitting_groups(GROUPS, assignment_of(GROUPS))
    fewer = take(found, found["action_key"] != found["action_key"][0])
    with pytest.raises(ValueError, match="of two groups one alone has a pair of 'action_00'"):
        threshold_document_of([largest_of(found, training[:3]), largest_of(fewer, training[3:])], "")
