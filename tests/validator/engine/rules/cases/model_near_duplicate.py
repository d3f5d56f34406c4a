"""Defects and limits of near duplicates across partitions."""

from __future__ import annotations

import numpy as np
from tests.synthetic_release import NEAR_DUPLICATE
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.model_inputs import TEST, TRAIN, VAL
from tests.validator.engine.rules.cases.model_inputs_features import NORMALISATION
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.model.near_duplicate import Histories, duplicates_among
from branchdrive.release.stage import BuildOptions


def copy_history(d: ReleaseDraft, group: str, model: str) -> None:
    """Give a group the history of another; for a base without raw, or within one partition's tolerance."""
    for table in ("state", "past_controls"):
        frame = {column: values.copy() for column, values in d.frame(table).items()}
        for column, values in frame.items():
            if column not in ("group_id", "partition", "offset_ticks"):
                values[frame["group_id"] == group] = values[frame["group_id"] == model]
        d.put(table, frame)


def bring_near(d: ReleaseDraft, group: str, model: str, share: float) -> None:
    """Bring the history of a group to a share of the threshold of near duplicates before that of another."""
    contexts = d.frame("contexts")
    homes = dict(zip(contexts["group_id"].tolist(), contexts["partition"].tolist(), strict=True))
    assert "train" not in (homes[group], homes[model])
    copy_history(d, group, model)
    histories = Histories.of(d.frame("state"), d.frame("past_controls"), sorted(homes))
    threshold = duplicates_among(histories, homes).threshold
    (entry,) = (e for e in d.documents[NORMALISATION]["state"] if e["feature"] == "route_offset_m")
    step = share * threshold * entry["scale"]
    d.set("state", "route_offset_m", lambda value: value + step, group_id=group, offset_ticks=0)


@boundary("BD-MOD-020", base="alone")
def near_duplicates_inside_a_partition(d: ReleaseDraft) -> None:
    copy_history(d, "g13", TEST)


@boundary("BD-MOD-020", base="alone")
def distance_just_below_the_threshold(d: ReleaseDraft) -> None:
    bring_near(d, VAL, TEST, 1 - 1e-10)


# BD-MOD-020: near duplicates


@mutant("BD-MOD-020", at={"table": "contexts", "group_id": "g13"}, base="alone", findings=2)
def context_that_repeats_a_training_context(d: ReleaseDraft) -> None:
    copy_history(d, "g13", TRAIN)


@mutant("BD-MOD-020", at={"table": "contexts", "group_id": VAL}, base="alone", findings=2)
def validation_context_that_repeats_a_test_context(d: ReleaseDraft) -> None:
    copy_history(d, VAL, TEST)


@mutant("BD-MOD-020", at={"table": "contexts", "group_id": VAL}, base="alone", findings=2)
def distance_below_the_threshold_by_more_than_last_bits(d: ReleaseDraft) -> None:
    bring_near(d, VAL, TEST, 1 - 1e-6)


@mutant("BD-MOD-020", at={"table": "contexts", "group_id": NEAR_DUPLICATE[1]}, base="alone", findings=2)
def near_duplicate_kept_and_not_marked(d: ReleaseDraft) -> None:
    d.set("group_quality", "near_duplicate", False, group_id=NEAR_DUPLICATE[1])
    d.reseal("population")


# BD-SPL-007


@mutant("BD-SPL-007", at={"group_id": NEAR_DUPLICATE[1], "column": "near_duplicate"})
def near_duplicate_let_through(d: ReleaseDraft) -> None:
    d.set("group_quality", "near_duplicate", False, group_id=NEAR_DUPLICATE[1])
    d.reseal("population")


@mutant("BD-SPL-007", at={"group_id": "g13", "column": "near_duplicate"})
def unwelcome_group_called_a_near_duplicate(d: ReleaseDraft) -> None:
    d.set("group_quality", "near_duplicate", True, group_id="g13")
    d.reseal("population")


@boundary("BD-SPL-007", "BD-MOD-020")
def group_that_repeats_another_within_its_partition(d: ReleaseDraft) -> None:
    """With this seed both are in training, and none of them is marked."""
    d.rebuild(BuildOptions(seed=12))
    groups = d.frame("group_quality")
    assert set(groups["partition"][np.isin(groups["group_id"], NEAR_DUPLICATE)]) == {"train"}
    assert not groups["near_duplicate"].any()
