"""Defects and limits of features, normalisation and near duplicates of the model layer."""

from __future__ import annotations

from tests.synthetic_release import NEAR_DUPLICATE
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.model import TEST, TRAIN, VAL, within
from tests.validator.engine.rules.release import SPLIT, ReleaseDraft

from branchdrive.contract.descriptor import Descriptor
from branchdrive.model.arrays import ModelArrays, pack_arrays
from branchdrive.model.near_duplicate import duplicates_among
from branchdrive.model.normalisation_document import normalisation_document
from branchdrive.quality.partition import assignment_of

FEATURES, NORMALISATION = "model/features.json", "model/normalisation.json"
TABLES = ("state", "past_controls", "expert", "surroundings", "actions", "scalars", "trajectories")


def arrays(d: ReleaseDraft) -> ModelArrays:
    """Arrays of the layer as it is now."""
    groups = sorted(d.frame("contexts")["group_id"].tolist())
    return pack_arrays(
        {name: d.frame(name) for name in TABLES}, groups, Descriptor.model_validate(d.descriptor).action_bank.keys
    )


def renormalise(d: ReleaseDraft, **moved: str) -> None:
    """Fit the scalings again, with groups of the partitions in `moved` in another one."""
    assignment = assignment_of(d.frame("group_quality"))
    fitted = {group: moved.get(home, home) for group, home in assignment.items()}
    document = normalisation_document(arrays(d), fitted)
    d.documents[NORMALISATION] = {**document, "split_digest": d.documents[SPLIT]["digest"]}


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
    threshold = duplicates_among(d.frame("state"), d.frame("past_controls"), sorted(homes), homes).threshold
    (entry,) = (e for e in d.documents[NORMALISATION]["state"] if e["feature"] == "route_offset_m")
    step = share * threshold * entry["scale"]
    d.set("state", "route_offset_m", lambda value: value + step, group_id=group, offset_ticks=0)


# Limits


@boundary("BD-MOD-018")
def scalings_of_another_machine(d: ReleaseDraft) -> None:
    for entry in d.documents[NORMALISATION]["state"]:
        entry["offset"], entry["scale"] = within(entry["offset"]), within(entry["scale"])


@boundary("BD-MOD-020", base="alone")
def near_duplicates_inside_a_partition(d: ReleaseDraft) -> None:
    copy_history(d, "g13", TEST)


@boundary("BD-MOD-020", base="alone")
def distance_just_below_the_threshold(d: ReleaseDraft) -> None:
    bring_near(d, VAL, TEST, 1 - 1e-10)


# BD-MOD-017: features


@mutant("BD-MOD-017", at={"file": FEATURES, "pointer": "/candidate_order/1"}, findings=2)
def candidate_order_changed(d: ReleaseDraft) -> None:
    order = d.documents[FEATURES]["candidate_order"]
    order[1], order[2] = order[2], order[1]


@mutant("BD-MOD-017", at={"file": FEATURES})
def expert_in_the_sensor_contract(d: ReleaseDraft) -> None:
    d.documents[FEATURES]["contracts"]["sensor"].append("expert")


@mutant("BD-MOD-017", at={"file": FEATURES, "pointer": "/histories/expert/features/0/track"})
def privileged_feature_called_sensor(d: ReleaseDraft) -> None:
    d.documents[FEATURES]["histories"]["expert"]["features"][0]["track"] = "sensor"


@mutant("BD-MOD-017", at={"file": FEATURES, "pointer": "/encoding/sha256"})
def encoding_of_another_bank(d: ReleaseDraft) -> None:
    d.documents[FEATURES]["encoding"]["sha256"] = "0" * 64


# BD-MOD-018, BD-MOD-019: normalisation


@mutant("BD-MOD-018", at={"file": NORMALISATION, "pointer": "/num_groups"}, findings=104)
def normalisation_of_training_and_validation(d: ReleaseDraft) -> None:
    renormalise(d, val="train")


@mutant("BD-MOD-018", at={"file": NORMALISATION, "pointer": "/state/0/scale"})
def scale_of_a_larger_release(d: ReleaseDraft) -> None:
    d.documents[NORMALISATION]["state"][0]["scale"] *= 1.001


@mutant("BD-MOD-018", at={"file": NORMALISATION, "pointer": "/scalars/1/offset"})
def offset_of_a_target_left_out(d: ReleaseDraft) -> None:
    d.documents[NORMALISATION]["scalars"][1]["offset"] = 0.0


@mutant("BD-MOD-019", at={"file": NORMALISATION, "pointer": "/split_digest"})
def normalisation_under_an_older_split(d: ReleaseDraft) -> None:
    d.documents[NORMALISATION]["split_digest"] = "0" * 64


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
