"""Regret by scenario type: means over the groups of a type, of consequential types and of all."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from tests.validator.benchmark.samples import BANK, contexts, data, prediction_set, whole_protocol

from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.ranking.by_type import (
    ACCELERATE,
    CONSEQUENTIAL_SHARE,
    consequential_types,
    regret_by_type,
    type_sections,
)
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.benchmark.ranking.record import ranked_profile, ranking_results
from branchdrive.text.table import Passage, Table

ACCELERATING = [place for place, policy in enumerate(BANK.policies) if policy.family == ACCELERATE]


@cache
def inputs() -> ResultInputs:
    return ResultInputs.of(whole_protocol(), data(), prediction_set())


def types() -> dict[str, str]:
    seen = contexts()
    return {group: str(seen.labels["scenario_type"][row]) for group, row in seen.row.items()}


def test_all_types_together_are_what_the_results_say() -> None:
    ranking = ranked_profile(inputs(), "balanced", contexts())[0]
    *_, found = regret_by_type(inputs(), ranking, types(), ())
    (profile,) = (p for p in ranking_results(inputs(), contexts())["profiles"] if p["profile"] == "balanced")
    assert (found.name, found.num_groups) == ("all types", profile["num_ranked"])
    for entry in profile["entries"]:
        assert found.means[entry["selector"]] == pytest.approx(entry["regret"], abs=1e-12)
        interval, stored = found.intervals[entry["selector"]], entry["intervals"]["regret"]
        if stored["cluster_low"] is not None:
            assert [interval.cluster_low, interval.cluster_high] == [stored["cluster_low"], stored["cluster_high"]]


def test_a_type_has_the_mean_of_its_groups() -> None:
    ranking = ranked_profile(inputs(), "balanced", contexts())[0]
    far, near, among, everyone = regret_by_type(inputs(), ranking, types(), ("near",))
    assert [far.name, near.name, among.name, everyone.name] == ["far", "near", "consequential types", "all types"]
    label = np.array([types()[group] for group in inputs().reported.groups])[ranking.population.ranked]
    clusters = np.array(inputs().reported.clusters)[ranking.population.ranked]
    for found in (far, near):
        regrets = ranking.entries["action_prior"].measures.regret[label == found.name]
        assert found.means["action_prior"] == pytest.approx(float(np.mean(regrets)), abs=1e-12)
        assert (found.num_groups, found.num_clusters) == (len(regrets), len(set(clusters[label == found.name])))
    assert among._replace(name="near") == near
    assert far.num_groups + near.num_groups == everyone.num_groups


def test_types_are_consequential_by_contacts_of_accelerating_drives() -> None:
    part = inputs().fitted
    label = np.array([types()[group] for group in part.groups])
    gaps = part.targets.values[:, ACCELERATING, SEPARATION]
    at_near, at_far = (float(np.quantile(gaps[label == name], CONSEQUENTIAL_SHARE)) for name in ("near", "far"))
    assert at_near < at_far
    assert consequential_types(inputs(), types(), ACCELERATING, at_near + 1e-9) == ("near",)
    assert consequential_types(inputs(), types(), ACCELERATING, at_near / 2) == ()
    assert consequential_types(inputs(), types(), ACCELERATING, at_far + 1e-9) == ("far", "near")


def test_a_table_for_each_profile_and_a_sentence_for_what_is_not_ranked() -> None:
    found = type_sections(inputs(), contexts(), types(), ACCELERATING)
    assert [section.title for section in found] == [
        f"Regret by scenario type, profile {name}" for name in inputs().protocol.preferences
    ]
    table = found[0]
    assert isinstance(table, Table)
    names = [column.title for column in table.columns]
    assert names[:3] == ["Scenario type", "Groups", "Clusters"]
    assert {"nominal", "action_prior", "type_prior", "O-M3"} < set(names)
    assert not {"random", "oracle", "O-M0"} & set(names)
    assert "[" not in table.rows[0][3]
    assert "[" in table.rows[-1][3]
    lone = type_sections(inputs(), None, types(), ACCELERATING)
    assert not any(isinstance(section, Passage) for section in lone)  # without contexts baselines are left out
