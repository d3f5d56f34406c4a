"""Files of waivers: what they say, and one clear line where they are wrong."""

from __future__ import annotations

import json
import re
from datetime import date
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest
from tests.each import each
from tests.repo.checkout import ROOT

from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.finding import Finding, location_text
from branchdrive.engine.tally import Tally
from branchdrive.engine.waiver import Waiver, apply_waivers, load_waivers
from branchdrive.errors import UsageError

ENTRY = {
    "rule": "BD-VAL-002",
    "location": "*column=speed_mps*",
    "reason": "the sensor saturates, see the data sheet",
    "expires": "2026-12-31",
    "max_count": 3,
}


def write(path: Path, *entries: dict[str, Any]) -> Path:
    path.write_text(json.dumps({"waivers": list(entries)}), encoding="utf-8")
    return path


def test_the_example_of_the_specification_is_a_waiver(tmp_path: Path) -> None:
    chapter = (ROOT / "spec/07-rules.md").read_text("utf-8")
    (block,) = [text for text in re.findall(r"```json\n(.*?)```", chapter, re.DOTALL) if '"waivers"' in text]
    path = tmp_path / "waivers.json"
    path.write_text(block)
    (waiver,) = load_waivers(path)
    place = {"table": "observations", "column": "speed_mps", "rollout_id": "g00003-cut-in.nominal.a1", "tick": 15}
    assert fnmatchcase(location_text(place), waiver.location)


def test_entries_become_waivers(tmp_path: Path) -> None:
    (waiver,) = load_waivers(write(tmp_path / "waivers.json", ENTRY))
    assert waiver == Waiver("BD-VAL-002", ENTRY["location"], ENTRY["reason"], date(2026, 12, 31), 3)  # type: ignore[arg-type]
    assert load_waivers(write(tmp_path / "none.json")) == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rule": "BD-VAL-999"}, "no rule 'BD-VAL-999'; did you mean 'BD-VAL-00"),
        ({"rule": "BD-CTL-008"}, "'BD-CTL-008' is of the kind qualification; it needs no waiver"),
        ({"rule": "everything"}, "/waivers/0/rule: expected pattern"),
        ({"location": ""}, "/waivers/0/location: expected minLength 1"),
        ({"reason": "because"}, "/waivers/0/reason: expected minLength 10"),
        ({"expires": "2026-02-30"}, "'2026-02-30' is not a date"),
        ({"expires": "soon"}, "/waivers/0/expires: expected pattern"),
        ({"expires": None}, "/waivers/0/expires: expected type 'string', found None"),
        ({"max_count": 0}, "/waivers/0/max_count: expected minimum 1, found 0"),
        ({"max_count": "3"}, "/waivers/0/max_count: expected type 'integer'"),
        ({"max_count": 1.5}, "/waivers/0/max_count: expected type 'integer'"),
        ({"note": "x"}, "declared are expires, location, max_count, reason, rule, found"),
    ],
)
def test_wrong_entries_are_wrong_usage(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = write(tmp_path / "waivers.json", {**ENTRY, **changes})
    with pytest.raises(UsageError) as caught:
        load_waivers(path)
    text = str(caught.value)
    assert message in text
    assert str(path) in text
    assert text.isprintable()


@pytest.mark.parametrize(
    "content",
    [b"", b"[]", b"null", b"{}", b'{"waivers": {}}', b"\xff", b"waivers: []", b"[" * 100_000, b'{"waivers": [NaN]}'],
    ids=lambda content: repr(content[:20]),
)
def test_wrong_files_are_wrong_usage(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "waivers.json"
    path.write_bytes(content)
    with pytest.raises(UsageError) as caught:
        load_waivers(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder_are_wrong_usage(tmp_path: Path) -> None:
    for path in (tmp_path / "nowhere.json", tmp_path):
        with pytest.raises(UsageError, match="cannot be read"):
            load_waivers(path)


@pytest.mark.parametrize("rule_id", CATALOGUE)
def test_rules_that_decide_and_no_others_can_be_waived(rule_id: str, tmp_path: Path) -> None:
    path = write(tmp_path / "waivers.json", {**ENTRY, "rule": rule_id})
    if CATALOGUE[rule_id].decides:
        assert load_waivers(path)[0].rule == rule_id
    else:
        with pytest.raises(UsageError, match="it needs no waiver, since only structure and claim rules"):
            load_waivers(path)


# --- globs


def tally(*locations: Location) -> Tally:
    found = Tally("BD-VAL-002", examined=9, total=9, num_findings=len(locations))
    found.keep(Finding.of("BD-VAL-002", Mismatch(location, "x", "y")) for location in locations)
    return found


PLACE: Location = {"file": "raw/shard-00000/controls.parquet", "table": "controls", "tick": 7}


@each(
    ("glob", "matches"),
    [
        ("*", True),
        ("file=raw/shard-00000/controls.parquet table=controls tick=7", True),
        ("file=raw/shard-0000?/*", True),
        ("*tick=[0-9]", True),
        ("*table=controls*", True),
        ("table=controls", False),
        ("*TABLE=controls*", False),
        ("*tick=70*", False),
        ("dataset", False),
    ],
)
def test_globs_match_the_whole_location(glob: str, matches: bool) -> None:
    found = tally(PLACE)
    waiver = Waiver(found.rule_id, glob, "r", date(2999, 1, 1), 1)
    (outcome,) = apply_waivers({found.rule_id: found}, [waiver], date.min)
    assert outcome.state == ("used" if matches else "unused")
    assert found.findings[0].waived == matches


def test_a_finding_on_the_dataset_as_a_whole_has_a_location_too() -> None:
    found = tally({})
    apply_waivers({found.rule_id: found}, [Waiver(found.rule_id, "dataset", "r", date(2999, 1, 1), 1)], date.min)
    assert found.findings[0].waived


def test_a_waiver_of_an_absent_rule_is_unused() -> None:
    (outcome,) = apply_waivers({}, [Waiver("BD-VAL-002", "*", "r", date(2999, 1, 1), 1)], date.min)
    assert (outcome.state, outcome.num_matched) == ("unused", 0)


def test_a_waiver_that_covers_too_much_covers_nothing() -> None:
    found = tally(PLACE, {**PLACE, "tick": 8})
    (outcome,) = apply_waivers({found.rule_id: found}, [Waiver(found.rule_id, "*", "r", date(2999, 1, 1), 1)], date.min)
    assert (outcome.state, outcome.num_matched) == ("exceeded", 2)
    assert not any(finding.waived for finding in found.findings)
