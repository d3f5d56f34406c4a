"""Sentences about documents: shares that never round to all or nothing, test-set accesses, targets and leakage."""

from __future__ import annotations

import pytest
from tests.validator.quality.release import DIGEST, documents, leakage, paper_groups, paper_pairs

from branchdrive.contract.text import percent
from branchdrive.leakage.text import leakage_sentences
from branchdrive.quality.ledger import merged, with_round
from branchdrive.quality.text import access_sentence, benchmark_sentences, population_sentences, target_sentences

OTHER = "e" * 64
LOCKS = {"entries": [{"event": "test_accessed_for_predictions", "lock_digest": digest} for digest in (DIGEST, OTHER)]}


@pytest.mark.parametrize(
    ("share", "text"),
    [(0, "0.00%"), (1, "100.00%"), (0.5, "50.00%"), (0.99999999, "99.99%"), (1e-9, "0.01%"), (1078 / 1140, "94.56%")],
)
def test_a_share_is_never_rounded_to_all_or_nothing(share: float, text: str) -> None:
    assert percent(share) == text


def test_one_access_is_said_and_more_are_warned_of() -> None:
    once = with_round(None, split_digest=DIGEST, thresholds_digest=DIGEST)
    assert access_sentence({"entries": []}) == "The test partition has not been accessed."
    assert "accessed once" in access_sentence(once)
    twice = with_round(once, split_digest=OTHER, thresholds_digest=DIGEST)
    assert "accessed 2 times" in access_sentence(twice)
    assert "no longer an untouched test set" in access_sentence(twice)


def test_accesses_for_benchmarks_that_are_gone_are_said() -> None:
    once = with_round(None, split_digest=DIGEST, thresholds_digest=DIGEST)
    assert benchmark_sentences(once) == []
    ledger = merged(once, LOCKS)
    assert ledger is not None
    (sentence,) = benchmark_sentences(ledger)
    assert "accessed the test partition 2 times for predictions and 0 times for selections" in sentence
    assert access_sentence(ledger) == access_sentence(once)


def test_a_missed_target_is_said_plainly() -> None:
    groups = paper_groups()
    assert target_sentences(documents(groups, paper_pairs(groups)).retention) == [
        "1,078 of 1,140 pairs passed, 94.56%: the predeclared target of 98% was not met.",
        "87 of 95 complete banks passed, 91.58%: the predeclared target of 90% was met.",
    ]


def test_what_the_population_leaves_out_is_said() -> None:
    stages = [
        {"stage": "core_valid", "groups": {"train": 3, "val": 2}, "total": 5},
        {"stage": "frozen", "groups": {"train": 3, "val": 0}, "total": 3},
    ]
    assert population_sentences({"partitions": ["train", "val"], "stages": stages}) == [
        "2 core-valid groups are left out as near duplicates of another partition.",
        "The frozen population has no group in: Validation. A benchmark takes groups in train, val and test. "
        "Collect more groups.",
    ]
    stages[1] = {"stage": "frozen", "groups": {"train": 3, "val": 2}, "total": 5}
    assert population_sentences({"partitions": ["train", "val"], "stages": stages}) == []
    stages[1]["groups"] = {"train": 3, "test": 2}
    assert population_sentences({"partitions": ["train", "test"], "stages": stages}) == [
        "With 2 test groups a benchmark concludes nothing: intervals and tests of 95 % take 6 route clusters or more."
    ]


def test_what_was_not_audited_is_said() -> None:
    (sentence,) = leakage_sentences(None)
    assert sentence.startswith("Leakage was not audited")


def test_a_pass_comes_with_its_minimum_detectable_effect() -> None:
    assert leakage_sentences(leakage()) == [
        "The leakage gate passes: its tests found nothing before the branch that tells the actions apart "
        "(606 groups, 12 actions, 24 features and 1,908 recorded columns before the branch).",
        "This is why.",
        "Minimum detectable effect in one feature of one action: above 0.8 standard deviations.",
        "Minimum detectable effect as a dose over all actions on a quarter of the features: "
        "at most 0.4 standard deviations.",
        "Minimum detectable effect as such a dose in one group of ten: 6.4 standard deviations.",
        "Minimum detectable effect as such a dose in one group of thirty: above 6.4 standard deviations.",
        "No images that models may read were recorded.",
        "Not examined by the gate: which actor is which, spreads of recorded columns that are no features, digits "
        "below the noise, relations between columns other than products of two commands, relations between actions, "
        "orders of actions that groups do not share, and a code in fewer than one group of thirty that hides in noise. "
        "A smaller effect, or one of another form, may be there; in one column of few groups it takes more than in a "
        "quarter of the features.",
        "The battery of classifiers, a diagnostic beside the gate: 2 pass, 2 inconclusive, 2 not run.",
        "PyTorch is not installed.",
    ]


def test_a_failure_is_localised() -> None:
    text = leakage_sentences(leakage("fail"))
    assert "cannot be trusted" in text[0]
    assert text[2:5] == ["Action brake_0.30 differs in ego speed_mps at tick -5 by 0.25 (adjusted p 0.0001)."] * 3
    light = "recorded evidence traffic_light at tick -5"
    assert text[5:7] == [
        f"Groups put their actions in one order in {light} (21 groups, adjusted p 0.0001).",
        f"A product tells the actions apart: {light} and {light} (21 groups, adjusted p 0.0001).",
    ]


@pytest.mark.parametrize(("identical", "why"), [(True, "replays are bit-identical"), (False, "no feature has a value")])
def test_an_effect_that_does_not_apply_says_why(identical: bool, why: str) -> None:
    text = leakage_sentences(leakage(bit_identical=identical, minimum_detectable_effect=None))
    assert any(sentence.startswith(f"Minimum detectable effect: not applicable, {why}") for sentence in text)
