"""What a population is too small for, said in sentences."""

from __future__ import annotations

from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.benchmark.shortage import inconclusive_sentence, shortage_sentences, sizes_sentence
from branchdrive.statistics.bca import LEAST_UNITS

GUARD = default_protocol().guard
ENOUGH = {"train": 431, "val": 88, "calibration": GUARD.min_groups, "test": 87}
CLUSTERS = {"train": 200, "val": 40, "calibration": GUARD.min_clusters, "test": LEAST_UNITS}


def test_partitions_that_are_large_enough_lack_nothing() -> None:
    assert shortage_sentences(ENOUGH, CLUSTERS, GUARD) == []
    assert sizes_sentence(ENOUGH, CLUSTERS) == (
        "The release has 431 groups in 200 route clusters in `train`, 88 groups in 40 route clusters in `val`, "
        "88 groups in 48 route clusters in `calibration`, 87 groups in 6 route clusters in `test`."
    )


def test_every_shortage_has_a_sentence() -> None:
    groups, clusters = {"train": 3, "test": 9}, {"train": 1, "test": LEAST_UNITS - 1}
    assert shortage_sentences(groups, clusters) == [
        "No group is in `val`, on which models are chosen.",
        "Nothing can be concluded: `test` has 9 groups in 5 route clusters, and intervals and tests of 95 % take 6 or "
        "more.",
    ]
    assert shortage_sentences(groups, clusters)[1] == inconclusive_sentence(groups, clusters)
    assert shortage_sentences({}, {}) == [
        f"No group is in `{name}`, on which models are {verb}."
        for name, verb in (("train", "fitted"), ("val", "chosen"), ("test", "judged"))
    ]


def test_a_guard_takes_groups_and_clusters_to_be_calibrated_on() -> None:
    (none,) = shortage_sentences({**ENOUGH, "calibration": 0}, {**CLUSTERS, "calibration": 0}, GUARD)
    assert none.startswith(
        "The selection-path guard will stay at nominal: `calibration` has 0 groups in 0 route clusters"
    )
    assert "takes 88 groups in 48 route clusters or more" in none
    for less in ({"calibration": GUARD.min_groups - 1}, {}):
        few = {**CLUSTERS, "calibration": GUARD.min_clusters - (not less)}
        assert len(shortage_sentences({**ENOUGH, **less}, few, GUARD)) == 1
        assert shortage_sentences({**ENOUGH, **less}, few) == []
