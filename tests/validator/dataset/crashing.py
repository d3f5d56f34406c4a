"""Collections that are killed: a child process writes, and is killed before a file operation or at a random moment.

Run as a program: ``python -m tests.validator.dataset.crashing sweep FOLDER`` or ``... collect ROOT``.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tests.validator.dataset.invented import ATTEMPTS, make_descriptor, write_group, write_rollout

from branchdrive.dataset.layout import MANIFEST_FILE
from branchdrive.dataset.manifest import build_manifest, parse_manifest
from branchdrive.dataset.reader import open_dataset
from branchdrive.dataset.writer import DatasetWriter

DESCRIPTOR = make_descriptor(has_evidence=False)
NAME_EVENTS = {"os.mkdir", "os.rename", "os.remove", "os.rmdir"}
"""Audit events of operations that change which names there are."""


def collect(root: Path, num_groups: int = 2) -> str:
    """Collect or resume a dataset of two groups a shard, one rollout a group; its identity."""
    with DatasetWriter(root, DESCRIPTOR, groups_per_shard=2) as writer:
        for index in range(num_groups):
            if not writer.is_closed(f"g{index}"):
                with writer.begin_group(f"g{index}", index=index) as group:
                    write_group(group, ATTEMPTS[:1], has_evidence=False)
            writer.commit()
        return writer.finalize()


def retry(root: Path) -> str:
    """Add a second attempt to a committed group of a finished dataset, or resume doing so."""
    with DatasetWriter(root, DESCRIPTOR, groups_per_shard=2) as writer:
        with writer.begin_group("g0") as group:
            if group.find("nominal", "nominal", attempt=2) is None:
                write_rollout(group, "nominal", "nominal", has_evidence=False)
        return writer.finalize()


def check_visible(root: Path) -> None:
    """Raise unless everything visible in a possibly unfinished dataset is whole."""
    if not (root / "branchdrive.json").exists():
        return
    dataset = open_dataset(root)
    for name in dataset.descriptor.tables:
        dataset.table(name).read()
    for group_id in dataset.groups:
        dataset.group(group_id).record()
    if (root / MANIFEST_FILE).exists():
        manifest, problems = parse_manifest((root / MANIFEST_FILE).read_bytes())
        if problems or manifest != build_manifest(root):
            raise RuntimeError(f"visible manifest is not that of the files: {problems}")


def _killed_child(work: Callable[[], object], fatal_event: int) -> bool:
    """Fork a child that kills itself before its name operation `fatal_event`; whether it got that far."""
    pid = os.fork()
    if pid == 0:
        num_events = 0

        def count(event: str, args: tuple[object, ...]) -> None:
            nonlocal num_events
            if event in NAME_EVENTS:
                num_events += 1
                if num_events == fatal_event:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        try:
            work()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    if not os.WIFSIGNALED(status) and os.WEXITSTATUS(status):
        raise RuntimeError(f"child failed before event {fatal_event}")
    return os.WIFSIGNALED(status)


def sweep(folder: Path, work: Callable[[Path], str], start: Path | None) -> dict[str, object]:
    """Kill `work` before each of its name operations in turn, resume it, and compare with an uninterrupted run."""

    def fresh(name: str) -> Path:
        root = folder / name
        shutil.rmtree(root, ignore_errors=True)
        if start is not None:
            shutil.copytree(start, root)
        return root

    folder.mkdir()
    expected = fresh("expected")
    identity = work(expected)
    manifest = (expected / MANIFEST_FILE).read_bytes()
    num_kills, differing = 0, []
    while _killed_child(partial(work, root := fresh("killed")), num_kills + 1):
        num_kills += 1
        check_visible(root)
        if work(root) != identity or (root / MANIFEST_FILE).read_bytes() != manifest:
            differing.append(num_kills)
    return {"num_kills": num_kills, "differing": differing}


def main() -> None:
    mode, folder = sys.argv[1], Path(sys.argv[2])
    if mode == "collect":
        sys.stdout.write("begins\n")
        sys.stdout.flush()
        collect(folder, num_groups=8)
        return
    finished = folder / "finished"
    collect(finished)
    for name, work, start in (("collect", collect, None), ("retry", retry, finished)):
        sys.stdout.write(json.dumps({"name": name, **sweep(folder / name, work, start)}) + "\n")


if __name__ == "__main__":
    main()
