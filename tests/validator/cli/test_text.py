"""Reports as text: what people read, in full; safe whatever a dataset holds; as wide as the terminal."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from functools import reduce
from pathlib import Path

import pytest
from tests import synthetic
from tests.audits import validate_once
from tests.mutation import new_draft
from tests.validator.engine.datasets import DEPARTURES, edited, with_column, write
from tests.validator.engine.test_report import HOSTILE, SITUATIONS

from branchdrive.cli.formats.outcome import folded, headline
from branchdrive.cli.formats.table import renderer
from branchdrive.cli.rules_text import render_rule, render_rules
from branchdrive.cli.text import FINDINGS_SHOWN, render, render_report
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import counted
from branchdrive.engine.report import Report
from branchdrive.engine.waiver import Waiver
from branchdrive.raw.funnel import Funnel
from branchdrive.text.terminal import PLAIN_WIDTH

LAYER_RULES = {
    layer: [rule for rule, info in CATALOGUE.items() if info.layer == layer]
    for layer in dict.fromkeys(info.layer for info in CATALOGUE.values() if info.layer is not None)
}
"""Rules of each derived layer, in the order in which the catalogue comes to them."""
NUM_WITHOUT_STREAM = sum(not info.is_about(synthetic.descriptor()["streams"]) for info in CATALOGUE.values())
NUM_UNCLAIMED = NUM_WITHOUT_STREAM + sum(map(len, LAYER_RULES.values()))
SGR = re.compile(r"\x1b\[[0-9;]*m")


class Terminal(io.StringIO):
    """Standard output that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def shown(report: Report) -> str:
    """The report as plain text, with place, size, digests and the numbers of rules without findings taken out."""
    text = render_report(report, io.StringIO())
    facts = report.dataset
    text = text.replace(facts.path, "PLACE").replace(str(facts.identity), "DIGEST")
    text = text.replace(str(facts.descriptor_digest), "SHA256").replace(str(facts.content_identity), "CONTENT")
    counts = Counter(tally.status for tally in report.tallies)
    text = text.replace(f"{counts['pass']} pass", "PASSED").replace(f"{counts['skipped']} skipped", "SKIPPED")
    text = re.sub(r"(skipped: no subject - BD-LAY-010), .*", r"\1 and others", text)
    return re.sub(r"[0-9.]+ KiB", "SIZE", text)


def _unclaimed(layer: str) -> str:
    """The line on rules of a derived layer that is not claimed."""
    return f"  not-claimed: the descriptor does not claim the {layer} layer - {len(LAYER_RULES[layer])} rules"


UNCLAIMED = "\n".join(
    [
        "  skipped: no subject - BD-LAY-010 and others",
        f"  not-claimed: the descriptor claims no stream that this rule is about - {NUM_WITHOUT_STREAM} rules",
        *map(_unclaimed, LAYER_RULES),
    ]
)

