"""Counts of population and models: by hand, in the tables, and only where results have them."""

from __future__ import annotations

import numpy as np
import pytest
from tests.validator.benchmark.samples import data, frames, prediction_set, small_protocol
from tests.validator.engine.rules.benchmark_release import checkpoint

from branchdrive.benchmark.checkpoint import CheckpointFacts, num_parameters
from branchdrive.benchmark.prediction.description import describe, described_checkpoints
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.contract.document import schema_mismatches

FACTS = CheckpointFacts("M3", 11, *["0" * 64] * 4)


def contexts() -> dict[str, np.ndarray]:
    """The frame with types by parity, and one town."""
    found = frames()["contexts"]
    parity = [("even", "odd")[i % 2] for i in range(len(found["group_id"]))]
    return {**found, "scenario_type": np.array(parity, object), "town": np.array(["Town"] * len(parity), object)}


def test_groups_are_counted_by_type_town_and_partition() -> None:
    found = describe(contexts(), data(), {})
    sizes = {name: len(part.groups) for name, part in data().parts.items()}
    assert found["towns"] == [{"name": "Town", "groups": sizes}]
    assert [row["name"] for row in found["scenario_types"]] == ["even", "odd"]
    assert found["scenario_types"][0]["groups"] == {name: size // 2 for name, size in sizes.items()}


def test_available_candidates_are_counted() -> None:
    found = {row["partition"]: row for row in describe(contexts(), data(), {})["availability"]}
    assert found["test"] == {"partition": "test", "num_candidates": 260, "available": [260] * 6}


def test_parameters_are_the_numbers_of_a_checkpoint() -> None:
    content = checkpoint(FACTS, b"seven..")
    assert num_parameters(content, len(content)) == 7
    with pytest.raises(ValueError, match="7 bytes, and 6 follow"):
        num_parameters(content, len(content) - 1)


def test_the_checkpoint_of_the_least_seed_is_counted() -> None:
    entries = [{"model": "M3", "seed": seed, "file": f"checkpoints/M3-seed{seed}"} for seed in (23, 5, 11)]
    assert described_checkpoints({"checkpoints": entries}) == {"M3": "checkpoints/M3-seed5"}


def test_tables_show_what_is_described_and_nothing_else() -> None:
    bare = results_document(small_protocol(), data(), prediction_set())
    about = describe(contexts(), data(), {"M3": 552_248})
    found = results_document(small_protocol(), data(), prediction_set(), description=about)
    assert {name: found[name] for name in bare} == bare
    assert schema_mismatches(found, "results.schema.json") == []
    text = render_tables(found)
    assert (
        "| scenario type | odd | 12 | 10 | 48 | 10 |" in text or "| scenario type | odd | 12 | 10 | 10 | 48 |" in text
    )
    assert "| M3 History and action | 0.552 |" in text
    assert "| M0 Training mean | - |" in text
    assert "## Availability of targets" in text
    assert "Availability of targets" not in render_tables(bare)
    assert "Params" not in render_tables(bare)
