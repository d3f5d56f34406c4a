"""Rankings with declared baselines: what is said of every selector, and against what learned ones are held."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from tests.validator.benchmark.samples import contexts, data, prediction_set, whole_protocol

from branchdrive.benchmark.prediction.inputs import ResultInputs, utility_scale
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.record import ranking_results
from branchdrive.benchmark.ranking.table import ranking_sections
from branchdrive.contract.document import schema_mismatches
from branchdrive.driving.utility import predicted_utility, utility
from branchdrive.errors import DatasetError
from branchdrive.text.table import Table

BASELINES = ["type_prior", "route_prior", "neighbours", "ridge", "neighbours_privileged", "ridge_privileged"]


def section(seen: Contexts | None) -> dict[str, Any]:
    return ranking_results(ResultInputs.of(whole_protocol(), data(), prediction_set()), seen)


@cache
def ranking() -> dict[str, Any]:
    return section(contexts())


def entries(profile: str = "balanced") -> dict[str, Any]:
    (found,) = (one for one in ranking()["profiles"] if one["profile"] == profile)
    return {entry["selector"]: entry for entry in found["entries"]}


def test_every_selector_says_what_it_sees() -> None:
    sees = {name: entry["sees"] for name, entry in entries().items()}
    assert list(sees) == [
        "random", "nominal", "action_prior", "fixed_brake", *BASELINES,
        "O-M0", "O-M1", "E-M1", "O-M2", "E-M2", "O-M3", "E-M3", "oracle",
    ]  # fmt: skip
    assert sees["action_prior"] == sees["random"] == "nothing"
    assert sees["type_prior"] == "scenario type"
    assert sees["route_prior"] == "town, command, speed limit"
    assert (sees["ridge"], sees["ridge_privileged"]) == ("sensor history", "privileged history")
    assert (sees["O-M3"], sees["E-M3"], sees["oracle"]) == ("sensor inputs", "sensor inputs", "outcomes")


def test_tables_say_that_the_mean_sees_nothing() -> None:
    (table,) = (
        one
        for one in ranking_sections({"ranking": ranking(), "noise": None})
        if one.title == "Ranking, profile balanced"
    )
    assert isinstance(table, Table)
    sees = {name.removesuffix(" (tie)"): what for name, what, *_ in table.rows}
    assert (sees["O-M0"], sees["nominal"], sees["O-M3"]) == ("nothing", "nothing", "sensor inputs")


def test_tie_rules_are_marked() -> None:
    """M0 and M2 predict one outcome for the whole bank."""
    assert [name for name, entry in entries().items() if entry["is_tie"]] == ["O-M0", "O-M2", "E-M2"]


def test_ensemble_chooses_by_the_mean_prediction() -> None:
    protocol = whole_protocol()
    scale, profile = utility_scale(protocol, data()), protocol.preferences["safety"]
    scores = predicted_utility(prediction_set().scalars("M3", "test").mean(axis=0), scale, profile)
    executed = utility(data().part("test").targets, scale, profile)
    expected = executed[np.arange(len(executed)), scores.argmax(axis=1)].mean()
    assert entries("safety")["E-M3"]["value"] == pytest.approx(expected)


def test_gate_compares_with_nominal_too() -> None:
    separation = data().part("test").outcomes.scalars[..., 1]
    prior = data().candidates.index(ranking()["profiles"][0]["action_prior"])
    gate = entries()["action_prior"]["gate_to_nominal"]
    assert gate["mean_m"] == pytest.approx((separation[:, prior] - separation[:, 0]).mean())
    assert gate["passed"] == (gate["mean_m"] >= -1e-9)
    assert gate["low"] <= gate["mean_m"] <= gate["high"]
    assert entries()["nominal"]["gate_to_nominal"] == {"mean_m": 0.0, "low": None, "high": None, "passed": True}
    assert entries()["nominal"]["gate"]["mean_m"] == pytest.approx(-gate["mean_m"])


def test_every_learned_selector_is_held_against_every_reference() -> None:
    held = {(one["left"], one["right"], one["metric"], one["profile"]): one for one in ranking()["held"]}
    learned = [name for name in entries() if name[:2] in ("O-", "E-")]
    assert len(held) == len(ranking()["held"]) == len(learned) * 2 * 2 * 5
    for (left, right, metric, profile), one in held.items():
        assert one["name"] == f"{left}-{right}.{metric}.{profile}"
        found = entries(profile)
        assert one["difference"] == pytest.approx(found[left][metric] - found[right][metric])
        assert one["num_clusters"] == 10
    declared = {one["name"]: one for one in ranking()["comparisons"]}
    again = held["E-M3", "type_prior", "regret", "safety"]
    assert again["p_clusters"] == declared["E-M3-type_prior.regret.safety"]["p_clusters"]
    (family,) = (one for one in ranking()["families"] if one["name"] == "ranking_baselines")
    assert (family["num_declared"], family["num_evaluated"]) == (16, 16)


def test_baselines_that_see_more_are_worth_more() -> None:
    value = {name: entry["value"] for name, entry in entries("safety").items()}
    assert value["type_prior"] == value["route_prior"] > value["action_prior"]
    assert value["neighbours_privileged"] > value["neighbours"]


def test_section_conforms() -> None:
    whole = {"ranking": ranking()}
    assert [m for m in schema_mismatches(whole, "results.schema.json") if m.location["pointer"] != "/"] == []


def test_baseline_without_its_evidence_is_left_out_and_named() -> None:
    seen = contexts()
    blind = Contexts(seen.row, seen.labels, {**seen.histories, "privileged": None})
    found = section(blind)
    assert found["unseen"] == BASELINES[4:]
    assert {entry["selector"] for entry in found["profiles"][0]["entries"]}.isdisjoint(BASELINES[4:])
    assert (
        "no evidence of surroundings: neighbours_privileged, ridge_privileged."
        in ranking_sections({"ranking": found, "noise": None})[0].notes[-1]
    )
    with pytest.raises(DatasetError, match="declares baselines, which need the histories"):
        section(None)


def test_tables_name_references_and_report_privileged_ones_apart() -> None:
    tables = {
        one.title: one for one in ranking_sections({"ranking": ranking(), "noise": None}) if isinstance(one, Table)
    }
    main, apart = tables["Ranking, profile safety"], tables["Ranking, profile safety, privileged"]
    assert [row[0] for row in apart.rows] == BASELINES[4:]
    rows = {row[0]: row for row in main.rows}
    assert {"O-M0 (tie)", "O-M2 (tie)", "E-M3", "type_prior"} <= set(rows)
    assert rows["nominal"][-1].startswith("action_prior: ")
    assert rows["nominal"][-1].endswith(", nominal: pass (+0.000 m)")
    assert [row[0] for row in tables["Selected outcomes, profile safety, privileged"].rows] == BASELINES[4:]
    assert {row[0] for row in tables["Selected outcomes, profile safety"].rows}.isdisjoint(BASELINES[4:])
    held = tables["Learned selectors against references, profile safety"]
    assert [row[:2] for row in held.rows][:2] == [["O-M0", "action_prior"], ["O-M0", "type_prior"]]
    assert len(held.rows) == 14
