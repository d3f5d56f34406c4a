"""Defects and limits of the release as a whole: its raw layer, its card and its licence."""

from __future__ import annotations

from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.release import SOURCE, ReleaseDraft

CARD, LICENCE = "README.md", "LICENCE.txt"


def beside(d: ReleaseDraft) -> Draft:
    """The raw dataset beside a detached release."""
    assert d.raw is not None
    return d.raw


def retell(d: ReleaseDraft, line: str, other: str) -> None:
    """Change a passage of the card that is there once."""
    assert d.texts[CARD].count(line) == 1, d.texts[CARD]
    d.texts[CARD] = d.texts[CARD].replace(line, other)


# Limits


@boundary("BD-REL-001", "BD-REL-002", "BD-REL-003", "BD-REL-004")
def release_beside_its_raw_layer(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary("BD-REL-001", "BD-REL-002", base="detached")
def raw_dataset_that_claims_other_layers(d: ReleaseDraft) -> None:
    assert beside(d).descriptor["layers"] != d.descriptor["layers"]


@boundary("BD-REL-002", base="detached")
def raw_dataset_that_writes_defaults_out(d: ReleaseDraft) -> None:
    beside(d).descriptor["tolerances"] = {"actuator": 0, "evidence": 1e-6}
    assert d.descriptor.get("tolerances") != beside(d).descriptor["tolerances"]


@boundary("BD-REL-001", base="detached")
def raw_dataset_with_other_images(d: ReleaseDraft) -> None:
    beside(d).before_seal(
        lambda root: (root / "raw/shard-00002/more.bin").write_bytes(b"media are no part of identity")
    )


@boundary("BD-REL-001", "BD-REL-002", base="alone", status="skipped")
def named_raw_layer_not_at_hand(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary("BD-REL-003", "BD-REL-004", base="alone")
def card_of_a_detached_release(d: ReleaseDraft) -> None:
    assert "--raw RAW" in d.texts[CARD]


@boundary("BD-REL-004", "BD-REL-003")
def release_under_another_licence(d: ReleaseDraft) -> None:
    d.descriptor["licence"] = "CC0-1.0"
    d.reseal("card")


# BD-REL-001, BD-REL-002: the raw layer


@mutant("BD-REL-001", at={"file": SOURCE, "pointer": "/raw_layer"})
def digest_of_another_raw_layer(d: ReleaseDraft) -> None:
    d.documents[SOURCE]["raw_layer"] = "0" * 64
    d.reseal("card")


@mutant("BD-REL-001", at={"file": SOURCE, "pointer": "/raw_layer"}, base="detached")
def raw_layer_recorded_again(d: ReleaseDraft) -> None:
    beside(d).set("rollouts", "result_termination", "recorded again", rollout_id="g0.nominal.a1")


@mutant("BD-REL-002", at={"file": SOURCE, "pointer": "/dataset_version"}, base="detached", findings=2)
def raw_dataset_of_another_version(d: ReleaseDraft) -> None:
    beside(d).descriptor["dataset_version"] = "0.2.0"


@mutant("BD-REL-002", at={"file": SOURCE, "pointer": "/dataset_id"}, base="detached", findings=2)
def raw_dataset_of_another_name(d: ReleaseDraft) -> None:
    beside(d).descriptor["dataset_id"] = "another"


@mutant("BD-REL-002", at={"file": "branchdrive.json", "pointer": "/action_bank/name"}, base="detached")
def raw_dataset_of_another_bank(d: ReleaseDraft) -> None:
    beside(d).descriptor["action_bank"]["name"] = "another"


@mutant("BD-REL-002", at={"file": "branchdrive.json", "pointer": "/licence"}, base="detached", findings=2)
def release_under_a_licence_and_title_of_its_own(d: ReleaseDraft) -> None:
    d.descriptor.update(title="A better title", licence="CC0-1.0")
    d.reseal("card")


@mutant("BD-REL-002", at={"file": "branchdrive.json", "pointer": "/simulator/name"}, base="detached")
def release_of_another_simulator(d: ReleaseDraft) -> None:
    d.descriptor["simulator"] = {**d.descriptor["simulator"], "name": "A real road"}
    d.reseal("card")


@mutant(
    "BD-REL-002",
    at={"file": "branchdrive.json", "pointer": "/collection/replay_noise/kind"},
    base="detached",
    findings=2,
)
def noise_of_replays_denied(d: ReleaseDraft) -> None:
    beside(d).descriptor["collection"] = {**d.descriptor["collection"], "replay_noise": 0.5}


@mutant("BD-REL-002", at={"file": "branchdrive.json", "pointer": "/collection/faults/drop"}, base="detached")
def faults_that_were_injected_denied(d: ReleaseDraft) -> None:
    beside(d).descriptor["collection"] = {**d.descriptor["collection"], "faults": {"drop": 0.1}}


@mutant("BD-REL-002", at={"file": "branchdrive.json", "pointer": "/tolerances/actuator"}, base="detached")
def tolerance_tightened_after_the_fact(d: ReleaseDraft) -> None:
    beside(d).descriptor["tolerances"] = {"actuator": 0.01, "evidence": 1e-6}


# BD-REL-003, BD-REL-004: card and licence


@mutant("BD-REL-003", at={"file": CARD})
def card_with_a_better_number(d: ReleaseDraft) -> None:
    row = next(line for line in d.texts[CARD].splitlines() if "Frozen population" in line)
    retell(d, row, row.replace("15", "21"))


@mutant("BD-REL-003", at={"file": CARD})
def card_that_hides_a_limitation(d: ReleaseDraft) -> None:
    lines = d.texts[CARD].splitlines(keepends=True)
    d.texts[CARD] = "".join(lines[:-3])


@mutant("BD-REL-003", at={"file": CARD})
def card_missing(d: ReleaseDraft) -> None:
    d.texts.pop(CARD)


@mutant("BD-REL-003", at={"file": CARD})
def card_of_an_older_descriptor(d: ReleaseDraft) -> None:
    d.descriptor["title"] = "A title that the card does not have"


@mutant("BD-REL-004", at={"file": LICENCE})
def licence_of_another_work(d: ReleaseDraft) -> None:
    d.texts[LICENCE] = d.texts[LICENCE].replace("CC-BY-4.0", "CC0-1.0")


@mutant("BD-REL-004", at={"file": LICENCE})
def licence_missing(d: ReleaseDraft) -> None:
    d.texts.pop(LICENCE)
