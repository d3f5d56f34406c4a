"""Run a validator over cases and score what it says.

A command is a line of words, split as a shell would but never given to one. Placeholders in it:

    {dataset}   the folder of a dataset
    {options}   nothing, or what the case asks for, as words: --raw FOLDER, --waivers FILE, --no-hash
    {datasets}  the folders of many datasets, instead of one: a report on a line for each
    {cases}     many folders as `materialize` writes them, which say what a case asks for: a report on a line for each

It prints reports of the form of `report.schema.json` on standard output; its exit code is not looked at, because it
belongs to a command line and not to the specification. Linear algebra in it computes in one thread, unless the
environment says otherwise: threads of commands that run at once wait for each other, six times as long as they compute.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import tempfile
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import printable
from branchdrive.errors import UsageError
from branchdrive.runtime.process import ONE_THREAD, child_environment
from branchdrive_conformance.case import Case
from branchdrive_conformance.materialize import CASE_FILE, DATASET_DIR, RAW_DIR, WAIVERS_FILE, materialize
from branchdrive_conformance.score import Answer, Departure, score

__all__ = ["Command", "Result", "run_cases"]

_BATCHES = ("{cases}", "{datasets}")
_BATCH_CASES = 50
_MAX_MESSAGE = 300


@dataclass(frozen=True)
class Command:
    """A validator's command line.

    Attributes:
        words: Words with placeholders.
        limit_s: Seconds that it may take for one case.
    """

    words: tuple[str, ...]
    limit_s: float = 120.0

    @classmethod
    def of(cls, line: str, limit_s: float = 120.0) -> Command:
        """Parse a command line.

        Raises:
            UsageError: It is empty, cannot be split, or names no dataset.
        """
        try:
            words = tuple(shlex.split(line))
        except ValueError as error:
            raise UsageError(f"--command: {error}") from error
        if not any("{dataset}" in word for word in words) and not {*words} & {*_BATCHES}:
            raise UsageError("--command: say with {dataset}, {datasets} or {cases} where the folders go")
        return cls(words, limit_s)

    @property
    def is_batched(self) -> bool:
        """Whether it takes several cases at once."""
        return bool({*self.words} & {*_BATCHES})

    @property
    def takes_options(self) -> bool:
        """Whether cases with options can be given to it."""
        return bool({"{cases}", "{options}"} & {*self.words})

    def start(self, folders: Sequence[Path]) -> list[str]:
        """The words for cases in `folders`; one, unless it is batched."""
        if self.is_batched:
            places = {"{cases}": folders, "{datasets}": [folder / DATASET_DIR for folder in folders]}
            return [str(part) for word in self.words for part in places.get(word, [word])]
        (folder,) = folders
        parts: list[str] = []
        for word in self.words:
            parts += _options(folder) if word == "{options}" else [word.replace("{dataset}", str(folder / DATASET_DIR))]
        return parts


def _options(folder: Path) -> list[str]:
    options = json.loads((folder / CASE_FILE).read_bytes()).get("options", {})
    words = ["--raw", str(folder / RAW_DIR)] if (folder / RAW_DIR).is_dir() else []
    words += ["--waivers", str(folder / WAIVERS_FILE)] if "waivers" in options else []
    return [*words, *([] if options.get("hash", True) else ["--no-hash"])]


@dataclass(frozen=True)
class Result:
    """What a validator said of the cases.

    Attributes:
        claimed: Rules that it claims.
        departures: Departures of every case that was run, none where it is right.
        left_out: Cases that it could not be given.
    """

    claimed: frozenset[str]
    departures: dict[str, list[Departure]]
    left_out: tuple[str, ...]

    @property
    def num_right(self) -> int:
        """Cases without a departure."""
        return sum(not found for found in self.departures.values())

    @property
    def is_right(self) -> bool:
        """Whether every case that was run is right."""
        return bool(self.departures) and self.num_right == len(self.departures)


def run_cases(
    folder: Path,
    cases: Sequence[Case],
    command: Command,
    *,
    claimed: Collection[str] = tuple(CATALOGUE),
    jobs: int = 1,
    progress: Callable[[int, int], object] | None = None,
) -> Result:
    """Run a validator over cases.

    Args:
        folder: Folder of the cases.
        cases: Those to run, with different names.
        command: The validator.
        claimed: Rules that it claims.
        jobs: Commands that run at once.
        progress: Told how many cases are done, of how many.

    Raises:
        UsageError: The command cannot be started.
    """
    left_out = [case for case in cases if not command.takes_options and (case.options or case.raw is not None)]
    given = [case for case in cases if case not in left_out]
    alike: dict[str, list[Case]] = {}  # a dataset that several cases are about is judged once
    for case in given:
        alike.setdefault(json.dumps([case.base, case.recipe, case.raw, case.options]), []).append(case)
    by_first = {same[0].name: same for same in alike.values()}
    firsts = [same[0] for same in alike.values()]
    size = _BATCH_CASES if command.is_batched else 1
    batches = [firsts[start : start + size] for start in range(0, len(firsts), size)]
    departures: dict[str, list[Departure]] = {}
    is_whole = set(claimed) == set(CATALOGUE)
    with ThreadPoolExecutor(jobs) as pool:
        waiting = [pool.submit(_answers, folder, batch, command) for batch in batches]
        try:
            for future in as_completed(waiting):
                for first, answer in future.result():
                    for case in by_first[first.name]:
                        departures[case.name] = (
                            score(case, answer, claimed, is_whole=is_whole)
                            if isinstance(answer, Answer)
                            else [Departure(case.name, "no report", None, "a report", answer)]
                        )
                if progress is not None:
                    progress(len(departures), len(given))
        finally:
            pool.shutdown(cancel_futures=True)
    ordered = {case.name: departures[case.name] for case in given}
    return Result(frozenset(claimed), ordered, tuple(case.name for case in left_out))


def _answers(folder: Path, batch: Sequence[Case], command: Command) -> list[tuple[Case, Answer | str]]:
    """What the validator said of each case: an answer, or why there is none."""
    with tempfile.TemporaryDirectory(prefix="branchdrive-conformance-") as scratch:
        folders = [Path(scratch) / f"{index:03d}" for index in range(len(batch))]
        for case, target in zip(batch, folders, strict=True):
            materialize(folder, case, target)
        reports = _reports(command, folders)
    return [(case, _answer(report)) for case, report in zip(batch, reports, strict=True)]


def _reports(command: Command, folders: Sequence[Path]) -> list[str]:
    words = command.start(folders)
    environment = {**ONE_THREAD, **child_environment()}  # the user's own settings come first
    try:
        done = subprocess.run(  # noqa: S603 (the user's own command)
            words, capture_output=True, timeout=command.limit_s * len(folders), env=environment, check=False
        )
    except subprocess.TimeoutExpired:
        return [f"no end within {command.limit_s * len(folders):g} s"] * len(folders)
    except OSError as error:
        raise UsageError(f"--command: {words[0]!r} cannot be started: {error.strerror}") from error
    text = done.stdout.decode(errors="replace")
    reports = [line for line in text.splitlines() if line.strip()] if command.is_batched else [text]
    if len(reports) != len(folders):
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["nothing on standard error"]
        return [f"{len(reports)} reports for {len(folders)} cases; {last[0]}"] * len(folders)
    return reports


def _answer(text: str) -> Answer | str:
    try:
        report: Any = json.loads(text)
        return Answer.of(report)
    except ValueError as error:
        return printable(f"no report ({error}): {text.strip()}")[:_MAX_MESSAGE]
