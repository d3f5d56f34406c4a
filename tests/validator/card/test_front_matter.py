"""The front matter of a card: YAML that hubs read, and the files of the splits."""

from __future__ import annotations

from typing import Any

import pytest
import yaml
from tests.validator.writer.invented import make_descriptor

from branchdrive.card.front_matter import front_matter
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import LAYERS, table_pattern

POPULATION = {
    "partitions": ["train", "val", "test", "calibration"],
    "stages": [
        {"stage": "core_valid", "groups": {"train": 9, "val": 2, "test": 2, "calibration": 1}},
        {"stage": "frozen", "groups": {"train": 9, "val": 2, "test": 1, "calibration": 0}},
    ],
}


def read(population: Any = None, **about: Any) -> dict[str, Any]:
    described = make_descriptor().model_copy(update={"layers": tuple(LAYERS), **about})
    lines = front_matter(described, population or POPULATION)
    assert lines[0] == lines[-1] == "---"
    found: dict[str, Any] = yaml.safe_load("\n".join(lines[1:-1]))
    return found


def splits(found: dict[str, Any], table: str) -> dict[str, str]:
    (config,) = [config for config in found["configs"] if config["config_name"] == table]
    return {entry["split"]: entry["path"] for entry in config["data_files"]}


def test_splits_are_the_partitions_with_a_group_in_the_frozen_population() -> None:
    assert splits(read(), "scalars") == {
        "train": "model/scalars-train-*.parquet",
        "validation": "model/scalars-val-*.parquet",
        "test": "model/scalars-test-*.parquet",
    }
    groups = {"train": 9, "val": 2, "test": 1, "calibration": 4}
    stages = {**POPULATION, "stages": [{"stage": "frozen", "groups": groups}]}
    assert splits(read(stages), "state")["calibration"] == "model/state-calibration-*.parquet"


def test_every_table_with_a_row_for_each_group_is_named_and_scalars_come_first_to_hand() -> None:
    found = read()
    names = [config["config_name"] for config in found["configs"]]
    assert set(names) == {*LAYERS["model"].tables} - {"media_index", "endings", "objects"}
    assert [config["config_name"] for config in found["configs"] if config.get("default")] == ["scalars"]
    assert splits(found, "actions") == {"bank": table_pattern("actions")}
    for name in names:
        partitions = ("train", "val", "test") if LAYER_TABLES[name].partitions else (None,)
        assert [*splits(found, name).values()] == [table_pattern(name, one) for one in partitions]


def test_an_optional_table_is_named_where_it_is_there() -> None:
    described = make_descriptor().model_copy(update={"layers": tuple(LAYERS)})
    found = yaml.safe_load("\n".join(front_matter(described, POPULATION, ["endings"])[1:-1]))
    assert splits(found, "endings")["test"] == table_pattern("endings", "test")


def test_surroundings_are_named_where_evidence_is_claimed() -> None:
    streams = tuple(name for name in make_descriptor().streams if name != "actor_risk_evidence")
    assert "surroundings" not in [config["config_name"] for config in read(streams=streams)["configs"]]


def test_a_release_without_a_model_layer_has_no_splits() -> None:
    assert "configs" not in read(layers=("raw", "canonical", "quality"))


@pytest.mark.parametrize(
    ("licence", "expected"),
    [
        ("CC-BY-4.0", {"license": "cc-by-4.0"}),
        ("ODbL-1.0", {"license": "odbl"}),
        ("LicenseRef-Institute 2.1/b", {"license": "other", "license_name": "licenseref-institute-2.1-b"}),
        ("MIT OR Apache-2.0", {"license": "other", "license_name": "mit-or-apache-2.0"}),
    ],
)
def test_licences_have_the_identifiers_of_hubs(licence: str, expected: dict[str, str]) -> None:
    found = read(licence=licence)
    assert {key: value for key, value in found.items() if key.startswith("license")} == expected


@pytest.mark.parametrize(
    "title", ["yes", "a: b # c", '"quoted" \\', "---", "- x\n- y", "null", "\u2028\u0085\ud7ff \U0001f697", "{a: [b"]
)
def test_free_text_stays_text(title: str) -> None:
    found = read(title=title, keywords=("no", "1.5", "Town 5: night"))
    plain = "".join(char if char.isprintable() else " " for char in title)
    assert found["pretty_name"] == plain
    assert found["tags"][-3:] == ["no", "1.5", "Town 5: night"]
    assert found == {**read(keywords=("no", "1.5", "Town 5: night")), "pretty_name": plain}
