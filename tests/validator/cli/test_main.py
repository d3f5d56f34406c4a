"""The commands as people call them: exit codes, one line per mistake, no traceback."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from tests.each import each
from tests.sampling import sampled
from tests.waiting import PATIENCE_S

from branchdrive.cli import main as command_line
from branchdrive.cli.main import run, validate_run
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.rule import AREAS, CATALOGUE
from branchdrive.runtime.environment import install_command

Run = Callable[[Sequence[str], Any, Any], int]


def call(entry: Run, *argv: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a call."""
    stdout, stderr = io.StringIO(), io.StringIO()
    code = entry([str(argument) for argument in argv], stdout, stderr)
    return code, stdout.getvalue(), stderr.getvalue()


def nested(argv: Sequence[str], stdout: Any, stderr: Any) -> int:
    """`branchdrive validate`, called like `branchdrive-validate`."""
    return run(["validate", *argv], stdout, stderr)


ENTRIES = {"branchdrive-validate": validate_run, "branchdrive": nested}
each_entry = pytest.mark.parametrize("entry", ENTRIES.values(), ids=ENTRIES)


# --- wrong usage


@pytest.fixture
def places(tmp_path: Path, valid_root: Path) -> dict[str, Path]:
    """Places that calls name."""
    (tmp_path / "file").write_bytes(b"x")
    (tmp_path / "empty").mkdir()
    (tmp_path / "waivers.json").write_text("{")
    (tmp_path / "no rule.json").write_text('{"waivers": [{"rule": "BD-XXX-001"}]}')
    names = ("nowhere", "file", "empty", "waivers.json", "no rule.json", "nowhere/report.json", "a\x1b[31m\nb")
    return {"DATASET": valid_root, "HERE": tmp_path, **{name: tmp_path / name for name in names}}


WRONG = {
    "no dataset named": ([], "the following arguments are required: DATASET"),
    "nothing there": (["nowhere"], "is not a folder; give the folder that holds branchdrive.json"),
    "a file": (["file"], "is not a folder"),
    "an empty folder": (["empty"], "holds no dataset: none of branchdrive.json, MANIFEST.sha256, raw/ is there"),
    "a name that forges lines": (["a\x1b[31m\nb"], "a\\x1b[31m\\nb' is not a folder"),
    "two datasets": (["DATASET", "nowhere"], "unrecognized arguments"),
    "unknown option": (["DATASET", "--fast"], "unrecognized arguments: --fast"),
    "unknown format": (["DATASET", "--format", "html"], "argument --format: invalid choice: 'html'"),
    "format without value": (["DATASET", "--format"], "argument --format: expected one argument"),
    "unknown rule selected": (["DATASET", "--select", "BD-XXX-001"], "no rule is called 'BD-XXX-001'"),
    "unknown rule ignored": (["DATASET", "--ignore", "nonsense"], "no rule is called 'nonsense'"),
    "no jobs": (["DATASET", "--jobs", "0"], "argument --jobs: '0' is no whole number of at least 1"),
    "negative jobs": (["DATASET", "--jobs", "-2"], "argument --jobs: '-2' is no whole number of at least 1"),
    "jobs in words": (["DATASET", "--jobs", "two"], "argument --jobs: 'two' is no whole number of at least 1"),
    "half a job": (["DATASET", "--jobs", "1.5"], "argument --jobs: '1.5' is no whole number of at least 1"),
    "endless jobs": (["DATASET", "--jobs", "9" * 5000], "is no whole number of at least 1"),
    "negative groups": (["DATASET", "--require-groups", "-1"], "'-1' is no whole number of at least 0"),
    "groups without rules": (
        ["DATASET", "--require-groups", "1", "--select", "BD-VAL"], "the funnel needs every rule on rows",
    ),
    "waivers nowhere": (["DATASET", "--waivers", "nowhere"], "cannot be read"),
    "waivers in a folder": (["DATASET", "--waivers", "empty"], "cannot be read"),
    "waivers that are no JSON": (["DATASET", "--waivers", "waivers.json"], "cannot be read"),
    "waivers that are incomplete": (["DATASET", "--waivers", "no rule.json"], "/waivers/0: expected properties"),
    "output into no folder": (["DATASET", "--output", "nowhere/report.json"], "nowhere' does not exist"),
    "output over a folder": (["DATASET", "--output", "empty"], "is a folder; name a file"),
}  # fmt: skip


