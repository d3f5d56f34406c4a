"""Stored numbers agree with recomputed ones as the table of chapter 10 says: exactly, or within 1e-9."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.repo.checkout import ROOT
from tests.validator.engine.rules.benchmark_release import RANKING_LOCK, RESULTS, BenchmarkDraft
from tests.validator.engine.rules.release import RETENTION, THRESHOLDS

from branchdrive.engine.validate import validate

Nudge = Callable[[Any], Any]


class Case(NamedTuple):
    """A stored number: what the table calls it, what it says of it, the rule that judges it, how it is changed."""

    subject: str
    said: str
    rule: str
    edit: Callable[[BenchmarkDraft, Nudge], None]

    @property
    def is_exact(self) -> bool:
        return self.said.endswith("exact")


def _entry(path: str, *keys: str | int) -> Callable[[BenchmarkDraft, Nudge], None]:
    def edit(d: BenchmarkDraft, nudge: Nudge) -> None:
        *outer, last = keys
        place = d.documents[path]
        for key in outer:
            place = place[key]
        place[last] = nudge(place[last])

    return edit


def _least(table: str, column: str) -> Callable[[BenchmarkDraft, Nudge], None]:
    """The least value of a column: of discrepancies one that decides no threshold."""

    def edit(d: BenchmarkDraft, nudge: Nudge) -> None:
        frame = dict(d.frame(table))
        values = frame[column].copy()
        row = int(np.argmin(values))
        values[row] = nudge(float(values[row]))
        frame[column] = values
        d.put(table, frame)

    return edit


CASES = (
    Case("`quality/thresholds.json`", "exact", "BD-FID-005", _entry(THRESHOLDS, "variables", 0, "value")),
    Case("`quality/retention.json`", "tolerance", "BD-FID-009", _entry(RETENTION, "rows", 0, "low")),
    Case("`quality/pairs`", "tolerance", "BD-FID-003", _least("pairs", "position_m")),
    Case("`quality/pairs`", "`tick_offset` and shares exact", "BD-FID-004", _least("pairs", "actor_count_share")),
    Case("tables of the model layer", "tolerance", "BD-MOD-005", _least("state", "rel_x_m")),
    Case("tables of the model layer", "tolerance", "BD-MOD-014", _least("trajectories", "y_m")),
    Case("tables of the model layer", "copied numbers, masks, integers and texts exact", "BD-MOD-012",
         _least("scalars", "min_separation_m")),
    Case("tables of the model layer", "copied numbers, masks, integers and texts exact", "BD-MOD-008",
         _least("surroundings", "separation_m")),
    Case("`model/normalisation.json`", "tolerance", "BD-MOD-018",
         _entry("model/normalisation.json", "state", 0, "offset")),
    Case("`benchmark/lock.json`", "scale of utility by tolerance", "BD-BMK-009",
         _entry(RANKING_LOCK, "utility_scale", "q95", 1)),
    Case("`benchmark/results.json`", "tolerance", "BD-BMK-012",
         _entry(RESULTS, "prediction", "estimates", 0, "interval", "bca_high")),
)  # fmt: skip


def agreement(subject: str) -> str:
    """What the table says of the row that begins with `subject`."""
    text = (ROOT / "spec" / "10-layers.md").read_text("utf-8")
    (row,) = [line for line in text.splitlines() if line.startswith(f"| {subject}") and line.count("|") == 4
              and line.split("|")[3].strip().startswith(("exact", "tolerance"))]  # fmt: skip
    return row.split("|")[3].strip()


def test_the_table_says_so() -> None:
    for case in CASES:
        assert case.said in agreement(case.subject).split("; "), case


@pytest.mark.parametrize("is_within", [True, False])
def test_numbers_agree_as_the_table_says(is_within: bool, tmp_path: Path) -> None:
    """A tenth of the tolerance parts exact numbers alone, ten times the tolerance parts all."""
    size = 1e-10 if is_within else 1e-8
    draft = BenchmarkDraft()
    for case in CASES:
        case.edit(draft, lambda value: value + size * (1 + abs(value)))
    draft.documents[RETENTION]["thresholds_digest"] = draft.digest(THRESHOLDS)
    report = validate(draft.write(tmp_path / "dataset"), select=[case.rule for case in CASES])
    failed = {tally.rule_id for tally in report.tallies if tally.status == "fail"}
    assert failed == {case.rule for case in CASES if case.is_exact or not is_within}
