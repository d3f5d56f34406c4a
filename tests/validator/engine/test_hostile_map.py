"""Maps that would take hours to look through: what is too much is a finding, and switches no rule off unseen."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.validator.engine.rules.case import SHARD_0, new_draft

from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.engine.validate import validate
from branchdrive.raw import map_work

FURTHER = ("BD-MAP-005", "BD-MAP-006", "BD-MAP-007", "BD-MAP-008")
"""Rules that look through a map."""


def endless(line: list[float]) -> list[float]:
    """A lane as it was, and on to the end of the world and back."""
    return [*line, line[-1] + 9e6]


@pytest.fixture
def few_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten pairs alone may be compared."""
    limits = Limits(**{**vars(spec_limits()), "max_map_pairs": 10})
    monkeypatch.setattr(map_work, "spec_limits", lambda: limits)


def found(tmp_path: Path, edit: Callable[[Any], object]) -> tuple[str, dict[str, str], list[tuple[Any, str]]]:
    """Verdict, statuses of the rules that look through a map, and findings of BD-LAY-007."""
    draft = new_draft("map")
    edit(draft)
    report = validate(draft.write(tmp_path / "dataset"))  # not as remembered under other limits
    assert report.errors == ()
    statuses = {tally.rule_id: tally.status for tally in report.tallies if tally.rule_id in FURTHER}
    exceeded = [(f.location, f.found) for f in report.findings if f.rule == "BD-LAY-007"]
    return report.verdict, statuses, exceeded


def test_a_map_that_covers_too_much_ground_is_refused(tmp_path: Path) -> None:
    def edit(draft: Any) -> None:
        (element, *_) = draft.take("map", kind="lane")["element_id"].to_pylist()
        for axis in ("x_m", "y_m"):
            draft.set("map", axis, endless, element_id=element)
        draft.set("map", "width_m", lambda widths: [*widths, 99.0], element_id=element)
        if draft.take("map", element_id=element)["z_m"].null_count == 0:
            draft.set("map", "z_m", lambda heights: [*heights, 0.0], element_id=element)

    verdict, statuses, exceeded = found(tmp_path, edit)
    assert verdict == "invalid"
    assert exceeded
    assert {"file": f"{SHARD_0}/map.parquet"} in [location for location, _ in exceeded]
    assert all(f"covers more than {spec_limits().max_map_squares:,} squares" in text for _, text in exceeded)
    assert statuses["BD-MAP-005"] == statuses["BD-MAP-006"] == "skipped"


@pytest.mark.usefixtures("few_pairs")
def test_a_map_with_too_much_around_what_is_recorded_is_refused(tmp_path: Path) -> None:
    verdict, statuses, exceeded = found(tmp_path, lambda draft: None)
    assert verdict == "invalid"
    assert [location["file"].split("/")[-1] for location, _ in exceeded] == ["map.parquet"] * 2
    assert all("takes more than 10 pairs" in text for _, text in exceeded)
    assert set(statuses.values()) == {"skipped"}