VALID = f"""\
synthetic 0.1.0 at PLACE
3 branch groups, 46 rollouts, 9,246 controls, 1,886 observations, 8,952 actors
2 shards, 12 files with the manifest, SIZE
identity DIGEST
content  CONTENT

Funnel
Stage                  Groups  Lost  Reasons (groups)
-----------------------------------------------------
Groups discovered           3
Exact bank                  3
Controls valid              3
Integrity-complete          3
Structurally eligible       3

Action response: against nominal, 2.5 s after the branch
Action            Groups        To the left, m           Faster, m/s  Unchanged  First response, s
--------------------------------------------------------------------------------------------------
accelerate_0.30        3  -0.55 [-1.62, +0.53]  +4.06 [+4.06, +4.06]          0                  -
accelerate_0.50        3  -0.62 [-1.85, +0.60]  +5.41 [+5.41, +5.41]          0                  -
accelerate_0.80        3  -0.74 [-2.19, +0.71]  +7.43 [+7.43, +7.43]          0                  -
brake_0.30             3  +0.02 [-0.02, +0.06]  -2.00 [-2.00, -2.00]          0                  -
brake_0.50             3  +0.07 [-0.07, +0.20]  -4.34 [-4.34, -4.34]          0                  -
brake_1.00             3  +0.17 [-0.18, +0.52]  -4.34 [-4.34, -4.34]          0                  -
steer_left_0.05        3  +1.03 [+0.32, +1.73]  +0.00 [+0.00, +0.00]          0                  -
steer_left_0.10        3  +2.40 [+1.71, +3.09]  +0.00 [+0.00, +0.00]          0                  -
steer_left_0.15        3  +3.75 [+3.08, +4.41]  +0.00 [+0.00, +0.00]          0                  -
steer_right_0.05       3  -1.74 [-2.43, -1.05]  +0.00 [+0.00, +0.00]          0                  -
steer_right_0.10       3  -3.09 [-3.75, -2.44]  +0.00 [+0.00, +0.00]          0                  -
steer_right_0.15       3  -4.41 [-5.02, -3.79]  +0.00 [+0.00, +0.00]          0                  -
Means with normal 95 % intervals over all groups in which the action and the nominal are whole up to then, also those
that do not qualify. Left and faster are positive.
Unchanged are groups in which the action changed no pose and no speed. The first response is a median over attempts that
equal their nominal up to the branch; replays with noise never do.
The same in every observation: speed_limit_mps 13.5

Rules: PASSED, SKIPPED, {NUM_UNCLAIMED} not-claimed
{UNCLAIMED}
Verdict: valid - the dataset conforms to the specification; 3 of 3 groups qualify
  descriptor SHA256
  replay noise declared as natural
  streams not claimed: `rgb_surround`, `rgb_top_down`, `semantic_bev`, `map`
"""


def test_a_valid_dataset_reads_like_this(valid_root: Path) -> None:
    assert shown(validate_once(valid_root)) == VALID


