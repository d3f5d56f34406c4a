"""Configurations are data: one record, one digest, and no record that is read as something else."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest

from branchdrive import DatasetError
from branchdrive_reference.learning.configuration import (
    CONFIGURATIONS,
    SEEDS,
    Configuration,
    ModelConfig,
    TrainingConfig,
)


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_a_record_gives_back_its_configuration(name: str) -> None:
    configuration = CONFIGURATIONS[name]
    read = Configuration.from_record(json.loads(json.dumps(configuration.record)))
    assert read == configuration
    assert read.digest == configuration.digest
    assert configuration.model.name == name


def test_every_configuration_has_its_own_digest() -> None:
    one = CONFIGURATIONS["M3"]
    changed = replace(one, training=replace(one.training, patience=19))
    assert len({configuration.digest for configuration in (*CONFIGURATIONS.values(), changed)}) == 5


def test_what_is_left_out_is_in_no_record() -> None:
    assert set(CONFIGURATIONS["M1"].record["model"]) == {"name", "contract", "action", "fusion_width"}


def test_the_protocol_of_the_paper_is_the_default() -> None:
    training = TrainingConfig()
    assert (training.warmup_epochs, training.max_epochs, training.patience) == (5, 150, 20)
    assert (training.batch_groups, training.heading_weight) == (64, 0.05)
    assert {name: configuration.seeds for name, configuration in CONFIGURATIONS.items()} == {
        "M0": (0,), "M1": SEEDS, "M2": SEEDS, "M3": SEEDS,
    }  # fmt: skip
    assert SEEDS == (11, 23, 37)


@pytest.mark.parametrize(
    "change",
    [
        {"model": {"name": "M1", "contract": "sensor"}},
        {"model": {"name": "M1", "contract": "sensor", "fusion_width": 192, "vision": {}}},
        {"model": {"name": "M1", "contract": "sensor", "fusion_width": "192"}},
        {"model": {"name": "M1", "contract": "sensor", "fusion_width": 192, "history": None}},
        {"model": None},
        {"extra": 1},
    ],
    ids=["lacks an entry", "unknown part", "text for a number", "null for nothing", "no model", "unknown entry"],
)
def test_other_records_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(DatasetError, match="no model configuration: "):
        Configuration.from_record({**Configuration(ModelConfig("M0")).record, **change})


def test_the_rate_rises_in_a_line_and_falls_in_a_cosine() -> None:
    training = TrainingConfig(learning_rate=2.0, warmup_epochs=4, max_epochs=14)
    rates = [training.learning_rate_at(epoch) for epoch in range(1, 15)]
    assert rates[:4] == [0.5, 1.0, 1.5, 2.0]
    assert rates[4:] == pytest.approx([1 + math.cos(math.pi * step / 11) for step in range(1, 11)])
    assert rates[4:] == sorted(rates[4:], reverse=True)
    assert min(rates) > 0
