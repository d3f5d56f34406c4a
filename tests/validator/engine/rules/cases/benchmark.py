"""Defects and limits of the benchmark layer: protocol, locks, checkpoints, test-set accesses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.validator.engine.rules.benchmark_release import (
    BENCHMARK_LEDGER,
    LOCK,
    PROTOCOL,
    RANKING_LOCK,
    RESULTS,
    TABLES_FILE,
    BenchmarkDraft,
    checkpoint,
    first_of,
    identity,
)
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import LEDGER

from branchdrive.benchmark.checkpoint import CheckpointFacts, checkpoint_facts
from branchdrive.benchmark.prediction.data import groups_digest
from branchdrive.benchmark.warning import warnings
from branchdrive.quality.ledger import PREDICTION_ACCESS, SELECTION_ACCESS, merged, with_benchmark_access

CHECKPOINT = "checkpoints/M3-seed11.safetensors"


ENTRY = 7
"""Its place in the lock."""


NOTHING = "0" * 64


def trained_on(d: BenchmarkDraft, *more: str) -> str:
    """Digest of the training groups and further ones."""
    return groups_digest([*d.data.part("train").groups, *more])


def facts_of(content: bytes) -> CheckpointFacts:
    return checkpoint_facts(content, len(content))


def say(d: BenchmarkDraft, **facts: Any) -> None:
    """Let the checkpoint say something else of itself."""
    d.checkpoints[CHECKPOINT] = checkpoint(facts_of(d.checkpoints[CHECKPOINT])._replace(**facts))


# Limits


@boundary(
    "BD-BMK-002", "BD-BMK-003", "BD-BMK-004", "BD-BMK-005", "BD-BMK-006", "BD-BMK-007", "BD-BMK-008", "BD-BMK-011",
    "BD-BMK-014", "BD-BMK-015", "BD-LYR-001",
    base="benchmark",
)  # fmt: skip
def benchmark_that_is_not_evaluated_yet(d: BenchmarkDraft) -> None:
    for path in (RESULTS, RANKING_LOCK):
        del d.documents[path]
    del d.texts[TABLES_FILE]
    d.documents[BENCHMARK_LEDGER]["entries"] = []


@boundary("BD-BMK-001")
def weights_that_add_up_but_for_rounding(d: BenchmarkDraft) -> None:
    d.documents[PROTOCOL]["profiles"][1]["comfort"] += 5e-10
    d.follow("lock")


@boundary("BD-BMK-009", "BD-BMK-010")
def learned_risk_of_which_a_weight_is_zero(d: BenchmarkDraft) -> None:
    d.documents[RANKING_LOCK]["risk_fit"]["logistic"][0] = 0.0
    scale = d.documents[RANKING_LOCK]["utility_scale"]
    scale["q05"][0] *= 1 + 1e-12
    d.follow("accesses")


@boundary("BD-LAY-009", "BD-BMK-004", base="benchmark")
def figures_beside_results(d: BenchmarkDraft) -> None:
    def draw(root: Path) -> None:
        (root / "benchmark/figures").mkdir()
        (root / "benchmark/figures/policy.svg").write_text("<svg/>")
        (root / "benchmark/figures/policy.png").write_bytes(b"png")

    d.before_seal(draw)


# BD-BMK-001


def contradicts(d: BenchmarkDraft) -> None:
    """Lock a protocol from which nothing can be computed."""
    d.follow("lock", keep={"ranking", "results", "tables"})


@mutant("BD-BMK-001", at={"file": PROTOCOL})
def profile_that_weighs_too_much(d: BenchmarkDraft) -> None:
    d.documents[PROTOCOL]["profiles"][1]["comfort"] = 0.9
    contradicts(d)


@mutant("BD-BMK-001", at={"file": PROTOCOL})
def configuration_whose_name_leads_out_of_the_release(d: BenchmarkDraft) -> None:
    d.documents[PROTOCOL]["models"][3]["configuration"]["model"]["name"] = "../../x/pwn"
    contradicts(d)


@mutant("BD-BMK-001", at={"file": PROTOCOL})
def sensor_model_that_reads_privileged_inputs(d: BenchmarkDraft) -> None:
    d.documents[PROTOCOL]["models"][3]["configuration"]["model"]["contract"] = "privileged"
    contradicts(d)


@mutant("BD-BMK-001", at={"file": PROTOCOL})
def two_tests_of_one_name_in_two_families(d: BenchmarkDraft) -> None:
    for name, left, right in (("one", "A-B", "C"), ("other", "A", "B-C")):
        members = [{"left": left, "right": right, "metric": "ade_m"}]
        d.documents[PROTOCOL]["families"].append({"name": name, "kind": "prediction", "members": members})
    contradicts(d)


@mutant("BD-BMK-001", at={"file": PROTOCOL})
def more_tests_than_can_be_computed(d: BenchmarkDraft) -> None:
    members = [{"left": f"A{i}", "right": "B", "metric": "ade_m"} for i in range(212)]
    d.documents[PROTOCOL]["families"].append({"name": "large", "kind": "prediction", "members": members})
    contradicts(d)


# BD-BMK-002


@mutant("BD-BMK-002", at={"file": LOCK, "pointer": "/features_digest"})
def lock_of_other_features(d: BenchmarkDraft) -> None:
    d.documents[LOCK]["features_digest"] = NOTHING
    d.follow("ranking")


@mutant("BD-BMK-002", at={"file": LOCK, "pointer": "/release_identity"})
def lock_of_another_release(d: BenchmarkDraft) -> None:
    d.documents[LOCK]["release_identity"] = NOTHING
    d.follow("ranking")


@mutant("BD-BMK-002", at={"file": LOCK, "pointer": "/protocol_digest"})
def protocol_changed_after_the_lock(d: BenchmarkDraft) -> None:
    d.documents[PROTOCOL]["statistics"]["seed"] = 1
    d.follow("results")


@mutant("BD-BMK-002", at={"file": LOCK, "pointer": "/kind"})
def lock_of_another_kind(d: BenchmarkDraft) -> None:
    d.documents[LOCK] = dict(d.documents[RANKING_LOCK])
    d.follow("ranking")


@mutant("BD-BMK-002", at={"file": LOCK, "pointer": "/release_identity"})
def access_taken_off_the_ledger_after_the_lock(d: BenchmarkDraft) -> None:
    put_on_the_ledger(d)
    d.follow("lock")
    del d.documents[LEDGER]["entries"][-2:]
    d.reseal("card")
    d.warnings = []
    d.follow("results")


# BD-BMK-003


@mutant("BD-BMK-003", at={"file": LOCK})
def checkpoint_of_a_seed_that_is_not_declared(d: BenchmarkDraft) -> None:
    entries = d.documents[LOCK]["checkpoints"]
    more = "checkpoints/M3-seed5.safetensors"
    facts = facts_of(d.checkpoints[CHECKPOINT])
    d.checkpoints[more] = checkpoint(facts._replace(seed=5))
    entries.append({**entries[ENTRY], "seed": 5, "file": more})
    d.follow("lock")


# BD-BMK-004


@mutant("BD-BMK-004", at={"file": f"benchmark/{CHECKPOINT}"})
def checkpoint_swapped_after_the_lock(d: BenchmarkDraft) -> None:
    d.checkpoints[CHECKPOINT] = checkpoint(facts_of(d.checkpoints[CHECKPOINT]), b"other weights")
    d.warnings = warnings(d.documents[BENCHMARK_LEDGER], changed=[CHECKPOINT])
    d.follow("results")


@mutant("BD-BMK-004", at={"file": f"benchmark/{CHECKPOINT}"})
def checkpoint_that_is_gone(d: BenchmarkDraft) -> None:
    del d.checkpoints[CHECKPOINT]
    d.warnings = warnings(d.documents[BENCHMARK_LEDGER], changed=[CHECKPOINT])
    d.follow("results")


@mutant("BD-BMK-004", at={"file": "benchmark/checkpoints/M3-seed5.safetensors"})
def checkpoint_that_the_lock_does_not_name(d: BenchmarkDraft) -> None:
    d.checkpoints["checkpoints/M3-seed5.safetensors"] = d.checkpoints[CHECKPOINT]


# BD-BMK-005


@mutant("BD-BMK-005", at={"file": LOCK, "pointer": f"/checkpoints/{ENTRY}/training_groups_digest"})
def test_group_in_training(d: BenchmarkDraft) -> None:
    digest = trained_on(d, first_of(d, "test"))
    say(d, training_groups_digest=digest)
    d.documents[LOCK]["checkpoints"][ENTRY]["training_groups_digest"] = digest
    d.follow("lock")


# BD-BMK-006


@mutant("BD-BMK-006", at={"file": f"benchmark/{CHECKPOINT}"})
def test_group_in_training_that_the_lock_hides(d: BenchmarkDraft) -> None:
    say(d, training_groups_digest=trained_on(d, first_of(d, "test")))
    d.follow("lock")


@mutant("BD-BMK-006", at={"file": f"benchmark/{CHECKPOINT}"})
def checkpoint_of_another_configuration(d: BenchmarkDraft) -> None:
    say(d, config_digest=NOTHING)
    d.follow("lock")


@mutant("BD-BMK-006", at={"file": f"benchmark/{CHECKPOINT}"})
def checkpoint_without_a_header(d: BenchmarkDraft) -> None:
    d.checkpoints[CHECKPOINT] = b"\xff" * 64
    d.follow("lock")


@mutant("BD-BMK-006", at={"file": f"benchmark/{CHECKPOINT}"})
def checkpoint_with_a_rest_behind_its_tensors(d: BenchmarkDraft) -> None:
    d.checkpoints[CHECKPOINT] += b"PK"
    d.follow("lock")


# BD-BMK-010


@mutant("BD-BMK-010", at={"file": RANKING_LOCK})
def risk_that_rises_with_separation(d: BenchmarkDraft) -> None:
    d.documents[RANKING_LOCK]["risk_fit"]["logistic"][0] = 1.0
    d.follow("accesses", keep={"results", "tables"})


@mutant("BD-BMK-010", at={"file": RANKING_LOCK, "pointer": "/risk_fit/tolerance_m"})
def risk_of_another_tolerance(d: BenchmarkDraft) -> None:
    d.documents[RANKING_LOCK]["risk_fit"]["tolerance_m"] = 1000.0
    d.follow("accesses")


@mutant("BD-BMK-010", at={"file": RANKING_LOCK, "pointer": "/further_risk_fits/0"})
def risk_of_a_guard_that_nobody_declared(d: BenchmarkDraft) -> None:
    lock = d.documents[RANKING_LOCK]
    lock["further_risk_fits"] = [{"model": "M1", "tolerance_m": 0.25, "risk_fit": lock["risk_fit"]}]
    d.follow("accesses")


# BD-BMK-011


@mutant("BD-BMK-011", at={"file": BENCHMARK_LEDGER, "pointer": "/entries/1/number"})
def access_out_of_count(d: BenchmarkDraft) -> None:
    d.documents[BENCHMARK_LEDGER]["entries"][1]["number"] = 5


@mutant("BD-BMK-011", at={"file": BENCHMARK_LEDGER, "pointer": "/entries/0/lock_digest"})
def access_under_another_lock(d: BenchmarkDraft) -> None:
    d.documents[BENCHMARK_LEDGER]["entries"][0]["lock_digest"] = NOTHING


@mutant("BD-BMK-011", at={"file": BENCHMARK_LEDGER, "pointer": "/entries/2/lock_digest"})
def access_recorded_again(d: BenchmarkDraft) -> None:
    entries = d.documents[BENCHMARK_LEDGER]["entries"]
    entries.append({**entries[0], "number": 3})


@mutant("BD-BMK-011", at={"file": BENCHMARK_LEDGER, "pointer": "/entries/2/event"})
def event_of_the_release_in_the_ledger_of_the_benchmark(d: BenchmarkDraft) -> None:
    d.documents[BENCHMARK_LEDGER]["entries"].append({**d.documents[LEDGER]["entries"][0], "number": 3})


@mutant("BD-BMK-011", at={"file": BENCHMARK_LEDGER, "pointer": "/entries"})
def access_that_is_not_recorded(d: BenchmarkDraft) -> None:
    d.documents[BENCHMARK_LEDGER]["entries"].pop()


# BD-BMK-014


@mutant("BD-BMK-014", at={"file": BENCHMARK_LEDGER})
def test_accessed_twice(d: BenchmarkDraft) -> None:
    document = with_benchmark_access(None, PREDICTION_ACCESS, NOTHING)
    document = with_benchmark_access(document, PREDICTION_ACCESS, d.digest(LOCK))
    d.documents[BENCHMARK_LEDGER] = with_benchmark_access(document, SELECTION_ACCESS, d.digest(RANKING_LOCK))
    d.warnings = warnings(d.documents[BENCHMARK_LEDGER])
    d.follow("results")


@mutant("BD-BMK-014", at={"file": BENCHMARK_LEDGER})
def lock_that_was_gone_back_to(d: BenchmarkDraft) -> None:
    d.documents[BENCHMARK_LEDGER] = with_benchmark_access(d.documents[BENCHMARK_LEDGER], PREDICTION_ACCESS, NOTHING)
    d.warnings = warnings(d.documents[BENCHMARK_LEDGER])
    d.follow("results")


def put_on_the_ledger(d: BenchmarkDraft) -> None:
    """Accesses of a benchmark that is gone, in a release that was locked after it."""
    gone = with_benchmark_access(with_benchmark_access(None, PREDICTION_ACCESS, NOTHING), SELECTION_ACCESS, NOTHING)
    d.documents[LEDGER] = merged(d.documents[LEDGER], gone)
    d.reseal("card")
    d.documents[LOCK]["release_identity"] = identity(d)
    has_calibration = "calibration" in d.data.parts
    d.warnings = warnings(
        d.documents[BENCHMARK_LEDGER], of_release=d.documents[LEDGER], has_calibration=has_calibration
    )


@mutant("BD-BMK-014", at={"file": BENCHMARK_LEDGER}, findings=2)
def test_accessed_by_a_benchmark_that_is_gone(d: BenchmarkDraft) -> None:
    put_on_the_ledger(d)
    d.follow("lock")


@boundary("BD-BMK-002", "BD-BMK-014", "BD-FID-010", "BD-FID-012", "BD-REL-003", base="benchmark")
def benchmark_after_another_that_is_not_evaluated_yet(d: BenchmarkDraft) -> None:
    put_on_the_ledger(d)
    d.follow("lock", keep={"results", "tables"})
    benchmark_that_is_not_evaluated_yet(d)