INVALID = f"""\
synthetic 0.1.0 at PLACE
3 branch groups, 46 rollouts, 9,246 controls, 1,886 observations, 8,952 actors
2 shards, 12 files with the manifest, SIZE
identity DIGEST
content  CONTENT

What to look at first
  BD-CTL-009  Does not hold: Applied control equals the online expert while inactive
      all of shard-00000: g0 to g1 (2 groups), 30 of 31 attempts
      g0.accelerate_0.30.a1, controls, ticks 30 and 31, 3.50 to 3.45 s before the branch: COMMANDS
      remedy: Leave the ego to the online expert outside the active window, and apply and record the very float32
      command of the expert, not a quantised one.
  BD-VAL-002  Does not hold: Values lie in their declared range
      1 of 2 groups of shard-00000: g0, 1 of 31 attempts
      g0.nominal.a1, observations.speed_mps, tick 15, 4.25 s before the branch: expected -200 .. 200 m/s; found 1000.0
      its group fails BD-CTL-009 too
      remedy: Correct units, frame or wrapping; ranges are in schemas/v0.1/columns.json.

Violations
  BD-VAL-002  Does not hold: Values lie in their declared range: 1 violation in EXAMINED rows
      file=raw/shard-00000/observations.parquet table=observations column=speed_mps rollout_id=g0.nominal.a1 tick=15
      (4.25 s before the branch)
        expected -200 .. 200 m/s; found 1000.0
      remedy: Correct units, frame or wrapping; ranges are in schemas/v0.1/columns.json.

Why attempts and groups do not qualify
  BD-CTL-009  Does not hold: Applied control equals the online expert while inactive: 30 violations in 45 rollouts
      group_id=g0 rollout_id=g0.accelerate_0.30.a1 table=controls tick=30  (to tick 31, 2 places, 3.50 to 3.45 s before
      the branch), and 29 more attempts in 2 groups
        COMMANDS
      remedy: Leave the ego to the online expert outside the active window, and apply and record the very float32
      command of the expert, not a quantised one.

`branchdrive rules ID` explains a rule: why it is, its clauses, an example, and what to do.

Funnel
Stage                  Groups  Lost  Reasons (groups)
-----------------------------------------------------
Groups discovered           3
Exact bank                  2     1  BD-VAL-002 (1)
Controls valid              1     1  BD-CTL-009 (1)
Integrity-complete          1
Structurally eligible       1

Groups that do not qualify: 2 of 3
Group  Lost as             Why                                                               Rules
------------------------------------------------------------------------------------------------------------------------
g0     no exact bank       does not hold: Values lie in their declared range, in speed_mps:  BD-VAL-002; also BD-CTL-009
                           expected -200 .. 200 m/s, found 1000.0
g1     controls not valid  does not hold: Applied control equals the online expert while     BD-CTL-009
                           inactive: COMMANDS

Action response: against nominal, 2.5 s after the branch
Action            Groups        To the left, m           Faster, m/s  Unchanged  First response, s
--------------------------------------------------------------------------------------------------
accelerate_0.30        2  -0.82 [-2.43, +0.79]  +4.06 [+4.06, +4.06]          0                  -
accelerate_0.50        2  -0.94 [-2.77, +0.90]  +5.41 [+5.41, +5.41]          0                  -
accelerate_0.80        2  -1.11 [-3.28, +1.07]  +7.43 [+7.43, +7.43]          0                  -
brake_0.30             2  +0.03 [-0.03, +0.08]  -2.00 [-2.00, -2.00]          0                  -
brake_0.50             2  +0.10 [-0.10, +0.30]  -4.34 [-4.34, -4.34]          0                  -
brake_1.00             2  +0.26 [-0.26, +0.78]  -4.34 [-4.34, -4.34]          0                  -
steer_left_0.05        2  +0.85 [-0.21, +1.90]  +0.00 [+0.00, +0.00]          0                  -
steer_left_0.10        2  +2.23 [+1.19, +3.26]  +0.00 [+0.00, +0.00]          0                  -
steer_left_0.15        2  +3.58 [+2.58, +4.57]  +0.00 [+0.00, +0.00]          0                  -
steer_right_0.05       2  -1.92 [-2.95, -0.89]  +0.00 [+0.00, +0.00]          0                  -
steer_right_0.10       2  -3.26 [-4.25, -2.28]  +0.00 [+0.00, +0.00]          0                  -
steer_right_0.15       2  -4.56 [-5.48, -3.64]  +0.00 [+0.00, +0.00]          0                  -
Means with normal 95 % intervals over all groups in which the action and the nominal are whole up to then, also those
that do not qualify. Left and faster are positive.
Unchanged are groups in which the action changed no pose and no speed. The first response is a median over attempts that
equal their nominal up to the branch; replays with noise never do.
The same in every observation: speed_limit_mps 13.5

Rules: PASSED, 1 fail, SKIPPED, {NUM_UNCLAIMED} not-claimed, 1 failing without deciding
{UNCLAIMED}
Verdict: invalid - the dataset breaks the specification; 1 of 3 groups qualify
  descriptor SHA256
  replay noise declared as natural
  streams not claimed: `rgb_surround`, `rgb_top_down`, `semantic_bev`, `map`
  at least 2 groups required to qualify
1 of 2 required branch groups qualify
"""


def test_an_invalid_dataset_reads_like_this(invalid_root: Path) -> None:
    text = shown(validate_once(invalid_root, require_groups=2))
    text = re.sub(r"in [0-9,]+ rows", "in EXAMINED rows", text)
    found = r"found\s+steer\s+\S+\s+throttle\s+\S+\s+brake\s+0.75:\s+applied_brake\s+differs"
    text = re.sub(rf"expected steer [^;]*?[;,]\s+{found}", "COMMANDS", text)
    assert text == INVALID


