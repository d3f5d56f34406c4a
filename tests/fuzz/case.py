"""One case of the fuzz: a damaged dataset, its verdict, and whether the validator behaved."""

from __future__ import annotations

import hashlib
import io
import json
import os
import resource
import shutil
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tests.fuzz.base import WEIGHTS
from tests.fuzz.cell import Place, edit_cell, places
from tests.fuzz.damage import DAMAGES, OUTSIDE, put
from tests.fuzz.draw import Draw
from tests.fuzz.guard import Guard
from tests.fuzz.media import damage_media

from branchdrive.cli.text import render_report
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.errors import BranchDriveError, UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.runtime.executor import Executor, in_process

__all__ = ["MAX_CPU_S", "MAX_MEMORY_BYTES", "Fuzz", "Result"]

MAX_CPU_S = 60.0
"""Processor time that one damaged dataset may take; the valid ones take about a second at most."""

MAX_MEMORY_BYTES = 2**30
"""Resident memory that a validation may add to what its process holds: several times the decoded size of a table."""

_DAMAGES = {**DAMAGES, "media": damage_media}

DAMAGE_WEIGHTS = {
    "bytes": 5, "table": 3, "document": 4, "no_document": 1, "manifest": 2, "checkpoint": 1, "exchanged": 2,
    "removed": 1, "special": 3, "name": 2, "tree": 1, "while_read": 3, "media": 8,
}  # fmt: skip

_WITHOUT_MEDIA = {name: weight for name, weight in DAMAGE_WEIGHTS.items() if name != "media"}

LAYERS_EDITED = {
    "raw": ("raw",), "drives": ("raw",), "release": ("canonical", "quality", "model"), "benchmark": ("benchmark",),
}  # fmt: skip
"""Layers of each dataset whose cells are edited; the others are those of another dataset."""

_MAX_HASHED_BYTES = 2**26


@dataclass(frozen=True)
class Result:
    """What became of a case.

    Attributes:
        index: Number of the case.
        base: The valid dataset.
        damage: Kind of the damage.
        what: The damage in words.
        column: Column of a cell edit, and `kind` how it was changed.
        is_sealed: Whether the manifest agrees with the damaged files.
        is_changed: Whether any file differs from the valid dataset.
        verdict: Verdict; ``refused`` for wrong usage, empty where there is none.
        rules: Rules whose status or number of findings differs from those of the valid dataset.
        cpu_s: Processor time of the validation.
        memory_bytes: Resident memory that the validation added, at its largest.
        failure: How the validator misbehaved; empty if it did not.
    """

    index: int
    base: str
    damage: str
    what: str
    column: str
    kind: str
    is_sealed: bool
    is_changed: bool
    verdict: str
    rules: tuple[str, ...]
    cpu_s: float
    memory_bytes: int
    failure: str

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def _weighted(draw: Draw, weights: Mapping[str, int]) -> str:
    return draw.choice([name for name, weight in weights.items() for _ in range(weight)])


def _copy(source: Path, root: Path) -> None:
    """A copy whose files are links to those of the original."""
    for folder, _, names in os.walk(source):
        there = root / Path(folder).relative_to(source)
        there.mkdir()
        for name in names:
            os.link(Path(folder) / name, there / name)


def _listing(root: Path) -> dict[str, str]:
    """What lies below a folder: digests of files, and the kinds of everything else."""
    found: dict[str, str] = {}
    for folder, folders, names in os.walk(os.fsencode(root)):
        for name in (*folders, *names):
            path = Path(os.fsdecode(folder + b"/" + name))
            if not path.is_file() or path.is_symlink() or path.stat().st_size > _MAX_HASHED_BYTES:
                status = path.lstat()
                found[str(path)[len(str(root)) :]] = f"{status.st_mode:o}" + (
                    f" {status.st_size}" if path.is_file() else ""
                )
            else:
                found[str(path)[len(str(root)) :]] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def _signature(report: Report) -> dict[str, tuple[str, int]]:
    return {tally.rule_id: (tally.status, tally.num_findings) for tally in report.tallies}


def _peak_bytes() -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _reset_peak() -> None:
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:  # then the peak is that of all cases so far
        return


