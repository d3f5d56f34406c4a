"""Defects and limits of files of the model and benchmark layers as files."""

from __future__ import annotations

from tests.validator.engine.rules.benchmark_release import (
    LOCK,
    PROTOCOL,
    RESULTS,
    SCALARS,
    BenchmarkDraft,
    first_of,
)
from tests.validator.engine.rules.case import mutant
from tests.validator.engine.rules.cases.model_inputs import TEST
from tests.validator.engine.rules.release import ENDINGS, ReleaseDraft

from branchdrive.contract.layer import table_path

# BD-LYR-001


@mutant("BD-LYR-001", at={"file": table_path(ENDINGS, "val")})
def endings_without_those_of_a_partition(d: ReleaseDraft) -> None:
    d.add_endings()
    d.before_seal(lambda root: (root / table_path(ENDINGS, "val")).unlink())


# BD-LYR-005


@mutant("BD-LYR-005", at={"file": PROTOCOL, "pointer": "/models/3/title"}, base="benchmark")
def title_that_writes_a_section_of_its_own(d: BenchmarkDraft) -> None:
    d.documents[PROTOCOL]["models"][3]["title"] = "Best\n\n## Injected | <script>"
    d.follow("lock", keep={"ranking", "results", "tables"})


@mutant("BD-LYR-005", at={"file": RESULTS, "pointer": "/warnings/0"}, base="benchmark")
def warning_of_several_lines(d: BenchmarkDraft) -> None:
    d.documents[RESULTS]["warnings"] = ["Nothing.\n\n## Injected\x1b[2J"]


@mutant("BD-LYR-005", at={"file": LOCK, "pointer": "/"}, base="benchmark")
def version_of_the_code_with_a_control_character(d: BenchmarkDraft) -> None:
    d.documents[LOCK]["code"]["version"] = "1.0\x1b[2J"
    d.follow("ranking")


# BD-LYR-007


@mutant("BD-LYR-007", at={"file": SCALARS, "column": "min_separation_m"}, base="benchmark")
def prediction_that_is_no_number(d: BenchmarkDraft) -> None:
    where = {"model": "M3", "seed": 11, "group_id": first_of(d, "test"), "action_key": "brake_0.50"}
    d.set("predictions", "min_separation_m", float("nan"), **where)


@mutant("BD-LYR-007", at={"table": "state", "group_id": TEST, "offset_ticks": 5, "column": "offset_ticks"})
def state_of_the_future(d: ReleaseDraft) -> None:
    d.duplicate("state", {"offset_ticks": 5}, group_id=TEST, offset_ticks=0)
    d.sort("state")


@mutant("BD-LYR-007", at={"table": "past_controls", "group_id": TEST, "offset_ticks": 0, "column": "offset_ticks"})
def control_at_the_branch_in_the_past(d: ReleaseDraft) -> None:
    d.duplicate("past_controls", {"offset_ticks": 0}, group_id=TEST, offset_ticks=-1)
    d.sort("past_controls")