def test_waivers_are_printed(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["speed out of range"].tables())
    waivers = [
        Waiver("BD-VAL-002", "*", "a [bold]sensor[/] that saturates", date(2999, 1, 1), 2),
        Waiver("BD-VAL-001", "*", "no longer needed", date(2020, 1, 1), 1),
    ]
    text = shown(validate_once(root, waivers=waivers))
    assert "BD-VAL-002  Does not hold: Values lie in their declared range (waived): 1 violation" in text
    assert "BD-VAL-002 at *: used, 1 of at most 2, until 2999-01-01 - a [bold]sensor[/] that saturates" in text
    assert "BD-VAL-001 at *: expired, 0 of at most 1, until 2020-01-01; the rule" in text
    assert "until 2020-01-01; the rule has no finding - no longer needed" in " ".join(text.split())
    assert "Verdict: valid-with-waivers - it conforms except where a waiver accepts that it does not" in text
    assert "  1 violation of 1 rule waived\n" in text


def test_an_unused_waiver_says_what_it_was_compared_with(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["speed out of range"].tables())
    report = validate_once(root, waivers=[Waiver("BD-VAL-002", "rollout_id=g0*", "a guess", date(2999, 1, 1), 2)])
    text = " ".join(shown(report).split())
    assert "unused, 0 of at most 2, until 2999-01-01; compared with 1 location, the first of them file=raw/" in text


