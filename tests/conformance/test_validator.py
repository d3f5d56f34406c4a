"""The runner: this project's validator is right, and each kind of broken validator is caught."""

from __future__ import annotations

import io
import json
import shutil
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.recipes.archive import pack
from tests.sampling import THOROUGH
from tests.waiting import PATIENCE_S

from branchdrive.cli.main import run_script
from branchdrive.contract.rule import CATALOGUE
from branchdrive.errors import UsageError
from branchdrive_conformance.archive import unpacked
from branchdrive_conformance.case import Case, cases_dir, load_case, load_cases
from branchdrive_conformance.materialize import materialize
from branchdrive_conformance.reference import judge_case
from branchdrive_conformance.score import Answer, score
from branchdrive_conformance.validator import Command

RULE = "BD-VAL-002"
Report = dict[str, Any]


def run(*words: str) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    code = run_script("branchdrive-conformance", "branchdrive_conformance.command", words, stdout, stderr)
    return code, stdout.getvalue(), stderr.getvalue()


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Case, Report]]:
    """Reports on the cases of one rule, and on one of each other form: detached, without digests, with a map."""
    cases = list(load_cases(cases_dir(), [RULE]))
    others = ("BD-LAY-002/digests_not_compared", "BD-MAP-001/pass", "BD-LYR-004/pass")
    cases += [load_case(cases_dir(), cases_dir() / f"{name}.json") for name in others]
    folder = tmp_path_factory.mktemp("cases")
    for case in cases:
        materialize(cases_dir(), case, folder / case.name)
    return [(case, judge_case(folder / case.name).to_json()) for case in cases]


@pytest.fixture(scope="module")
def few_cases(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Folder with all base datasets, two cases of a rule, and of another a defect and its waiver."""
    folder = tmp_path_factory.mktemp("few") / cases_dir().name
    folder.mkdir()
    (folder / "bases").symlink_to(cases_dir() / "bases")
    for name in ("BD-VAL-003/command_in_capitals", "BD-VAL-003/pass", f"{RULE}/throttle_in_percent", f"{RULE}/waived"):
        (folder / name).parent.mkdir(exist_ok=True)
        shutil.copy(cases_dir() / f"{name}.json", folder / f"{name}.json")
    return str(folder)


def test_this_validator_is_right(judged: list[tuple[Case, Report]]) -> None:
    for case, report in judged:
        assert score(case, Answer.of(report), CATALOGUE, is_whole=True) == []


def rule_removed(report: Report) -> Report:
    return {**report, "rules": [rule for rule in report["rules"] if rule["id"] != RULE]}


def rule_inverted(report: Report) -> Report:
    other = {"pass": "fail", "fail": "pass"}
    changed = [
        {**rule, "status": other.get(rule["status"], rule["status"])} if rule["id"] == RULE else rule
        for rule in report["rules"]
    ]
    return {**report, "rules": changed}


def never_failing(report: Report) -> Report:
    passed = [
        {**rule, "status": "pass", "num_findings": 0} if rule["status"] == "fail" else rule for rule in report["rules"]
    ]
    return {**report, "verdict": "valid", "rules": passed, "findings": []}


def wrong_place(report: Report) -> Report:
    moved = [{**finding, "location": {**finding["location"], "table": "actors"}} for finding in report["findings"]]
    return {**report, "findings": moved}


def wrong_count(report: Report) -> Report:
    return {**report, "rules": [{**rule, "num_findings": rule["num_findings"] + 1} for rule in report["rules"]]}


@pytest.mark.parametrize(
    ("broken", "what"),
    [
        (rule_removed, "status"),
        (rule_inverted, "status"),
        (never_failing, "verdict"),
        (wrong_place, "location"),
        (wrong_count, "count"),
    ],
)
def test_a_broken_validator_is_caught(
    broken: Callable[[Report], Report], what: str, judged: list[tuple[Case, Report]]
) -> None:
    departures = [
        departure
        for case, report in judged
        for departure in score(case, Answer.of(broken(report)), CATALOGUE, is_whole=True)
    ]
    assert what in {departure.what for departure in departures}
    assert RULE in {departure.rule for departure in departures} | {RULE if what == "verdict" else None}


def test_rules_that_are_not_claimed_are_not_compared(judged: list[tuple[Case, Report]]) -> None:
    for case, report in judged:
        assert score(case, Answer.of(rule_removed(report)), {"BD-LAY-002"}, is_whole=False) == []


SINGLE = f"{sys.executable} -P -m branchdrive.cli validate {{dataset}} --format json"
"""A validator that takes a case at a time."""


@THOROUGH
def test_a_command_that_can_be_given_every_case_conforms(few_cases: str) -> None:
    code, text, error = run("validator", "--command", SINGLE, "--select", "BD-VAL-003", "--cases", few_cases)
    assert (code, error) == (0, ""), text
    assert "conforms" in text


def test_a_command_is_scored(few_cases: str, tmp_path: Path) -> None:
    """Several at once, and one that is right but for what it cannot be given, each case at a time."""
    code, text, _ = run("validator", "--select", RULE, "--format", "json", "--cases", few_cases)
    document = json.loads(text)
    assert (code, document["right"], document["left_out"]) == (0, True, [])
    options = ("--select", RULE, "--output", str(tmp_path / "table.txt"), "--cases", few_cases)
    code, text, _ = run("validator", "--command", SINGLE, *options)
    assert code == 0
    assert "conforms in all cases that it could be given" in (tmp_path / "table.txt").read_text()
    assert f"{RULE}/waived" in (tmp_path / "table.txt").read_text()


def test_a_command_computes_in_one_thread(few_cases: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless the user says otherwise."""
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    script = tmp_path / "validator.py"
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
    script.write_text(f"import os, sys; print(*map(os.environ.get, {names}), file=sys.stderr)")
    command = f"{sys.executable} {script} {{datasets}}"
    _, text, _ = run("validator", "--command", command, "--select", "BD-VAL-003", "--cases", few_cases)
    assert "; 1 3" in text


@pytest.mark.parametrize(
    ("line", "limit_s", "found"),
    [
        ("echo {dataset}", PATIENCE_S, "no report"),
        ("false {dataset}", PATIENCE_S, "no report"),
        ("SLEEP {dataset}", 1, "no end within 1 s"),
        ("echo {cases}", PATIENCE_S, "1 reports for"),
    ],
)
def test_a_program_that_prints_no_report_is_told_so(line: str, limit_s: float, found: str, few_cases: str) -> None:
    line = line.replace("SLEEP", f"{sys.executable} -c 'import time; time.sleep(60)'")
    options = ("--select", "BD-VAL-003", "--limit-s", f"{limit_s:g}", "--cases", few_cases)
    code, text, _ = run("validator", "--command", line, *options)
    assert code == 1
    assert found in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["validator", "--command", "my-validator"], "say with {dataset}"),
        (["validator", "--command", "'"], "No closing quotation"),
        (["validator", "--command", "no-such-program {dataset}", "--select", "VAL"], "cannot be started"),
        (["validator", "--select", "XYZ"], "no rule and no area"),
        (["validator", "--claims", "LAY", "--select", "VAL"], "no case is about"),
        (["validator", "--cases", "pyproject.toml"], "no archive of cases"),
        (["validator", "--cases", "tests"], "holds no base datasets"),
    ],
)
def test_a_wrong_call_is_one_line(words: list[str], message: str) -> None:
    code, text, error = run(*words)
    assert (code, text) == (2, "")
    assert message in error
    assert error.count("\n") == 1