@each_entry
@pytest.mark.parametrize(("argv", "message"), WRONG.values(), ids=WRONG)
def test_wrong_usage_is_one_line_and_exit_code_2(
    entry: Run, argv: list[str], message: str, places: dict[str, Path], quick: None
) -> None:
    code, out, err = call(entry, *(places.get(argument, argument) for argument in argv))
    assert (code, out) == (2, "")
    assert message in err
    assert err.endswith("\n")
    assert err[:-1].isprintable()
    assert err.startswith(("branchdrive: ", "branchdrive-validate: "))


@each(
    ("argv", "message"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["nonsense"], "invalid choice: 'nonsense'; there are `benchmark`, `build`, "),
        (["colect"], "invalid choice: 'colect'; did you mean 'collect'"),
        (["--nonsense"], "branchdrive: "),
        (["rules", "nonsense"], "no rule is called 'nonsense'; `branchdrive rules` lists them all"),
        (["rules", "BD-VAL-999"], "no rule is called 'BD-VAL-999'"),
        (["rules", "BD-VAL-001", "BD-VAL-002"], "unrecognized arguments: BD-VAL-002"),
        (["rules", "--all"], "unrecognized arguments: --all"),
        (["rules", "\x1b[31m"], "no rule is called '\\x1b[31m'"),
    ],
)
def test_wrong_commands_are_one_line_and_exit_code_2(argv: list[str], message: str) -> None:
    code, out, err = call(run, *argv)
    assert (code, out) == (2, "")
    assert message in err
    assert err[:-1].isprintable()