def test_companions_are_counted(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    (root / "notes.txt").write_text("notes")
    (root / ".branchdriveignore").write_text("notes.txt\n")
    report = validate_once(root)
    assert report.dataset.num_beside
    for text in (shown(report), renderer("markdown")(report)):
        assert f", {counted(report.dataset.num_beside, 'companion')} not looked at\n" in text


def test_one_group_qualifies(valid_root: Path) -> None:
    report = validate_once(valid_root)
    report = replace(report, funnel=Funnel(1), dataset=replace(report.dataset, num_groups=1))
    assert headline(report).endswith("; 1 of 1 group qualifies")


def test_what_was_not_judged_is_printed(valid_root: Path) -> None:
    text = shown(validate_once(valid_root, hash_files=False, ignore=["BD-CTL", "BD-DOC-004"]))
    assert "Funnel: not judged" in text
    assert "skipped: digests were not computed - BD-LAY-002" in text
    assert "skipped: deselected - BD-DOC-004, BD-CTL-001, BD-CTL-002, BD-CTL-003, BD-CTL-004, BD-CTL-005 and" in text
    assert "Verdict: partial - what was judged conforms to the specification, but not everything was judged" in text
    assert "  16 rules deselected, of them 1 that decide\n  digests of files were not compared\n" in text


def test_declared_tolerances_stand_beside_the_verdict(tmp_path: Path) -> None:
    descriptor = {**synthetic.descriptor(), "tolerances": {"actuator": 0.015625, "evidence": 1e-6}}
    report = validate_once(write(tmp_path / "dataset", document=descriptor))
    assert "  declared tolerance of actuator: 0.015625 instead of 0.0\n" in shown(report)
    assert report.to_json()["dataset"]["tolerances"] == {"actuator": 0.015625, "evidence": 1e-6}


def test_what_the_dataset_leaves_out_stands_beside_the_verdict(tmp_path: Path) -> None:
    draft = new_draft()
    draft.descriptor["unrecorded"] = ["observations.speed_limit_mps"]
    draft.set("observations", "speed_limit_mps", None)
    draft.set("rollouts", "attempt", 8, rollout_id=["g0.brake_0.50.a1", "g1.brake_0.50.a1"])
    report = validate_once(draft.write(tmp_path / "dataset"))
    lines = (
        "replay noise declared as natural",
        "1 column not recorded: `observations.speed_limit_mps`",
        "streams not claimed: `rgb_surround`, `rgb_top_down`, `semantic_bev`, `map`",
        "13 attempts missing among the numbers of the others",
    )
    text = shown(report)
    assert [line for line in lines if f"  {line}" not in text] == []


def test_left_out_findings_are_counted_in_rows_where_rows_are_counted(tmp_path: Path) -> None:
    columns = [f"{kind}_{name}" for kind in ("expert", "applied") for name in ("brake", "steer", "throttle")]
    tables = edited("controls", lambda t: reduce(lambda t, column: with_column(t, column, [9.0] * len(t)), columns, t))
    report = validate_once(write(tmp_path / "dataset", tables))
    (tally,) = (tally for tally in report.tallies if tally.rule_id == "BD-VAL-002")
    assert {finding.count for finding in tally.findings} == {201}
    left = tally.num_findings - 201 * sum(map(len, folded(tally.findings)[:FINDINGS_SHOWN]))
    assert left % 201 == 0
    assert left > 0
    assert f"... and {left:,} more" in shown(report)


@pytest.fixture(scope="module", params=SITUATIONS)
def report(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Report:
    situation: Callable[[Path], Report] = SITUATIONS[request.param]
    return situation(tmp_path_factory.mktemp("situation") / "dataset")


def test_text_holds_printable_ascii_only(report: Report) -> None:
    text = render_report(report, io.StringIO())
    assert text.isascii()
    assert all(line.isprintable() for line in text.splitlines())
    assert text.splitlines() == text.split("\n")[:-1]
    assert report.verdict in text


def test_text_on_a_terminal_is_coloured_by_the_validator_alone(report: Report) -> None:
    text = SGR.sub("", render_report(report, Terminal()))
    assert text.isascii()
    assert all(line.isprintable() for line in text.splitlines())
    assert "\x1b[" in render_report(report, Terminal())
    assert "\x1b[" not in render(report)


def test_text_of_a_dataset_is_shown_literally(tmp_path: Path) -> None:
    ids = [f"[red]{i}[/red]:smile:\\[x]" for i in range(31)]
    tables = edited("rollouts", lambda t: with_column(t, "rollout_id", ids))
    text = shown(validate_once(write(tmp_path / "dataset", tables)))
    assert "rollout_id=[red]0[/red]:smile:\\[x]" in text


def test_text_is_as_wide_as_it_may_be(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    def width(text: str) -> int:
        return max(map(len, SGR.sub("", text).splitlines()))

    assert width(render_report(report, io.StringIO())) <= PLAIN_WIDTH
    for columns in (60, 200):
        monkeypatch.setenv("COLUMNS", str(columns))
        assert width(render_report(report, Terminal())) <= columns
        assert width(render_report(report, io.StringIO())) <= PLAIN_WIDTH


@pytest.mark.parametrize(
    ("environment", "stream", "is_coloured"),
    [
        ({}, Terminal, True),
        ({}, io.StringIO, False),
        ({"FORCE_COLOR": "1"}, io.StringIO, True),
        ({"FORCE_COLOR": ""}, io.StringIO, False),
        ({"NO_COLOR": "1"}, Terminal, False),
        ({"NO_COLOR": ""}, Terminal, True),
        ({"NO_COLOR": "1", "FORCE_COLOR": "1"}, Terminal, False),
        ({"CLICOLOR_FORCE": "1", "TTY_COMPATIBLE": "1", "JUPYTER_COLUMNS": "9"}, io.StringIO, False),
    ],
)
def test_colours_are_those_that_the_user_wants(
    environment: dict[str, str],
    stream: type[io.StringIO],
    is_coloured: bool,
    valid_root: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    report = validate_once(valid_root, select=["BD-LAY"])
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    text = render_report(report, stream())
    assert ("\x1b[" in text) == is_coloured
    assert stream is Terminal or SGR.sub("", text) == render(report)
    assert "\x1b[" not in render(report)


def test_rules_on_a_terminal_say_the_same() -> None:
    rules = list(CATALOGUE.values())
    assert SGR.sub("", render_rules(rules, Terminal())) == render_rules(rules, io.StringIO())
    assert CATALOGUE["BD-CTL-008"].remedy.split()[0] in SGR.sub("", render_rule(CATALOGUE["BD-CTL-008"], Terminal()))


def test_hostile_text_is_hostile() -> None:
    assert not HOSTILE.isprintable()
    assert not HOSTILE.isascii()