class Fuzz:
    """Cases under a seed, in the folder `work`, which is this process's own; each may take `max_cpu_s`."""

    def __init__(self, seed: int, bases: Mapping[str, Path], work: Path, *, max_cpu_s: float = MAX_CPU_S) -> None:
        self._seed, self._bases, self._work, self._max_cpu_s = seed, bases, work, max_cpu_s
        shutil.rmtree(work, ignore_errors=True)
        (work / "tmp").mkdir(parents=True)
        tempfile.tempdir = str(work / "tmp")
        self._signatures: dict[str, dict[str, tuple[str, int]]] = {}
        self._listings: dict[str, dict[str, str]] = {}
        self._places: dict[str, list[Place]] = {}
        self._guard = Guard(work / "tmp")

    def _prepare(self, base: str) -> None:
        """What is known of a valid dataset before any damage."""
        if base not in self._signatures:
            root = self._bases[base]
            report = validate(root)
            assert (report.verdict, report.errors) == ("valid", ()), [f.message for f in report.findings]
            self._places[base] = [p for p in places(root) if p.path.split("/")[0] in LAYERS_EDITED[base]]
            self._listings[base] = _listing(root)
            self._signatures[base] = _signature(report)

    def run(self, index: int, *, executor: Executor = in_process, is_kept: bool = False) -> Result:
        """Damage a dataset and judge it; where it `is_kept`, the damaged dataset stays in the work folder."""
        draw = Draw(self._seed, index)
        base = _weighted(draw, WEIGHTS)
        self._prepare(base)
        folder = self._work / "case"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / OUTSIDE).mkdir()
        (folder / OUTSIDE / "secret").write_text("nobody may read or change this")
        root = folder / "dataset"
        _copy(self._bases[base], root)
        known = {
            "index": index, "base": base, "damage": "cell", "column": "", "kind": "", "is_sealed": True,
        }  # fmt: skip
        victim, change = "", None
        edit = edit_cell(draw, self._bases[base], draw.choice(self._places[base])) if draw.below(2) else None
        if edit is not None:
            put(root / edit.place.path, edit.content)
            known |= {"what": f"{edit.place.name} {edit.what}", "column": edit.place.name, "kind": edit.kind}
        else:
            damage = _weighted(draw, _WITHOUT_MEDIA if base == "drives" else DAMAGE_WEIGHTS)
            if damage == "while_read":
                what, victim, change = _while_read(draw, root)
            else:
                what = _DAMAGES[damage](draw, root)
            is_sealed = bool(draw.below(2)) and damage not in ("manifest", "while_read")
            known |= {"damage": damage, "what": what, "is_sealed": is_sealed}
        if known["is_sealed"]:
            known["is_sealed"] = _sealed(root)
        result = Result(**known, **self._judge(root, base, executor, known["is_sealed"], victim, change))
        if not is_kept:
            shutil.rmtree(folder, ignore_errors=True)
        return result

    def _judge(
        self, root: Path, base: str, executor: Executor, is_sealed: bool, victim: str,
        change: Callable[[], object] | None,
    ) -> dict[str, Any]:  # fmt: skip
        """Verdict on the damaged dataset and what the validator did meanwhile."""
        before = _listing(root.parent)
        own = {path[len("/dataset") :]: what for path, what in before.items() if path.startswith("/dataset/")}
        is_changed = change is not None or own != self._listings[base]
        verdict, rules, failure = "", (), ""
        _reset_peak()
        start, held_bytes = time.process_time(), _peak_bytes()
        with self._guard.watching(victim, change) as violations:
            try:
                report = validate(root, executor=executor)
                failure = _misbehaviour(report)
                verdict = report.verdict
                known = self._signatures[base]
                rules = tuple(r for r, found in _signature(report).items() if found != known[r])
            except UsageError as error:
                verdict = "refused"
                failure = "" if str(error).isprintable() else f"message that prints badly: {error!r}"
            except BranchDriveError as error:
                failure = f"ended with {type(error).__name__}: {error}"
            except BaseException:
                failure = traceback.format_exc()
                if "KeyboardInterrupt" in failure:
                    raise
        cpu_s, memory = time.process_time() - start, _peak_bytes() - held_bytes
        if violations:
            failure += f" touched: {'; '.join(violations[:5])}"
        if change is None and _listing(root.parent) != before:
            failure += " the dataset or what lies beside it is another one now"
        if not is_sealed and is_changed and change is None and verdict == "valid":
            failure += " a change behind the manifest is valid"
        if cpu_s > self._max_cpu_s or memory > MAX_MEMORY_BYTES:
            failure += f" over its bounds: {cpu_s:.0f} s, {memory / 2**20:.0f} MiB"
        return {
            "is_changed": is_changed, "verdict": verdict, "rules": rules, "cpu_s": cpu_s, "memory_bytes": memory,
            "failure": failure.strip(),
        }  # fmt: skip


def _sealed(root: Path) -> bool:
    """Write the manifest again; what no manifest can list, or is huge, leaves it as it was."""
    if any(path.stat().st_size > _MAX_HASHED_BYTES for path in root.rglob("*") if path.is_file()):
        return False
    try:
        manifest = build_manifest(Folder(root))
    except (BranchDriveError, OSError):
        return False
    (root / MANIFEST_FILE).unlink(missing_ok=True)
    write_manifest(Folder(root), manifest)
    return True


def _misbehaviour(report: Report) -> str:
    """What is wrong with a report as such; empty if nothing is."""
    if report.errors:
        return f"verdict {report.verdict}: {report.errors[0]}"
    if report.exit_code not in (0, 1, 3):
        return f"exit code {report.exit_code}"
    text = render_report(report, io.StringIO())
    if not all(line.isprintable() for line in text.splitlines()) or "\x1b" in text:
        return "a report that prints badly"
    document = json.dumps(report.to_json(), allow_nan=False)
    if not document.isascii() or any(not finding.message.isprintable() for finding in report.findings):
        return "a finding that prints badly"
    return ""


def _while_read(draw: Draw, root: Path) -> tuple[str, str, Callable[[], object]]:
    """What happens to a file at the moment when it is opened; its name is that of one file alone."""
    paths = sorted(path for path in root.rglob("*") if path.is_file())
    path = draw.choice(paths)
    content = path.read_bytes()
    put(path, content)  # a file of its own, which may be written in place

    def grown() -> None:
        with path.open("ab") as file:
            file.write(b"more" * 1000)

    def replaced_by(other: Callable[[], object]) -> Callable[[], object]:
        def replace() -> None:
            path.unlink()
            other()

        return replace

    happenings: dict[str, Callable[[], object]] = {
        "cut in half": lambda: os.truncate(path, len(content) // 2),
        "emptied": lambda: os.truncate(path, 0),
        "grown": grown,
        "removed": path.unlink,
        "another file": replaced_by(lambda: path.write_bytes(content[::-1])),
        "a pipe": replaced_by(lambda: os.mkfifo(path)),
        "a link": replaced_by(lambda: path.symlink_to("/dev/zero")),
        "a folder": replaced_by(path.mkdir),
        "its folder gone": lambda: path.parent.rename(path.parent.with_name("moved")),
    }
    kind = draw.choice(tuple(happenings))
    return f"{path.relative_to(root)}: {kind}", path.name, happenings[kind]
