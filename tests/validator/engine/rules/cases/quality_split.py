"""Defects and limits of clusters, partitions and their document."""

from __future__ import annotations

from tests.synthetic_release import LOST, SEED, TWINS
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import SPLIT, ReleaseDraft

from branchdrive.release.stage import BuildOptions
from branchdrive.statistics.split import Calibration

ALL = tuple(f"BD-SPL-{number:03d}" for number in range(1, 9))


@boundary(*ALL, "BD-FID-010", "BD-LYR-010", "BD-MOD-021")
def split_with_a_calibration_partition(d: ReleaseDraft) -> None:
    d.rebuild(BuildOptions(seed=SEED + 1, calibration=Calibration(2, 2)))
    assert d.documents[SPLIT]["partitions"]["calibration"]["clusters"] >= 2


@boundary(*ALL)
def split_of_a_large_seed(d: ReleaseDraft) -> None:
    d.rebuild(BuildOptions(seed=2**63 - 3))


@boundary("BD-SPL-003", "BD-SPL-004", "BD-SPL-006", base="alone")
def cluster_moved_as_a_whole(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", "val", group_id=list(TWINS))
    d.reseal("split")


# BD-SPL-001


@mutant("BD-SPL-001", at={"table": "group_quality", "group_id": LOST["eligibility"]})
def complete_group_without_a_partition(d: ReleaseDraft) -> None:
    d.set("group_quality", "partitioned", False, group_id=LOST["eligibility"])
    d.set("group_quality", ("route_cluster", "partition"), None, group_id=LOST["eligibility"])
    d.reseal("split")


# BD-SPL-002


@mutant("BD-SPL-002", at={"table": "group_quality", "group_id": TWINS[1]})
def twin_called_a_cluster_of_its_own(d: ReleaseDraft) -> None:
    d.set("group_quality", "route_cluster", 99, group_id=TWINS[1])
    d.reseal("split")


@mutant("BD-SPL-002", at={"table": "group_quality", "group_id": "g13"})
def group_in_a_strange_cluster(d: ReleaseDraft) -> None:
    cluster = d.value("group_quality", "route_cluster", group_id="g12")
    d.set("group_quality", "route_cluster", cluster, group_id="g13")
    d.reseal("split")


# BD-SPL-003


@mutant("BD-SPL-003", at={"table": "group_quality", "group_id": TWINS[0]})
def cluster_in_two_partitions(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", "val", group_id=TWINS[1])
    d.reseal("split")


# BD-SPL-004


@mutant("BD-SPL-004", at={"file": SPLIT, "pointer": "/digest"})
def two_groups_exchanged_behind_the_digest(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", "test", group_id="g18")
    d.set("group_quality", "partition", "val", group_id="g13")
    d.reseal("thresholds")


@mutant("BD-SPL-004", at={"file": SPLIT, "pointer": "/digest"})
def group_moved_behind_the_digest(d: ReleaseDraft) -> None:
    digest = d.documents[SPLIT]["digest"]
    d.set("group_quality", "partition", "train", group_id="g18")
    d.reseal("split")
    d.documents[SPLIT]["digest"] = digest
    d.reseal("thresholds")


@mutant("BD-SPL-004", at={"file": SPLIT, "pointer": "/digest"})
def digest_of_no_assignment(d: ReleaseDraft) -> None:
    d.documents[SPLIT]["digest"] = "0" * 64
    d.reseal("thresholds")


# BD-SPL-005


@mutant("BD-SPL-005", at={"file": SPLIT, "pointer": "/calibration"})
def calibration_promised_and_not_kept(d: ReleaseDraft) -> None:
    d.documents[SPLIT]["calibration"] = {"min_groups": 2, "min_clusters": 2}
    d.reseal("card")


@mutant("BD-SPL-005", at={"file": SPLIT, "pointer": "/calibration"})
def calibration_that_nobody_asked_for(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", "calibration", group_id="g18")
    d.reseal("split")


# BD-SPL-006


@mutant("BD-SPL-006", at={"file": SPLIT, "pointer": "/num_clusters"})
def clusters_counted_as_groups(d: ReleaseDraft) -> None:
    d.documents[SPLIT]["num_clusters"] += 1
    d.reseal("card")


@mutant("BD-SPL-006", at={"file": SPLIT, "pointer": "/partitions/train/groups"})
def training_groups_miscounted(d: ReleaseDraft) -> None:
    d.documents[SPLIT]["partitions"]["train"]["groups"] += 1
    d.reseal("card")


# BD-SPL-008


@mutant("BD-SPL-008", at={"table": "group_quality", "group_id": "g18"})
def group_placed_by_hand(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", "train", group_id="g18")
    d.reseal("split")


@mutant("BD-SPL-008", at={"table": "group_quality", "group_id": "g12"}, base="alone", findings=7)
def split_of_another_seed(d: ReleaseDraft) -> None:
    d.documents[SPLIT]["seed"] = SEED + 1
    d.reseal("card")


@mutant("BD-SPL-008", at={"table": "group_quality", "group_id": "g13"}, findings=2)
def groups_of_validation_and_test_exchanged(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", "test", group_id="g18")
    d.set("group_quality", "partition", "val", group_id="g13")
    d.reseal("split")
