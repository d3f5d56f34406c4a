"""JSON Schema and the typed views accept and reject the same documents."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError
from tests.each import each
from tests.validator.contract.mutation import OF_EVERY_TYPE, mutated, neighbours

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.descriptor import DeclaredEncoding, Descriptor
from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.contract.policy import Policy
from branchdrive.testing import strategies

if TYPE_CHECKING:
    from collections.abc import Callable

    from hypothesis.strategies import DataObject, SearchStrategy


def keys_repeat(bank: Any) -> bool:
    keys = [policy["key"] for policy in bank["policies"]]
    return len(set(keys)) < len(keys)


def nominal_is_not_one(bank: Any) -> bool:
    return sum(policy["duration_ticks"] == 0 for policy in bank["policies"]) != 1


def nominal_intervenes(bank: Any) -> bool:
    return any(
        policy["duration_ticks"] == 0
        and (
            any(policy[actuator]["rule"] != "online_expert" for actuator in ("steer", "throttle", "brake"))
            or policy["recovery"] != "none"
            or policy["magnitude"] != 0
        )
        for policy in bank["policies"]
    )


def intervention_does_not_recover(bank: Any) -> bool:
    return any(policy["duration_ticks"] != 0 and policy["recovery"] == "none" for policy in bank["policies"])


def camera_names_repeat(descriptor: Any) -> bool:
    names = [camera["name"] for camera in descriptor.get("cameras", [])]
    return len(set(names)) < len(names)


def a_log_computes(descriptor: Any) -> bool:
    computed = ("target_speed_mps", "vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard")
    unrecorded = descriptor.get("unrecorded", [])
    is_log = (descriptor.get("driver") or {}).get("kind") == "log"
    return is_log and not {f"observations.{name}" for name in computed} <= set(unrecorded)


BANK_CONDITIONS = (keys_repeat, nominal_is_not_one, nominal_intervenes, intervention_does_not_recover)


@dataclass(frozen=True)
class View:
    """A schema file with its typed view, and what the schema says in prose only ("Beyond this schema")."""

    schema_name: str
    model: type[BaseModel]
    documents: SearchStrategy[Any]
    beyond_schema: tuple[Callable[[Any], bool], ...] = ()

    def conforms(self, document: Any) -> bool:
        return not schema_mismatches(document, self.schema_name)

    def accepts(self, document: Any) -> bool:
        try:
            self.model.model_validate(document)
        except ValidationError:
            return False
        return True

    def is_expected(self, document: Any) -> bool:
        """Whether the typed view should accept: the schema does, and no condition of its prose is broken."""
        return self.conforms(document) and not any(broken(document) for broken in self.beyond_schema)


POLICY = View("policy.schema.json", Policy, strategies.policy_documents())
BANK = View("action-bank.schema.json", ActionBank, strategies.bank_documents(), BANK_CONDITIONS)
ENCODING = View("action-encoding.schema.json", DeclaredEncoding, strategies.encoding_documents())
DESCRIPTOR = View(
    "descriptor.schema.json",
    Descriptor,
    strategies.descriptor_documents(),
    (
        camera_names_repeat,
        a_log_computes,
        *(lambda descriptor, broken=broken: broken(descriptor["action_bank"]) for broken in BANK_CONDITIONS),
    ),
)
VIEWS = {"policy": POLICY, "bank": BANK, "encoding": ENCODING, "descriptor": DESCRIPTOR}

each_view = each("view", VIEWS.values(), ids=VIEWS)


def lacks_version(view: View, document: Any) -> bool:
    """The one licence of a typed view: a constructor call need not say which version it implements."""
    return view is DESCRIPTOR and isinstance(document, dict) and "spec_version" not in document


@each_view
@given(data=st.data())
def test_both_judge_mutated_documents_alike(view: View, data: DataObject) -> None:
    document = data.draw(mutated(view.documents))
    assume(not lacks_version(view, document))
    assert view.accepts(document) == view.is_expected(document), schema_mismatches(document, view.schema_name)


def full_descriptor() -> dict[str, Any]:
    """A descriptor that holds every property, a media stream and a small bank."""
    software = {"name": "none", "version": "1"}
    bank = load_action_bank().model_dump(mode="json", exclude_none=True)
    pose = dict.fromkeys(("x_m", "y_m", "z_m", "yaw_rad", "pitch_rad", "roll_rad"), 0.5)
    lens = {"projection": "pinhole", "fx_px": 32.0, "fy_px": 32.0, "cx_px": 32.0, "cy_px": 24.0}
    image = {"width_px": 64, "height_px": 64}
    of_map = {"projection": "top_down", "px_per_m": 2.0, "origin_row_px": 32.0, "origin_column_px": 32.0}
    return {
        "spec_version": "0.1",
        "dataset_id": "invented",
        "dataset_version": "1.0.0",
        "title": "Invented",
        "licence": "CC-BY-4.0",
        "simulator": dict(software),
        "collector": dict(software),
        "rates": {"tick_s": 0.05, "observation_stride_ticks": 5},
        "streams": ["rgb_top_down", "semantic_bev", "controls", "ego_route_state", "route_result"],
        "cameras": [
            {"name": "top_down", "stream": "rgb_top_down", **image, **lens, **pose},
            {"name": "bev", "stream": "semantic_bev", **image, **of_map},
        ],
        "unrecorded": ["observations.command", "actors.height_m"],
        "layers": ["raw"],
        "action_bank": {"name": bank["name"], "policies": [bank["policies"][index] for index in (0, 1, 7)]},
        "action_encoding": {"name": "bd29", "width": 29, "sha256": "0" * 64},
        "tolerances": {"actuator": 0.0, "evidence": 1e-06},
        "vehicle": {
            "wheelbase_m": 2.8,
            "max_steer_rad": 0.6,
            "max_accel_mps2": 4.0,
            "max_decel_mps2": 8.0,
            "actuation": "single_axis",
        },
        "driver": {"kind": "learned"},
        "collection": {
            "seed": 7,
            "replay_noise": {"kind": "injected", "strength": 1.0},
            "faults": {"late_control": 0.25},
            "branches": {"quiet": 0.5},
            "scenario_types": ["HardBrake", "ParkedObstacle"],
        },
    }


@pytest.mark.parametrize("most", [10, pytest.param(10**6, marks=pytest.mark.thorough)])
@each("part", [*full_descriptor()])
def test_both_judge_every_single_change_of_a_descriptor_alike(part: str, most: int) -> None:
    descriptor = full_descriptor()
    assert DESCRIPTOR.accepts(descriptor)
    assert DESCRIPTOR.conforms(descriptor)
    changes = [changed for changed in neighbours(descriptor, part) if not lacks_version(DESCRIPTOR, changed)]
    num_rejected = 0
    for changed in changes[:: -(-len(changes) // most)]:
        accepts = DESCRIPTOR.accepts(changed)
        assert accepts == DESCRIPTOR.is_expected(changed), changed
        num_rejected += not accepts
    assert num_rejected > 0


@each_view
@each("document", OF_EVERY_TYPE, ids=repr)
def test_both_reject_what_is_no_such_document(view: View, document: Any) -> None:
    assert not view.conforms(document)
    assert not view.accepts(document)


@each_view
@given(data=st.data())
def test_both_accept_conforming_documents_and_what_the_model_writes(view: View, data: DataObject) -> None:
    drawn = data.draw(view.documents)
    assert schema_mismatches(drawn, view.schema_name) == []
    model = view.model.model_validate(drawn)
    document = model.model_dump(mode="json")
    assert schema_mismatches(document, view.schema_name) == []
    assert view.model.model_validate(document) == model
    assert view.model.model_validate(parse_json(dump_json(document))) == model
    assert view.model.model_validate_json(model.model_dump_json()) == model


@given(strategies.policy_documents())
def test_integers_may_be_written_with_a_fraction_of_zero(document: dict[str, Any]) -> None:
    written = {**document, "duration_ticks": float(document["duration_ticks"])}
    assert schema_mismatches(written, "policy.schema.json") == []
    policy = Policy.model_validate(written)
    assert policy == Policy.model_validate(document)
    assert type(policy.duration_ticks) is int


REFERENCE = load_action_bank().model_dump(mode="json")
NOMINAL, ACCELERATE = REFERENCE["policies"][:2]

BEYOND_SCHEMA: dict[str, tuple[list[dict[str, Any]], Callable[[Any], bool], str]] = {
    "keys repeat": ([NOMINAL, ACCELERATE, ACCELERATE], keys_repeat, "must be unique"),
    "no nominal": ([ACCELERATE, REFERENCE["policies"][2]], nominal_is_not_one, "exactly one nominal"),
    "two nominals": ([NOMINAL, {**NOMINAL, "key": "other"}], nominal_is_not_one, "exactly one nominal"),
    "nominal steers": (
        [{**NOMINAL, "steer": {"rule": "zero"}}, ACCELERATE],
        nominal_intervenes,
        "online expert",
    ),
    "nominal has a size": ([{**NOMINAL, "magnitude": 0.5}, ACCELERATE], nominal_intervenes, "online expert"),
    "nominal recovers": ([{**NOMINAL, "recovery": "hold"}, ACCELERATE], nominal_intervenes, "online expert"),
    "no recovery": (
        [NOMINAL, {**ACCELERATE, "recovery": "none"}],
        intervention_does_not_recover,
        "recovery controller",
    ),
}


@pytest.mark.parametrize(("policies", "condition", "message"), BEYOND_SCHEMA.values(), ids=BEYOND_SCHEMA)
def test_bank_keeps_what_its_schema_says_in_prose(
    policies: list[dict[str, Any]], condition: Callable[[Any], bool], message: str
) -> None:
    document = {"name": "bank", "policies": policies}
    assert BANK.conforms(document)
    assert [broken for broken in BANK_CONDITIONS if broken(document)] == [condition]
    with pytest.raises(ValidationError, match=message):
        ActionBank.model_validate(document)


@settings(max_examples=settings.default.max_examples // 4)
@given(strategies.descriptor_documents().filter(lambda document: document.get("cameras")))
def test_camera_names_are_unique_beyond_the_schema(document: dict[str, Any]) -> None:
    repeated = {**document, "cameras": [*document["cameras"], document["cameras"][0]]}
    assert DESCRIPTOR.conforms(repeated)
    assert not DESCRIPTOR.accepts(repeated)


@settings(max_examples=settings.default.max_examples // 4)
@given(strategies.descriptor_documents())
def test_version_is_required_of_documents_and_implied_in_calls(document: dict[str, Any]) -> None:
    del document["spec_version"]
    assert not DESCRIPTOR.conforms(document)
    assert Descriptor.model_validate(document).spec_version == "0.1"


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_models_reject_what_json_cannot_say(number: str) -> None:
    with pytest.raises(ValidationError):
        Policy.model_validate({**ACCELERATE, "magnitude": float(number)})
    with pytest.raises(ValidationError):
        Policy.model_validate_json(json.dumps({**ACCELERATE, "magnitude": float(number)}))


def test_models_are_frozen() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        load_action_bank().nominal.key = "other"


@pytest.mark.parametrize("part", ["action_bank", "cameras"])
def test_models_stop_at_the_first_bad_item(part: str) -> None:
    bad: list[Any] = [{}] * 100_000
    hostile = {**full_descriptor(), part: {"name": "own", "policies": bad} if part == "action_bank" else bad}
    with pytest.raises(ValidationError) as raised:
        Descriptor.model_validate(hostile)
    assert raised.value.error_count() < 100