def test_cases_become_plain_datasets(tmp_path: Path) -> None:
    target = tmp_path / "out"
    code, text, _ = run("materialize", str(target), "--select", "BD-VAL-003")
    assert code == 0
    folders = sorted(path.parent for path in target.glob("*/*/case.json"))
    assert text.startswith(f"{len(folders)} cases written")
    for folder in folders:
        expected = json.loads((folder / "case.json").read_text())["expected"]
        report = judge_case(folder)
        assert report.verdict == expected["verdict"]
        assert set(expected["rules"]) == set(CATALOGUE)
    code, _, error = run("materialize", str(target))
    assert (code, "exists; name a new folder" in error) == (2, True)


def test_a_batch_takes_all_folders() -> None:
    command = Command.of("judge --quiet {cases} --end")
    assert command.start([Path("a"), Path("b")]) == ["judge", "--quiet", "a", "b", "--end"]
    with pytest.raises(UsageError, match="say with"):
        Command.of("judge --quiet")
    command = Command.of("judge {datasets}")
    assert command.start([Path("a"), Path("b")]) == ["judge", "a/dataset", "b/dataset"]
    assert not command.takes_options


def test_an_archive_holds_the_cases_and_nothing_outside(tmp_path: Path) -> None:
    folder = tmp_path / "v0.1"
    (folder / "bases").mkdir(parents=True)
    (folder / "bases" / "raw.json").write_text("{}")
    digest = pack(folder, tmp_path / "cases.tar.gz")
    assert (tmp_path / "cases.tar.gz.sha256").read_text() == f"{digest}  cases.tar.gz\n"
    with unpacked(tmp_path / "cases.tar.gz") as found:
        assert [path.name for path in found.rglob("*.json")] == ["raw.json"]
    for name, kind in (("../outside", tarfile.REGTYPE), ("/outside", tarfile.REGTYPE), ("v0.1/link", tarfile.SYMTYPE)):
        with tarfile.open(tmp_path / "hostile.tar", "w") as archive:
            entry = tarfile.TarInfo(name)
            entry.type, entry.linkname = kind, "/etc/hostname"
            archive.addfile(entry)
        with pytest.raises(UsageError, match="no plain file inside"), unpacked(tmp_path / "hostile.tar"):
            pass
