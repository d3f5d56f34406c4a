"""Reports as data: they meet their schema in every situation, count exactly, and are safe to print."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from tests import synthetic
from tests.audits import validate_once
from tests.validator.engine.datasets import DEPARTURES, FOLDER, cells, edited, with_column, write, write_with

from branchdrive.contract.columns import TICK_TABLES
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.rule import CATALOGUE, RULES
from branchdrive.contract.text import printable, quote
from branchdrive.engine.report import Report
from branchdrive.engine.tally import MAX_FINDINGS_PER_RULE
from branchdrive.engine.validate import validate
from branchdrive.engine.waiver import Waiver

HOSTILE = "\x1b[31m\x1b]0;title\x07\nforged line\r\u202eturned\u2028\x9b2J\x00[red][/]" + "A" * 10_000


def hostile_descriptor() -> dict[str, Any]:
    return {**synthetic.descriptor(), HOSTILE: HOSTILE, "title": HOSTILE, "licence": HOSTILE}


def hostile_tables() -> dict[str, Any]:
    return edited(
        "rollouts",
        lambda table: with_column(
            with_column(table, "rollout_id", [f"{i}{HOSTILE}" for i in range(len(table))]),
            "group_id",
            [HOSTILE] * len(table),
        ),
    )


def raises(*_: Any) -> Any:
    raise RuntimeError(HOSTILE)


def with_broken_rule(root: Path, rule_id: str) -> Report:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(RULES, rule_id, raises)
        return validate(root)


ACCEPTED = Waiver("BD-VAL-002", "*", f"accepted {HOSTILE}"[:1000], date(2999, 1, 1), 1)
NAMED_TABLE = synthetic.base_tables()[FOLDER]["actors"].rename_columns(
    [HOSTILE, *synthetic.base_tables()[FOLDER]["actors"].column_names[1:]]
)

SITUATIONS: dict[str, Callable[[Path], Report]] = {
    "valid": lambda root: validate_once(write(root), require_groups=3),
    "valid without evidence": lambda root: validate_once(
        write(root, synthetic.bare_tables(), synthetic.bare_descriptor())
    ),
    "valid with media": lambda root: validate_once(write(root, synthetic.media_tables(), synthetic.media_descriptor())),
    "invalid": lambda root: validate_once(write(root, DEPARTURES["speed out of range"].tables())),
    "too few groups": lambda root: validate_once(write(root), require_groups=9),
    "partial": lambda root: validate_once(write(root), hash_files=False, select=["BD-LAY"], ignore=["BD-LAY-009"]),
    "waived": lambda root: validate_once(write(root, DEPARTURES["speed out of range"].tables()), waivers=[ACCEPTED]),
    "error": lambda root: with_broken_rule(write(root), "BD-VAL-001"),
    "unusable descriptor": lambda root: validate_once(write_with(root, {"branchdrive.json": b"\xff{"})),
    "descriptor of another version": lambda root: validate_once(
        write(root, document={**synthetic.descriptor(), "spec_version": "9.9"})
    ),
    "hostile descriptor": lambda root: validate_once(write(root, document=hostile_descriptor())),
    "contradicting descriptor": lambda root: validate_once(
        write(root, document={**synthetic.descriptor(), "streams": ["controls"]})
    ),
    "hostile rows": lambda root: validate_once(write(root, hostile_tables())),
    "hostile column": lambda root: validate_once(write(root, edited("actors", lambda _: NAMED_TABLE))),
    "manifest without files": lambda root: validate_once(_with_manifest(write(root), b"# branchdrive-manifest 0.1\n")),
    "hostile manifest": lambda root: validate_once(_with_manifest(write(root), HOSTILE.encode())),
    "no manifest": lambda root: validate_once(write(root, seal=False)),
    "no shards": lambda root: validate_once(write(root, {})),
    "undecodable tables": lambda root: validate_once(
        write_with(root, {f"{FOLDER}/{name}.parquet": b"PAR1" for name in ("controls", "rollouts")})
    ),
}


def _with_manifest(root: Path, content: bytes) -> Path:
    (root / "MANIFEST.sha256").write_bytes(content)
    return root


@pytest.fixture(scope="module", params=SITUATIONS)
def report(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Report:
    situation: Callable[[Path], Report] = SITUATIONS[request.param]
    return situation(tmp_path_factory.mktemp("situation") / "dataset")


def test_report_meets_its_schema(report: Report) -> None:
    document = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert schema_mismatches(document, "report.schema.json") == []


def test_report_holds_printable_ascii_only(report: Report) -> None:
    def texts(value: Any) -> list[str]:
        if isinstance(value, dict):
            return [text for item in value.items() for part in item for text in texts(part)]
        if isinstance(value, list):
            return [text for item in value for text in texts(item)]
        return [value] if isinstance(value, str) else []

    document = report.to_json()
    assert all(w.pop("reason") == ACCEPTED.reason for w in document["waivers"])  # the user's own words
    for text in texts(document):
        assert all(line.isascii() and (line.isprintable() or not line) for line in text.split("\n")), text
        assert len(text) < 5000


def test_report_lists_every_rule_once_in_catalogue_order(report: Report) -> None:
    assert [rule["id"] for rule in report.to_json()["rules"]] == list(CATALOGUE)


def test_counts_agree_with_each_other(report: Report) -> None:
    document = report.to_json()
    kept = {rule["id"]: [f for f in document["findings"] if f["rule"] == rule["id"]] for rule in document["rules"]}
    for rule in document["rules"]:
        findings = kept[rule["id"]]
        assert rule["examined"] <= rule["total"]
        assert len(findings) <= min(rule["num_findings"], MAX_FINDINGS_PER_RULE)
        assert bool(findings) == bool(rule["num_findings"])
        assert rule["num_waived"] == sum(f["count"] for f in findings if f["waived"])
        assert (rule["status"] == "fail") == (rule["num_findings"] > 0 and rule["status"] != "error")
        assert (rule["reason"] is None) or rule["status"] not in ("pass",)
    assert sum(map(len, kept.values())) == len(document["findings"])


def test_funnel_adds_up(report: Report) -> None:
    if report.funnel is not None:
        stages = report.funnel.to_json()["stages"]
        for earlier, later in pairwise(stages):
            assert later["groups"] == earlier["groups"] - later["lost"]
            assert bool(later["reasons"]) == bool(later["lost"])
            assert all(1 <= count <= later["lost"] for count in later["reasons"].values())


def test_situations_cover_every_verdict(tmp_path: Path) -> None:
    wanted = {"valid": "valid", "invalid": "invalid", "partial": "partial", "waived": "valid-with-waivers"}
    wanted |= {"error": "error", "too few groups": "valid"}
    for name, verdict in wanted.items():
        assert SITUATIONS[name](tmp_path / name).verdict == verdict


def test_facts_count_what_is_there(valid_root: Path) -> None:
    facts = validate_once(valid_root).dataset
    tables = synthetic.base_tables()
    assert facts.rows == {
        name: sum(len(shard[name]) for shard in tables.values()) for name in ("rollouts", *TICK_TABLES)
    }
    assert (facts.num_shards, facts.num_groups, facts.num_rollouts) == (2, 3, facts.rows["rollouts"])
    files = [path for path in valid_root.rglob("*") if path.is_file()]
    assert (facts.num_files, facts.num_bytes) == (len(files), sum(path.stat().st_size for path in files))
    assert facts.identity in (valid_root / "MANIFEST.sha256").read_text()


def test_counts_stay_exact_where_findings_are_capped(tmp_path: Path) -> None:
    tables = edited("controls", lambda t: with_column(t, "rollout_id", [f"nobody-{i}" for i in range(len(t))]))
    report = validate_once(write(tmp_path / "dataset", tables))
    rule = next(rule for rule in report.to_json()["rules"] if rule["id"] == "BD-KEY-004")
    orphans = len(tables[FOLDER]["controls"])
    every = sum(len(shard[name]) for shard in tables.values() for name in shard if name != "rollouts")
    assert (rule["num_findings"], rule["examined"], rule["total"]) == (orphans, every, every)
    assert sum(finding.rule == "BD-KEY-004" for finding in report.findings) == MAX_FINDINGS_PER_RULE


def test_a_finding_stands_for_all_rows_of_its_attempt(tmp_path: Path) -> None:
    report = validate_once(
        write(tmp_path / "dataset", cells("observations", "speed_mps", dict.fromkeys(range(5), 999.0)))
    )
    (finding,) = report.findings
    assert finding.to_json() == {
        "rule": "BD-VAL-002",
        "kind": "structure",
        "location": {
            "file": f"{FOLDER}/observations.parquet",
            "table": "observations",
            "column": "speed_mps",
            "rollout_id": "g0.accelerate_0.30.a1",
            "tick": 0,
        },
        "count": 5,
        "expected": "-200 .. 200 m/s",
        "found": "999.0",
        "message": "Does not hold: Values lie in their declared range: file=raw/shard-00000/observations.parquet "
        "table=observations column=speed_mps rollout_id=g0.accelerate_0.30.a1 tick=0 (5 places): "
        "expected -200 .. 200 m/s, found 999.0",
        "remedy": CATALOGUE["BD-VAL-002"].remedy,
        "waived": False,
        "last_tick": 20,
        "branch_tick": 100,
        "follows": [],
    }


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain [red] text", "plain [red] text"),
        ("line\nbreak\ttab", "line\\nbreak\\ttab"),
        ("\x1b[31m\x07\x9b\x7f", "\\x1b[31m\\x07\\x9b\\x7f"),
        ("\u202e\U0001f600\udc80", "\\u202e\\U0001f600\\udc80"),
    ],
)
def test_text_of_a_dataset_is_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_quoted_values_are_short() -> None:
    assert quote("A" * 10_000) == "'" + "A" * 156 + "..."
    assert quote(0.1) == "0.1"


def test_findings_are_a_data_frame(report: Report) -> None:
    frame = report.to_pandas()
    assert frame["rule"].tolist() == [finding.rule for finding in report.findings]
    assert frame["message"].tolist() == [finding.message for finding in report.findings]
    assert frame["count"].sum() == sum(finding.count for finding in report.findings)
    groups = [finding.group_id for finding in report.findings]
    assert [None if group != group else group for group in frame["group_id"].tolist()] == groups


def test_a_notebook_shows_the_verdict_and_text_as_text(report: Report) -> None:
    html = report._repr_html_()
    assert f"<strong>Verdict: {report.verdict}</strong>" in html
    assert html.count("<script") == 0
    assert all(finding.rule in html for finding in report.findings[:50])
