"""What is printed of selected outcomes: every selector under every profile, and contacts that could be avoided."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import pytest
from tests.validator.benchmark.samples import data, noise, prediction_set, small_protocol

from branchdrive.benchmark.protocol.protocol import read_protocol
from branchdrive.benchmark.ranking.selected_table import contact_sentence, percents
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.contract.document import schema_mismatches


@cache
def results() -> dict[str, Any]:
    return results_document(small_protocol(), data(), prediction_set(), noise=noise())


def with_contacts(**shares: float) -> dict[str, Any]:
    """A profile whose selectors have these avoidable contacts, and results of it alone."""
    profile: dict[str, Any] = json.loads(json.dumps(results()["ranking"]["profiles"][0]))
    for entry in profile["entries"]:
        share = shares.get(entry["selector"], 0.0)
        entry["outcomes"]["avoidable_contact"] = {"value": share, "low": 0.0, "high": 1.0}
    return profile


def test_every_selector_has_outcomes_under_every_profile() -> None:
    assert schema_mismatches(results(), "results.schema.json") == []
    part = data().part("test").targets
    for profile in results()["ranking"]["profiles"]:
        entries = {entry["selector"]: entry["outcomes"] for entry in profile["entries"]}
        expected = part.values.mean(axis=(0, 1))
        assert [target["mean"] for target in entries["random"]["targets"]] == pytest.approx(expected.tolist())
        expected = part.values[:, 0].mean(axis=0)
        assert [target["mean"] for target in entries["nominal"]["targets"]] == pytest.approx(expected.tolist())
        assert entries["nominal"]["targets"][1]["worse"] == {"value": 0.0, "low": None, "high": None}
        assert entries["oracle"]["contact"]["value"] == 0.0
        assert all(found["targets"][0]["worse"] is None for found in entries.values())
        assert all(found["targets"][1]["interval"]["cluster_low"] is not None for found in entries.values())
    text = render_tables(results())
    for profile in results()["ranking"]["profiles"]:
        assert f"## Selected outcomes, profile {profile['profile']}" in text
        assert f"## Selections worse than nominal beyond noise, profile {profile['profile']}" in text
    assert "by more than the noise of repetition, 0.2 m." in text


def test_contacts_of_the_oracle_and_of_priors_are_said_plainly() -> None:
    assert contact_sentence(with_contacts(**{"O-M3": 0.2, "random": 0.1, "nominal": 0.1})) is None
    said = contact_sentence(with_contacts(oracle=0.104, action_prior=0.2812))
    assert said == (
        "A contact is selected although a candidate without one exists: the oracle in 10.4% of groups, where this "
        "utility prefers it; `action_prior` in 28.1% of groups."
    )
    shown = {**results(), "ranking": {**results()["ranking"], "profiles": [with_contacts(action_prior=0.05)]}}
    assert "although a candidate without one exists: `action_prior` in 5.0% of groups." in render_tables(shown)


def test_unknown_noise_is_named_and_leaves_its_table_out() -> None:
    text = render_tables(results_document(small_protocol(), data(), prediction_set()))
    assert "by more than the noise of repetition, which is unknown." in text
    assert "worse than nominal beyond noise" not in text


def test_a_protocol_without_outcomes_has_results_without_them() -> None:
    before = small_protocol().document
    del before["outcomes"]
    found = results_document(read_protocol(before), data(), prediction_set(), noise=noise())
    assert schema_mismatches(found, "results.schema.json") == []
    assert "contact_m" not in found["ranking"]
    assert all("outcomes" not in entry for p in found["ranking"]["profiles"] for entry in p["entries"])
    assert "Selected outcomes" not in render_tables(found)


def test_rates_are_printed_with_what_is_known_of_their_interval() -> None:
    assert percents({"value": 0.1, "low": 0.0, "high": 0.25}) == "10.0% [0.0%, 25.0%]"
    assert percents({"value": 0.0, "low": None, "high": None}) == "0.0%"
    assert percents({"value": None, "low": None, "high": None}) == percents(None) == "-"