def test_a_wrong_command_loads_none(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []
    monkeypatch.setattr(command_line, "_load", loaded.append)
    assert call(run, "nonsense")[0] == 2
    assert loaded == []


def test_control_characters_of_names_stay_out_of_messages(tmp_path: Path) -> None:
    code, _, err = call(run, "validate", tmp_path / "nö\x1b[31m\u202e\nx")
    assert code == 2
    assert "nö\\x1b[31m\\u202e\\nx" in err
    assert err.count("\n") == 1


def test_an_extra_that_is_not_installed_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for package, remedy in (
        ("pymunk", f"`collect` needs the package 'pymunk': {install_command('sim')}"),
        ("cvxpy", f"`collect` needs the package 'cvxpy': {install_command('guard')}"),
        ("pyarrow", "`collect` needs the package 'pyarrow': pip install 'pyarrow>=18'"),
        (
            "nowhere",
            "`collect` cannot be loaded: No module named 'nowhere'; reinstall the package that this belongs to",
        ),
    ):

        def absent(name: str, package: str = package) -> Any:
            raise ModuleNotFoundError(f"No module named {package!r}", name=package)

        monkeypatch.setattr(command_line, "_load", absent)
        assert call(run, "collect", "somewhere") == (4, "", f"branchdrive: {remedy}\n")


# --- verdicts become exit codes


@pytest.fixture
def waivers(tmp_path: Path) -> Path:
    entry = {
        "rule": "BD-VAL-002", "location": "*column=speed_mps*", "reason": "saturated sensor", "expires": "2999-12-31",
        "max_count": 1,
    }  # fmt: skip
    path = tmp_path / "waivers.json"
    path.write_text(json.dumps({"waivers": [entry]}))
    return path


@pytest.mark.parametrize("entry", sampled(ENTRIES.values(), every=2), ids=ENTRIES)
def test_verdicts_become_exit_codes(
    entry: Run, valid_root: Path, invalid_root: Path, waivers: Path, quick: None
) -> None:
    table = [
        ([valid_root], 0, "valid"),
        ([valid_root, "--require-groups", 3], 0, "valid"),
        ([valid_root, "--require-groups", 4], 1, "valid"),
        ([valid_root, "--no-hash"], 3, "partial"),
        ([valid_root, "--select", "BD-LAY", "--select", "BD-DOC"], 3, "partial"),
        ([valid_root, "--ignore", "BD-ENC-001"], 3, "partial"),
        ([valid_root, "--ignore", "BD-CTL"], 0, "valid"),
        ([invalid_root], 1, "invalid"),
        ([invalid_root, "--no-hash"], 1, "invalid"),
        ([invalid_root, "--waivers", waivers], 0, "valid-with-waivers"),
    ]
    for argv, exit_code, verdict in table:
        code, out, err = call(entry, *argv, "--format", "json")
        document = json.loads(out)
        assert (code, document["exit_code"], document["verdict"], err) == (exit_code, exit_code, verdict, "")
        assert schema_mismatches(document, "report.schema.json") == []
        code, out, err = call(entry, *argv)
        assert (code, err) == (exit_code, "")
        assert f"Verdict: {verdict} - " in out


def test_workers_say_what_one_process_says(
    invalid_root: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    there = [call(validate_run, invalid_root, "--format", "json", "--jobs", jobs) for jobs in (1, 2)]
    request.getfixturevalue("quick")
    assert there == [call(validate_run, invalid_root, "--format", "json")] * 2


# --- output


@each_entry
@pytest.mark.parametrize("form", ["text", "json"])
def test_output_goes_to_the_file_and_text_to_the_terminal(
    entry: Run, form: str, invalid_root: Path, tmp_path: Path, quick: None
) -> None:
    _, printed, _ = call(entry, invalid_root, "--format", form)
    _, text, _ = call(entry, invalid_root)
    target = tmp_path / "report"
    target.write_text("an older and much longer report " * 10_000)
    assert call(entry, invalid_root, "--format", form, "--output", target) == (1, text, "")
    assert target.read_text() == printed
    assert list(tmp_path.iterdir()) == [target]


def test_output_that_fails_leaves_nothing_behind(
    valid_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: None
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    target = tmp_path / "report"
    code, out, err = call(validate_run, valid_root, "--output", target)
    assert (code, out) == (4, "")
    hint = "make room on its disk and run the same command again"
    assert err == f"branchdrive-validate: {target}: No space left on device; {hint}\n"
    assert list(tmp_path.iterdir()) == []


def test_output_folder_that_is_not_writable_is_noticed_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: None
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    code, _, err = call(validate_run, tmp_path / "nowhere", "--output", tmp_path / "report")
    assert code == 2
    assert "is not writable" in err


# --- help


def help_of(entry: Run, *argv: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        entry(argv, io.StringIO(), io.StringIO())
    assert not stop.value.code
    return capsys.readouterr().out


def test_help_names_commands_and_options(capsys: pytest.CaptureFixture[str]) -> None:
    text = help_of(run, "--help", capsys=capsys)
    assert all(name in text for name in ("validate", "rules", "collect", "--version"))
    for entry, argv in ((run, ("validate", "--help")), (validate_run, ("--help",))):
        text = help_of(entry, *argv, capsys=capsys)
        options = (
            "--format", "--output", "--select", "--ignore", "--jobs", "--no-hash", "--waivers", "--require-groups",
        )  # fmt: skip
        assert all(option in text for option in options)
        groups = ("what to report:", "what to judge:", "what to accept:", "how to read:")
        assert [line for line in text.splitlines() if line in groups] == list(groups)
    assert help_of(run, "--version", capsys=capsys) == f"branchdrive {version('branchdrive')}\n"
    assert help_of(validate_run, "--version", capsys=capsys) == f"branchdrive-validate {version('branchdrive')}\n"


# --- rules


def test_rules_are_listed_by_area() -> None:
    code, out, err = call(run, "rules")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == list(CATALOGUE)
    assert [line for line in lines if not line.startswith("  ")] == list(AREAS.values())


def test_rules_of_one_area_are_listed() -> None:
    code, out, _ = call(run, "rules", "BD-CTL")
    listed = [line.split()[0] for line in out.splitlines()[1:]]
    assert code == 0
    assert listed == [rule_id for rule_id in CATALOGUE if rule_id.startswith("BD-CTL-")]
    assert call(run, "rules", "bd-ctl") == call(run, "rules", "BD-CTL")


@each("rule_id", CATALOGUE)
def test_a_rule_is_explained(rule_id: str) -> None:
    info = CATALOGUE[rule_id]
    code, out, err = call(run, "rules", rule_id)
    words = " ".join(out.split())
    assert (code, err) == (0, "")
    assert out.startswith(f"{rule_id}  {info.title}\n")
    said = info.remedy.replace("`", "")
    for part in (f"kind {info.kind}", f"clause {info.clause}", f"What to do {said}", *info.streams, *info.requires):
        assert part in words


def test_a_rule_is_explained_in_any_case() -> None:
    assert call(run, "rules", "bd-ctl-001") == call(run, "rules", "BD-CTL-001")


# --- interrupts and bugs


@each_entry
def test_an_interrupt_is_one_line_and_exit_code_130(
    entry: Run, valid_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(function: Any, tasks: Any) -> Any:
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr("branchdrive.runtime.executor.isolated", lambda jobs: interrupted)
    code, out, err = call(entry, valid_root)
    assert (code, out) == (130, "")
    assert err in ("branchdrive: interrupted\n", "branchdrive-validate: interrupted\n")


@each_entry
def test_a_bug_is_no_verdict_on_the_dataset(entry: Run, valid_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> Any:
        raise LookupError("no such thing")

    monkeypatch.setattr("branchdrive.engine.validate.take_survey", broken)
    code, out, err = call(entry, valid_root)
    assert (code, out) == (4, "")
    assert err.splitlines()[-1].endswith(": LookupError in the tool itself; please report it")


SLOW = """
import os, sys, time
from branchdrive.engine import reading
from branchdrive.cli.main import validate_run

from branchdrive.engine.shard import audit_shard

def sleep(task):
    if task.folder == "raw/shard-00000":
        return audit_shard(task)
    time.sleep(1)
    os.write(1, b"one worker is busy, the other has nothing left to do\\n")
    time.sleep(1000)

reading.audit_shard = sleep

if __name__ == "__main__":
    sys.exit(validate_run(sys.argv[1:], sys.stdout, sys.stderr))
"""


@pytest.mark.skipif(os.name != "posix", reason="interrupts a process group")
def test_an_interrupt_from_the_keyboard_ends_workers_at_once_and_in_silence(valid_root: Path, tmp_path: Path) -> None:
    script = tmp_path / "slow.py"
    script.write_text(SLOW)
    process = subprocess.Popen(
        [sys.executable, script, valid_root, "--jobs", "2"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a background shell has it ignored
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "one worker is busy, the other has nothing left to do\n"
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, err) == (130, "branchdrive-validate: interrupted\n")


@pytest.mark.skipif(os.name != "posix", reason="closes a pipe early")
@pytest.mark.parametrize("argv", [["rules"], ["rules", "BD-CTL-008"]], ids=["a list", "a page"])
def test_a_reader_that_leaves_early_is_no_error(argv: list[str]) -> None:
    code = "import sys; from branchdrive.cli.main import main; sys.exit(main())"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *argv], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"},
    )  # fmt: skip
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert (process.stderr.read(), process.wait(timeout=PATIENCE_S)) == (b"", 130)
    process.stderr.close()


@pytest.mark.parametrize("form", sampled(["text", "json"], every=2))
def test_reports_can_be_printed_where_only_ascii_can(valid_root: Path, tmp_path: Path, form: str) -> None:
    waivers = tmp_path / "waivers.json"
    entry = {
        "rule": "BD-VAL-002", "location": "*é*", "reason": "größer als erlaubt \u202e", "expires": "2999-12-31",
        "max_count": 1,
    }  # fmt: skip
    waivers.write_text(json.dumps({"waivers": [entry]}), encoding="utf-8")
    code = "import sys; from branchdrive.cli.main import validate_main; sys.exit(validate_main())"
    done = subprocess.run(
        [sys.executable, "-c", code, valid_root, "--waivers", waivers, "--format", form],
        capture_output=True, check=False, env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"\\xf6" in done.stdout or b"\\u00f6" in done.stdout
