"""Defects and limits of features and normalisation of the model layer."""

from __future__ import annotations

from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.model_inputs import within
from tests.validator.engine.rules.release import SPLIT, ReleaseDraft

from branchdrive.contract.descriptor import Descriptor
from branchdrive.model.arrays import ModelArrays, pack_arrays
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


# Limits


@boundary("BD-MOD-018")
def scalings_of_another_machine(d: ReleaseDraft) -> None:
    for entry in d.documents[NORMALISATION]["state"]:
        entry["offset"], entry["scale"] = within(entry["offset"]), within(entry["scale"])


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


@mutant("BD-MOD-018", at={"file": NORMALISATION, "pointer": "/num_groups"}, findings=103)
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
