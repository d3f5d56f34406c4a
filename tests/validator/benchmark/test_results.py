"""Results: they follow from predictions alone, conform to their schema, and say what is missing."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from tests.validator.benchmark.samples import (
    BANK,
    data,
    frames,
    in_one_frame,
    noise,
    prediction_set,
    risk_fit,
    rows_of,
    small_protocol,
)

from branchdrive.benchmark.guard.assessment import SELECTIONS
from branchdrive.benchmark.guard.table import promises
from branchdrive.benchmark.prediction.comparison import JUDGED_BY_CLUSTERS
from branchdrive.benchmark.prediction.data import BenchmarkData, groups_digest
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.protocol.protocol import read_protocol
from branchdrive.benchmark.ranking.noise import noise_of, noise_record
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import render_tables
from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.errors import DatasetError
from branchdrive.statistics.holm import holm
from branchdrive.tables.frame import take

WARNING = "Predictions of X come from no locked checkpoint."


@cache
def results() -> dict[str, Any]:
    return results_document(small_protocol(), data(), prediction_set(), risk_fit(), noise(), warnings=[WARNING])


def estimates(document: dict[str, Any]) -> dict[tuple[str, str], Any]:
    return {(e["model"], e["metric"]): e for e in document["prediction"]["estimates"]}


def test_document_conforms_and_comes_back_from_its_bytes() -> None:
    assert schema_mismatches(results(), "results.schema.json") == []
    assert parse_json(dump_json(results())) == results()


def test_protocol_gives_the_same_results_when_it_is_read_back() -> None:
    """Writers sort the keys of a document; no order of keys may decide anything."""
    protocol = read_protocol(parse_json(dump_json(small_protocol().document)))
    again = results_document(protocol, data(), prediction_set(), risk_fit(), noise(), warnings=[WARNING])
    assert dump_json(again) == dump_json(results())


def test_order_of_rows_decides_nothing() -> None:
    rng = np.random.default_rng(1)
    mixed = BenchmarkData.of(
        {name: [take(frame, rng.permutation(len(frame["group_id"])))] for name, frame in frames().items()}, BANK
    )
    tables = {
        name: take(frame, rng.permutation(len(frame["model"])))
        for name, frame in prediction_set().to_frames(data()).items()
    }
    predictions = PredictionSet.of_rows(rows_of(tables, mixed))
    again = results_document(small_protocol(), mixed, predictions, risk_fit(), noise(), warnings=[WARNING])
    assert again == results()


def test_metric_is_the_mean_over_seeds_of_a_mean_over_groups() -> None:
    part, train = data().part("test"), data().part("train").outcomes.scalars[..., 2]
    iqr = np.subtract(*np.quantile(train, [0.75, 0.25]))
    errors = np.abs(prediction_set().scalars("M3", "test")[..., 2] - part.outcomes.scalars[..., 2])
    by_seed = errors.mean(axis=(1, 2)) / iqr
    found = estimates(results())["M3", "nmae.displacement_m"]
    assert found["value"] == pytest.approx(by_seed.mean())
    assert found["by_seed"] == pytest.approx(by_seed.tolist())
    assert found["seed_sd"] == pytest.approx(by_seed.std(ddof=1))
    assert found["num_groups"] == len(part.groups)


def test_what_is_not_defined_is_null() -> None:
    assert estimates(results())["M0", "spearman.min_ttc_s"]["value"] is None
    assert estimates(results())["M0", "macro_nmae"]["seed_sd"] is None
    assert results()["noise"]["tolerance"][0] is None


def test_family_keeps_its_declared_size() -> None:
    """Members without predictions count with p = 1, and are not reported."""
    found = results()["prediction"]["comparisons"]
    p_values = {c["name"]: c["p"] for c in found}
    full = next(f for f in results()["prediction"]["families"] if f["name"] == "full")
    assert (full["num_declared"], full["num_evaluated"]) == (9, 4)
    names = [member["name"] for member in full["members"]]
    assert names == list(p_values)
    expected = holm([*p_values.values(), *[1.0] * 5])[:4]
    assert [member["p_holm"] for member in full["members"]] == pytest.approx(expected.tolist())
    expected = holm([*(c["p_clusters"] for c in found), *[1.0] * 5])[:4]
    assert [member["p_holm_clusters"] for member in full["members"]] == pytest.approx(expected.tolist())
    ranking = {f["name"]: (f["num_evaluated"], f["num_declared"]) for f in results()["ranking"]["families"]}
    assert ranking == {"ranking_structured": (8, 8), "ranking_full": (8, 24), "ranking_near_range": (2, 2)}


def test_model_that_knows_more_is_better() -> None:
    found = {c["name"]: c for c in results()["prediction"]["comparisons"]}
    assert found["M3-M1.macro_nmae"]["difference"] < 0
    assert found["M3-M1.macro_nmae"]["is_bound"]
    assert found["M3-M1.macro_nmae"]["p"] == pytest.approx(1 / 501)
    assert found["M3-M1.macro_nmae"]["p_clusters"] < 0.05
    assert found["M3-M1.macro_nmae"]["interval"]["cluster_high"] < 0
    assert (found["M3-M1.macro_nmae"]["num_groups"], found["M3-M1.macro_nmae"]["num_clusters"]) == (20, 10)


def test_everything_has_an_interval_by_clusters() -> None:
    document = results()
    intervals = [c["interval"] for section in ("prediction", "ranking") for c in document[section]["comparisons"]]
    intervals += [e["interval"] for e in document["prediction"]["estimates"] if e["value"] is not None]
    for profile in document["ranking"]["profiles"]:
        for entry in profile["entries"]:
            intervals += [*entry["intervals"].values(), entry["captured_interval"]]
    intervals += document["diagnostics"]["shuffles"]
    assert len(intervals) > 300
    assert all(found["cluster_low"] <= found["cluster_high"] for found in intervals)


def test_one_cluster_alone_says_nothing() -> None:
    """Values, and everything by groups, stay as they are."""
    one = dict(frames())
    contexts = one["contexts"]
    is_test = contexts["partition"] == "test"
    one["contexts"] = {**contexts, "route_cluster": np.where(is_test, 7, contexts["route_cluster"])}
    found = results_document(small_protocol(), BenchmarkData.of(in_one_frame(one), BANK), prediction_set())
    assert schema_mismatches(found, "results.schema.json") == []
    for section in ("prediction", "ranking"):
        for alone, one_of_many in zip(found[section]["comparisons"], results()[section]["comparisons"], strict=True):
            assert (alone["p_clusters"], alone["is_bound_clusters"], alone["num_clusters"]) == (1.0, False, 1)
            assert alone["interval"]["cluster_low"] is alone["intra_cluster_correlation"] is None
            assert alone["p"] == one_of_many["p"]
            assert alone["interval"]["low"] == pytest.approx(one_of_many["interval"]["low"])
    assert all(shuffle["cluster_low"] is None for shuffle in found["diagnostics"]["shuffles"])
    assert "| 1 cluster | - |" in render_tables(found)


def test_shuffles_hurt_what_is_read() -> None:
    found = {(s["model"], s["kind"]): s for s in results()["diagnostics"]["shuffles"] if s["metric"] == "ade_m"}
    assert found["M2", "action"]["shuffled"] == pytest.approx(found["M2", "action"]["value"])
    assert found["M1", "history"]["shuffled"] == pytest.approx(found["M1", "history"]["value"])
    for row in found.values():
        assert row["increase"] == pytest.approx(row["shuffled"] - row["value"])
        assert row["cluster_low"] - 1e-12 <= row["increase"] <= row["cluster_high"] + 1e-12
    assert all(found["M3", kind]["cluster_low"] > 0 for kind in ("action", "history", "joint"))


def test_every_selector_is_ranked_under_every_profile() -> None:
    ranking = results()["ranking"]
    assert [p["profile"] for p in ranking["profiles"]] == ["balanced", "safety", "progress", "comfort", "near_range"]
    for profile in ranking["profiles"]:
        entries = {entry["selector"]: entry for entry in profile["entries"]}
        assert list(entries) == [
            "random", "nominal", "action_prior", "fixed_brake", "O-M0", "O-M1", "O-M2", "O-M3", "oracle",
        ]  # fmt: skip
        assert entries["oracle"]["regret"] == 0
        assert entries["oracle"]["captured"] == pytest.approx(1)
        assert entries["oracle"]["captured_interval"]["low"] == pytest.approx(1)
        assert entries["nominal"]["difference"] == 0
        assert entries["random"]["concordance"] == pytest.approx(0.5)
        assert entries["action_prior"]["gate"] == {"mean_m": 0.0, "low": None, "high": None, "passed": True}
        gate = entries["random"]["gate"]
        assert gate["low"] < gate["mean_m"] < gate["high"]


def test_selector_comparison_is_the_mean_difference_of_values() -> None:
    ranking = results()["ranking"]
    entries = {entry["selector"]: entry for entry in ranking["profiles"][0]["entries"]}
    found = next(c for c in ranking["comparisons"] if c["name"] == "O-M3-action_prior.value.balanced")
    assert found["difference"] == pytest.approx(entries["O-M3"]["value"] - entries["action_prior"]["value"])


def test_guards_stand_side_by_side() -> None:
    guard = results()["guard"]
    assert guard["reason"] is None
    for profile in guard["profiles"]:
        chosen = {selection["selection"]: selection for selection in profile["selections"]}
        assert list(chosen) == list(SELECTIONS)
        assert chosen["nominal"]["figures"]["violation"]["value"] == 0
        assert chosen["unguarded"]["figures"]["retained_gain"]["value"] == pytest.approx(1)
        beyond = chosen["nominal"]["beyond_noise"]
        assert beyond["num_worse"] == beyond["num_better"] == [0] * 6
        assert beyond["standard_error"] == [None, *[0] * 5]
        beyond = chosen["unguarded"]["beyond_noise"]
        assert beyond["num_compared"] == [20] * 6
        assert beyond["num_worse"][0] == beyond["num_better"][0] == 0
        assert beyond["num_worse"][1] + beyond["num_better"][1] > 5
        assert 0 < beyond["standard_error"][1] <= 0.1 / np.sqrt(20) + 1e-12
        assert profile["trade_off"]["multipliers"][0] is None
        assert profile["conformal"]["refusal"] is None


def test_the_guard_has_the_candidate_of_action_prior() -> None:
    outcomes = data().part("test").targets.values[..., 1]
    for profile in results()["guard"]["profiles"]:
        ranked = next(p for p in results()["ranking"]["profiles"] if p["profile"] == profile["profile"])
        prior = BANK.keys.index(ranked["action_prior"])
        chosen = {selection["selection"]: selection["figures"] for selection in profile["selections"]}["action_prior"]
        assert chosen["violation"]["value"] == pytest.approx((outcomes[:, prior] < outcomes[:, 0] - 0.25).mean())
        entry = next(e for e in ranked["entries"] if e["selector"] == "action_prior")
        assert chosen["gain"]["value"] == pytest.approx(entry["difference"])


def test_limits_of_the_guard_are_those_of_the_protocol() -> None:
    guard = small_protocol().guard
    less = small_protocol(guard={**guard.model_dump(), "min_groups": 97, "coverage": 0.5, "tolerance_m": 0.25})
    found = results_document(less, data(), prediction_set(), risk_fit())["guard"]
    for profile in found["profiles"]:
        assert "expected at least 97 groups" in profile["conformal"]["refusal"]
        assert profile["global_margin"]["rank"] == 10
    other = small_protocol(guard={**guard.model_dump(), "tolerance_m": 0.5})
    reason = results_document(other, data(), prediction_set(), risk_fit())["guard"]["reason"]
    assert reason == "the risk was fitted for a tolerance of 0.25 m, not 0.5 m"


@pytest.mark.parametrize("missing", ["risk", "calibration", "model"])
def test_guard_that_cannot_be_judged_says_why(missing: str) -> None:
    known, predicted = data(), prediction_set()
    if missing == "calibration":
        parts = {name: part for name, part in known.parts.items() if name != "calibration"}
        known = BenchmarkData(parts, known.candidates, known.nominal, known.brakes)
    if missing == "model":
        predicted = PredictionSet({name: predicted.by_model[name] for name in ("M0", "M1")})
    found = results_document(small_protocol(), known, predicted, None if missing == "risk" else risk_fit())
    reasons = {
        "risk": "No risk was fitted.",
        "calibration": "The release has no partition 'calibration'.",
        "model": "M3 does not predict the partition 'val'.",
    }
    assert (found["guard"]["reason"], found["guard"]["profiles"]) == (reasons[missing], [])
    assert schema_mismatches(found, "results.schema.json") == []
    assert reasons[missing] in render_tables(found)
    assert set(found["guard"]["guarantee"].values()) == {None}
    assert promises(found) == []


def test_model_that_is_not_declared_stands_in_the_same_tables() -> None:
    theirs = PredictionSet({"theirs": {5: {"test": prediction_set().by_model["M3"][11]["test"]}}})
    found = results_document(small_protocol(), data(), prediction_set().joined(theirs))
    assert found["models"][-1] == {"id": "theirs", "title": "theirs", "seeds": [5], "declared": False}
    ours, their = (estimates(found)[model, "ade_m"] for model in ("M3", "theirs"))
    assert their["value"] == pytest.approx(ours["by_seed"][0])
    assert "theirs" not in {s["model"] for s in found["diagnostics"]["shuffles"]}
    assert "O-theirs" in {e["selector"] for e in found["ranking"]["profiles"][0]["entries"]}
    assert "theirs (not declared)" in render_tables(found)


def test_every_table_carries_the_warnings() -> None:
    text = render_tables(results())
    sections = text.split("\n## ")[1:]
    tables = [section for section in sections if "| --- |" in section]
    assert len(tables) > 15
    assert all(f"> **Warning.** {WARNING}" in section for section in tables)
    assert render_tables(parse_json(dump_json(results()))) == text


def test_tables_say_that_claims_are_judged_by_clusters_and_mark_bounds() -> None:
    text = render_tables(results())
    assert text.count(JUDGED_BY_CLUSTERS) == 2
    found = results()["prediction"]["comparisons"][0]
    assert found["is_bound_studentised"]
    row = next(
        line for line in text.split("\n") if line.startswith("| `M3-M1.macro_nmae` |") and "| 20 groups |" in line
    )
    assert row.split(" | ")[-2] == f"<= {1 / 201:.2g}"
    assert "standard deviation over shuffles" in text


def test_tables_say_that_a_family_is_not_complete() -> None:
    assert "Family `full`: 4 of 9 declared tests were evaluated" in render_tables(results())


def test_noise_comes_back_from_its_record() -> None:
    assert noise_record(noise_of(noise_record(noise()))) == noise_record(noise())


def test_groups_are_digested_in_sorted_order() -> None:
    assert groups_digest(["b", "a"]) == groups_digest(["a", "b"]) != groups_digest(["a"])


def test_group_that_repeats_is_refused() -> None:
    twice = dict(frames())
    twice["contexts"] = take(twice["contexts"], np.r_[0, np.arange(len(twice["contexts"]["group_id"]))])
    with pytest.raises(DatasetError, match="repeats a group"):
        BenchmarkData.of(in_one_frame(twice), BANK)
