"""Defects and limits of predictions, results and tables of the benchmark layer."""

from __future__ import annotations

import numpy as np
from tests.validator.engine.rules.benchmark_release import (
    BENCHMARK_LEDGER,
    LATENCY,
    LOCK,
    PROTOCOL,
    RANKING_LOCK,
    RESULTS,
    SCALARS,
    TABLES_FILE,
    BenchmarkDraft,
    first_of,
)
from tests.validator.engine.rules.case import boundary, mutant

from branchdrive.benchmark.guard.calibration import GUARANTEE
from branchdrive.benchmark.prediction.metric.table import Interval
from branchdrive.benchmark.prediction.record import interval_record
from branchdrive.benchmark.prediction.rows import TABLES
from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.benchmark.protocol.selection import Neighbours, Prior, Ridge, Selection
from branchdrive.benchmark.ranking.ending import COMPARED, RATES
from branchdrive.benchmark.warning import warnings
from branchdrive.tables.frame import concat, take

# Limits


@boundary("BD-BMK-012", "BD-BMK-013")
def results_with_other_last_bits(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["prediction"]["estimates"][0]["value"] *= 1 + 1e-12
    d.follow("tables")


_UNKNOWN = {"value": None, "low": None, "high": None}
_NO_ENDINGS = {
    **dict.fromkeys(RATES, _UNKNOWN), "known": 0.0, "to_nominal": dict.fromkeys(COMPARED, _UNKNOWN),
    "route_fraction": {
        "mean": None, "interval": interval_record(Interval(*(np.nan,) * 4, 0, np.nan, np.nan, 0)),
    },
}  # fmt: skip


def declare_outcomes(d: BenchmarkDraft) -> None:
    """Declare outcomes of selections and a profile with a near range, and evaluate under that protocol."""
    document = default_protocol().document
    d.documents[PROTOCOL]["outcomes"] = document["outcomes"]
    d.documents[PROTOCOL]["profiles"] += [weights for weights in document["profiles"] if "near_m" in weights]
    grids = d.documents[RANKING_LOCK]["risk_fit"]["grids"]
    grids["near_range"] = grids["balanced"]
    d.follow("lock")


@boundary("BD-BMK-001", "BD-BMK-012", "BD-BMK-013")
def outcomes_of_selections_are_declared(d: BenchmarkDraft) -> None:
    declare_outcomes(d)


@boundary("BD-BMK-012", "BD-BMK-013", "BD-BMK-002", "BD-REL-003")
def endings_of_selections(d: BenchmarkDraft) -> None:
    declare_outcomes(d)
    d.add_endings()


@boundary("BD-BMK-012", "BD-BMK-013")
def endings_that_no_protocol_asks_for(d: BenchmarkDraft) -> None:
    d.add_endings()


def _declare_baselines(d: BenchmarkDraft) -> None:
    """What sees labels, a history and evidence, with what is ranked beside it."""
    declared = (
        Prior(name="type_prior", kind="prior", by=("scenario_type",), strength=10.0),
        Neighbours(name="neighbours", kind="neighbours", contract="sensor", neighbours=15),
        Ridge(name="ridge_privileged", kind="ridge", contract="privileged", strength=1.0),
    )
    selection = Selection(ensembles=True, references=("type_prior",), baselines=declared)
    d.documents[PROTOCOL]["selection"] = selection.model_dump(mode="json")
    d.follow("lock")


@boundary("BD-BMK-012", "BD-BMK-013")
def results_with_baselines(d: BenchmarkDraft) -> None:
    _declare_baselines(d)


@boundary("BD-BMK-016", "BD-BMK-013", base="benchmark")
def latencies_whose_median_is_their_quantile(d: BenchmarkDraft) -> None:
    d.add_latencies()


# BD-BMK-007


@mutant("BD-BMK-007", at={"file": SCALARS, "model": "M3", "seed": 23, "action_key": "brake_0.50"})
def prediction_without_a_candidate(d: BenchmarkDraft) -> None:
    d.drop("predictions", model="M3", seed=23, group_id=first_of(d, "test"), action_key="brake_0.50")


@mutant("BD-BMK-007", at={"file": "benchmark/predicted_trajectories-00000.parquet", "step": 4})
def predicted_trajectory_without_a_step(d: BenchmarkDraft) -> None:
    where = {"model": "M1", "seed": 11, "group_id": first_of(d, "val"), "action_key": "nominal", "step": 4}
    d.drop("predicted_trajectories", **where)


@mutant("BD-BMK-007", at={"file": SCALARS, "model": "M0"}, findings=2)
def prediction_of_a_training_group(d: BenchmarkDraft) -> None:
    for name in TABLES:
        rows = d.frame(name)
        wanted = (rows["model"] == "M0") & (rows["group_id"] == first_of(d, "test"))
        more = take(rows, wanted)
        more["group_id"] = np.full(int(wanted.sum()), first_of(d, "train"), object)
        d.put(name, concat([rows, more]))


# BD-BMK-008


@mutant("BD-BMK-008", at={"file": SCALARS, "model": "M2"})
def declared_seed_that_does_not_predict(d: BenchmarkDraft) -> None:
    for name in TABLES:
        d.drop(name, model="M2", seed=37)
    d.follow("ranking")


# BD-BMK-009


@mutant("BD-BMK-009", at={"file": RANKING_LOCK, "pointer": "/kind"})
def ranking_lock_of_another_kind(d: BenchmarkDraft) -> None:
    d.documents[RANKING_LOCK] = dict(d.documents[LOCK])
    d.follow("accesses", keep={"results", "tables"})


@mutant("BD-BMK-009", at={"file": RANKING_LOCK, "pointer": "/utility_scale/q05/0"})
def utility_scaled_by_other_quantiles(d: BenchmarkDraft) -> None:
    d.documents[RANKING_LOCK]["utility_scale"]["q05"][0] -= 1
    d.follow("accesses", keep={"results", "tables"})


@mutant("BD-BMK-009", at={"file": RANKING_LOCK, "pointer": "/predictions_digest"})
def prediction_changed_after_the_ranking_lock(d: BenchmarkDraft) -> None:
    where = {"model": "M3", "seed": 11, "group_id": first_of(d, "test"), "action_key": "nominal"}
    d.set("predictions", "displacement_m", lambda value: value + 1, **where)
    d.follow("results")


# BD-BMK-012


@mutant("BD-BMK-012", at={"file": RESULTS})
def better_metric_than_predicted(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["prediction"]["estimates"][0]["value"] *= 0.99
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS})
def smaller_p_value_than_the_family_has(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["ranking"]["families"][0]["members"][0]["p_holm"] = 0.001
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS, "pointer": "/prediction/comparisons/0/p_clusters"})
def smaller_p_value_by_clusters(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["prediction"]["comparisons"][0]["p_clusters"] -= 1e-3
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS, "pointer": "/ranking/profiles/0/entries/0/intervals/value/cluster_low"})
def narrower_interval_by_clusters(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["ranking"]["profiles"][0]["entries"][0]["intervals"]["value"]["cluster_low"] += 1e-6
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS, "pointer": "/ranking/profiles/0/entries/8/outcomes/contact/value"})
def fewer_contacts_than_were_recorded(d: BenchmarkDraft) -> None:
    declare_outcomes(d)
    d.documents[RESULTS]["ranking"]["profiles"][0]["entries"][8]["outcomes"]["contact"]["value"] += 0.25
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS, "pointer": "/ranking/profiles/0/entries/8/outcomes/endings/collision/high"})
def fewer_collisions_than_drives_allow_for(d: BenchmarkDraft) -> None:
    endings_of_selections(d)
    d.documents[RESULTS]["ranking"]["profiles"][0]["entries"][8]["outcomes"]["endings"]["collision"]["high"] -= 0.05
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS, "pointer": "/ranking/profiles/0/num_with_clean"})
def more_groups_with_a_clean_drive(d: BenchmarkDraft) -> None:
    endings_of_selections(d)
    d.documents[RESULTS]["ranking"]["profiles"][0]["num_with_clean"] += 1
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS})
def oracle_of_clean_drives_left_out(d: BenchmarkDraft) -> None:
    endings_of_selections(d)
    for profile in d.documents[RESULTS]["ranking"]["profiles"][:1]:
        profile["entries"] = [entry for entry in profile["entries"] if entry["selector"] != "oracle_clean"]
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS, "pointer": "/ranking/profiles/0/entries/0/outcomes/endings"})
def endings_that_the_release_does_not_tell(d: BenchmarkDraft) -> None:
    declare_outcomes(d)
    d.documents[RESULTS]["ranking"]["profiles"][0]["entries"][0]["outcomes"]["endings"] = _NO_ENDINGS
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS, "pointer": "/ranking/profiles/0/entries/4/regret"})
def baseline_that_is_worse_than_it_is(d: BenchmarkDraft) -> None:
    _declare_baselines(d)
    d.documents[RESULTS]["ranking"]["profiles"][0]["entries"][4]["regret"] += 0.05
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS})
def guarantee_of_a_guard_that_was_not_judged(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["guard"]["guarantee"]["conformal"] = GUARANTEE
    d.follow("tables")


@mutant("BD-BMK-012", at={"file": RESULTS})
def fewer_repeats_that_lose_than_were_locked(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["noise"]["losses"]["num_repeats_losing"] -= 1
    d.follow("tables")


# BD-BMK-013


@mutant("BD-BMK-013", at={"file": TABLES_FILE})
def tables_without_results(d: BenchmarkDraft) -> None:
    del d.documents[RESULTS]


@mutant("BD-BMK-013", at={"file": TABLES_FILE})
def tables_that_flatter(d: BenchmarkDraft) -> None:
    text = d.texts[TABLES_FILE]
    line = next(line for line in text.split("\n") if line.startswith("| M3 "))
    d.texts[TABLES_FILE] = text.replace(line, line.replace("0.", "0.0", 1), 1)


@mutant("BD-BMK-013", at={"file": TABLES_FILE})
def tables_that_call_drives_safe(d: BenchmarkDraft) -> None:
    endings_of_selections(d)
    d.texts[TABLES_FILE] = d.texts[TABLES_FILE].replace("nothing here is called safe", "the drives are safe")


@mutant("BD-BMK-013", at={"file": TABLES_FILE})
def tables_without_the_latencies(d: BenchmarkDraft) -> None:
    text = d.texts[TABLES_FILE]
    d.add_latencies()
    d.texts[TABLES_FILE] = text


# BD-BMK-015


@mutant("BD-BMK-015", at={"file": SCALARS, "model": "theirs"})
def predictions_that_nobody_locked(d: BenchmarkDraft) -> None:
    for name in TABLES:
        rows = d.frame(name)
        is_test = np.isin(rows["group_id"].astype(str), d.data.part("test").groups)
        more = take(rows, is_test & (rows["model"] == "M3") & (rows["seed"] == 11))
        more["model"] = np.full(len(more["model"]), "theirs", object)
        d.put(name, concat([rows, more]))
    d.warnings = warnings(d.documents[BENCHMARK_LEDGER], unlocked=["theirs"])
    d.follow("ranking")


# BD-BMK-016


@mutant("BD-BMK-016", at={"file": LATENCY, "pointer": "/prediction_lock_digest"}, base="benchmark")
def latencies_under_another_lock(d: BenchmarkDraft) -> None:
    d.add_latencies(prediction_lock_digest="0" * 64)


@mutant("BD-BMK-016", at={"file": LATENCY, "pointer": "/num_candidates"}, base="benchmark")
def latencies_of_another_bank(d: BenchmarkDraft) -> None:
    d.add_latencies(num_candidates=len(d.data.candidates) + 1)


@mutant("BD-BMK-016", at={"file": LATENCY, "pointer": "/models"}, base="benchmark")
def latencies_without_a_model(d: BenchmarkDraft) -> None:
    d.add_latencies()
    d.documents[LATENCY]["models"].pop()
    d.follow("tables")


@mutant("BD-BMK-016", at={"file": LATENCY, "pointer": "/models/3/num_seeds"}, base="benchmark")
def latencies_of_fewer_seeds(d: BenchmarkDraft) -> None:
    d.add_latencies()
    d.documents[LATENCY]["models"][3]["num_seeds"] -= 1
    d.follow("tables")


@mutant("BD-BMK-016", at={"file": LATENCY, "pointer": "/models/1/torch/median_ms"}, base="benchmark")
def median_above_the_quantile(d: BenchmarkDraft) -> None:
    d.add_latencies()
    d.documents[LATENCY]["models"][1]["torch"] = {"median_ms": 1.6, "quantile_95_ms": 1.5}
    d.follow("tables")
