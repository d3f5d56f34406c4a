"""Configurations are data: one record, one digest, and no record that is read as something else."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.reference_impl.learning.small_models import DECLARED, TRAINING
from tests.validator.contract.mutation import mutated

from branchdrive import DatasetError
from branchdrive.benchmark.protocol.protocol import default_protocol, visual_protocol
from branchdrive_reference.learning.configuration import MAX_PREFERENCES, MAX_WIDTH, Configuration, is_model_name

M3 = DECLARED["M3"].record
M3R = DECLARED["M3r"].record
PREFERENCE = M3R["training"]["decision"]["preferences"]["safety"]


@pytest.mark.parametrize("declared", visual_protocol().models, ids=lambda declared: declared.id)
def test_the_protocol_declares_what_this_software_trains(declared: Any) -> None:
    configuration = Configuration.of(declared)
    assert configuration.record == declared.configuration
    assert configuration.digest == declared.config_digest
    assert Configuration.from_record(json.loads(json.dumps(configuration.record))) == configuration
    assert (configuration.model.name, configuration.model.contract) == (declared.id, declared.contract)
    assert tuple(declared.seeds) == ((11, 23, 37) if configuration.model.is_trained else (0,))


def test_every_configuration_has_its_own_digest() -> None:
    one = DECLARED["M3"]
    changed = replace(one, training=replace(one.training, patience=19))
    assert len({configuration.digest for configuration in (*DECLARED.values(), changed)}) == 9


def test_m3r_is_m3_but_for_its_training_for_decisions() -> None:
    found = DECLARED["M3r"]
    decision = found.training.decision
    assert decision is not None
    outcome_alone = replace(found.training, decision=None)
    assert Configuration(replace(found.model, name="M3"), outcome_alone) == DECLARED["M3"]
    served = {name: (one.separation, one.displacement, one.comfort) for name, one in decision.preferences.items()}
    profiles = {name: tuple(profile[:3]) for name, profile in default_protocol().preferences.items()}
    assert served == {**profiles, "near_range": profiles["safety"]}
    assert {name: one.near_m for name, one in decision.preferences.items() if one.near_m} == {"near_range": 2.0}


def test_what_is_left_out_is_in_no_record() -> None:
    assert set(DECLARED["M1"].record["model"]) == {"name", "contract", "action", "fusion_width"}


def test_training_is_that_of_the_paper() -> None:
    assert (TRAINING.warmup_epochs, TRAINING.max_epochs, TRAINING.patience) == (5, 150, 20)
    assert (TRAINING.batch_groups, TRAINING.heading_weight) == (64, 0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"model": {"name": "M1", "contract": "sensor"}}, "/model/fusion_width: Field required"),
        ({"model": {**DECLARED["M0"].record["model"], "vision": {}}}, "/model/vision: Unexpected"),
        ({"model": {**DECLARED["M0"].record["model"], "fusion_width": "192"}}, "/model/fusion_width: "),
        ({"model": {**DECLARED["M0"].record["model"], "history": None}}, "expected no null"),
        ({"model": None}, "/model: "),
        ({"extra": 1}, "/extra: Unexpected"),
        ({"training": {**M3["training"], "huber_delta": 1}}, "numbers written like `64` or `1.0`"),
    ],
    ids=["lacks an entry", "unknown part", "text for a number", "null for nothing", "no model", "unknown entry",
         "whole number"],
)  # fmt: skip
def test_other_records_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(DatasetError, match=f"not a valid model configuration: .*{words}"):
        Configuration.from_record({**M3, **change})


@each(
    ("place", "value"),
    [
        *(("model.name", name) for name in ("../../x/pwn", "a/b", "..", "", "M3\n", "m" * 65)),
        *(("model.contract", contract) for contract in ("", "camera")),
        *(
            (f"model.{name}", width)
            for name in (
                "fusion_width", "history.step_width", "history.state_width", "history.controls_width",
                "action.hidden_width", "action.width",
            )
            for width in (-1, 0, MAX_WIDTH + 1, 2**40, True)
        ),
        *(
            (f"training.{name}", count)
            for name in ("batch_groups", "max_epochs", "patience")
            for count in (-1, 0, 10**9, 1.5)
        ),
        *(("training.warmup_epochs", count) for count in (-1, 10**9)),
        *(("training.learning_rate", rate) for rate in (-5e-4, 0.0, 1.5)),
        *(("training.weight_decay", decay) for decay in (-0.01, 1.5)),
        *(("training.huber_delta", delta) for delta in (-1.0, 0.0, 1e300)),
        *((f"training.{name}", value) for name in ("smooth_l1_beta", "heading_weight") for value in (-0.5, 1e300)),
        *((f"training.decision.{name}_weight", value) for name in ("contrast", "regret") for value in (-0.5, 1e300)),
        *(("training.decision.temperature", value) for value in (-0.05, 0.0, 1e300)),
        ("training.decision.preferences", {}),
        ("training.decision.preferences", {f"p{i}": PREFERENCE for i in range(MAX_PREFERENCES + 1)}),
        *((f"training.decision.preferences.safety.{name}", 1.5) for name in ("separation", "displacement", "comfort")),
        *(("training.decision.preferences.near_range.near_m", value) for value in (-2.0, 0.0, 1e300)),
    ],
)  # fmt: skip
def test_values_out_of_range_are_refused_where_they_stand(place: str, value: Any) -> None:
    record = copy.deepcopy(M3R)
    *folders, name = place.split(".")
    part = record
    for folder in folders:
        part = part[folder]
    part[name] = value
    with pytest.raises(DatasetError, match=f"not a valid model configuration: /{place.replace('.', '/')}: "):
        Configuration.from_record(record)


def test_ends_of_the_ranges_are_accepted() -> None:
    record = copy.deepcopy(M3)
    record["model"]["fusion_width"] = MAX_WIDTH
    record["training"] |= {
        "batch_groups": 1, "max_epochs": 1, "patience": 1, "warmup_epochs": 0, "learning_rate": 1.0,
        "weight_decay": 0.0, "smooth_l1_beta": 0.0, "heading_weight": 0.0,
    }  # fmt: skip
    assert Configuration.from_record(record).record == record


def test_an_error_of_a_declared_model_names_it() -> None:
    declared = default_protocol().models[3]
    other = declared.model_copy(update={"configuration": {"model": {}}})
    with pytest.raises(DatasetError, match=r"^model 'M3': not a valid model configuration: /"):
        Configuration.of(other)


def test_an_error_is_one_short_line_whatever_a_record_holds() -> None:
    with pytest.raises(DatasetError) as error:
        Configuration.from_record({**M3, "\x1b[2J\n## Injected" + "x" * 10**6: 1})
    assert str(error.value).isprintable()
    assert len(str(error.value)) < 400


def test_names_of_models_are_parts_of_names_of_files() -> None:
    assert all(map(is_model_name, ("M3", "theirs-2.1_b", "m" * 64)))
    assert not any(map(is_model_name, ("", ".", "..", ".hidden", "a/b", "a\\b", "M3\n", "é", "m" * 65)))


@given(mutated(st.sampled_from([M3, M3R])))
def test_a_mutated_record_is_a_configuration_or_refused(record: Any) -> None:
    try:
        found = Configuration.from_record(record)
    except DatasetError as error:
        assert str(error).isprintable()
    else:
        assert found.record == record
        assert found.digest == Configuration.from_record(found.record).digest


def test_the_rate_rises_in_a_line_and_falls_in_a_cosine() -> None:
    training = replace(TRAINING, learning_rate=2.0, warmup_epochs=4, max_epochs=14)
    rates = [training.learning_rate_at(epoch) for epoch in range(1, 15)]
    assert rates[:4] == [0.5, 1.0, 1.5, 2.0]
    assert rates[4:] == pytest.approx([1 + math.cos(math.pi * step / 11) for step in range(1, 11)])
    assert rates[4:] == sorted(rates[4:], reverse=True)
    assert min(rates) > 0
