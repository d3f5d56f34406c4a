"""The lock of a closed loop, fixed before the first drive, and the record of plans that were driven.

``drive_lock.json`` names everything that decides the drives: locks of the release, selectors, plan, schedule, noise,
substitutes, gate and tests. A run under another lock is another run and takes another folder.

The record lies beside the release, ``NAME.drives.json``, as the release and its ledgers are about the test partition,
which no drive looks at. It has an entry for each plan and lock: a plan that was driven under two locks has been looked
at twice, and what was seen at first may have decided what was driven then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from branchdrive.benchmark.lock import lock_digest
from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.layout import LOCK_FILE, RANKING_LOCK_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.durable import partial_path, replace_file
from branchdrive.formats.named_file import read_named_file
from branchdrive.runtime.file_lock import FileLock
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.closed_loop.arm import Arm
from branchdrive_reference.closed_loop.plan import Plan
from branchdrive_reference.version import SIMULATOR_VERSION

__all__ = ["LOCK_NAME", "SUBSTITUTES", "drive_lock", "keep_lock", "ledger_path", "record_access", "warnings_of"]

LOCK_NAME = "drive_lock.json"

SUBSTITUTES = {
    "expert": "the privileged expert of the world drives wherever no policy is active: a supervised expert, and no "
    "autonomous driving",
    "stored_nominal": "in the window of the first decision, the command of the nominal pass at that tick; after it, "
    "the expert's command of the tick",
}
"""What stands in for what."""

GATE = {
    "quantity": "share of drives with a collision, less that of nominal's drives of the same groups",
    "fails": "where it is above 0",
}
"""The non-worsening gate."""

TESTS = {
    "quantity": "driving score less nominal's of the same group",
    "test": "sign flips of route clusters, two-sided",
    "family": "every selector but nominal, schedule and condition of the plan, adjusted by Holm",
}

_MOST_ENTRIES = 10_000


def drive_lock(
    release: Release,
    plan: Plan,
    simulator: str,
    arms: Sequence[Arm],
    selectors: Sequence[Mapping[str, Any]],
    *,
    profile: str,
    looks_ahead: bool,
    statistics: Mapping[str, int],
) -> dict[str, Any]:
    """The document ``drive_lock.json``.

    Args:
        release: What selectors are from.
        plan: Groups.
        simulator: Name and version of the simulator.
        arms: What is driven in every group.
        selectors: What is locked of each selector.
        profile: Name of the preference.
        looks_ahead: Whether the bank is driven ahead at every decision.
        statistics: Seed, resamples and flips.
    """
    locks = {name: release.document(path) for name, path in (("prediction", LOCK_FILE), ("ranking", RANKING_LOCK_FILE))}
    return {
        "kind": "drive",
        "code": {"package": "branchdrive", "version": SIMULATOR_VERSION},
        "release_identity": release.manifest.identity,
        "locks": {name: None if document is None else lock_digest(document) for name, document in locks.items()},
        "plan_digest": plan.digest(simulator),
        "plan": plan.document(simulator),
        "profile": profile,
        "looks_ahead": looks_ahead,
        "selectors": list(selectors),
        "arms": [arm.document for arm in arms],
        "substitutes": SUBSTITUTES,
        "gate": GATE,
        "tests": TESTS,
        "statistics": dict(statistics),
    }


def keep_lock(folder: Path, document: Mapping[str, Any]) -> None:
    """Store a lock in the folder of a run, or find that it is the one that is there.

    Raises:
        UsageError: Another lock is there, or something else.
    """
    path, content = folder / LOCK_NAME, dump_json(document)
    if not path.exists():
        if {*folder.iterdir()} - {partial_path(path)}:  # which a run leaves that is killed while it locks
            raise UsageError(f"--output: {str(folder)!r} holds files and no {LOCK_NAME}; name a new folder")
        replace_file(path, content)
    elif read_named_file(path, spec_limits().max_document_bytes) != content:
        raise UsageError(
            f"--output: {str(folder)!r} holds drives under another lock; what is driven is fixed before the first "
            "drive, so name a new folder"
        )


def ledger_path(release: Release) -> Path:
    """Where the plans are on record that were driven for a release."""
    root = release.root.resolve()
    return root.with_name(f"{root.name}.drives.json")


def record_access(release: Release, lock: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Put a plan and lock on record before it is driven; nothing happens where they are.

    Returns:
        All entries.

    Raises:
        DatasetError: The record cannot be read.
    """
    path = ledger_path(release)
    entry = {"event": "drives_executed", "plan_digest": lock["plan_digest"], "lock_digest": lock_digest(lock)}
    with FileLock(path.with_name(f".{path.name}.lock")):
        entries = _entries(path)
        if entry not in [{name: one[name] for name in entry} for one in entries]:
            entries.append({"number": len(entries) + 1, **entry})
            replace_file(path, dump_json({"entries": entries}))
    return entries


def warnings_of(entries: Sequence[Mapping[str, Any]], lock: Mapping[str, Any]) -> list[str]:
    """What tables warn of: a plan that was driven before under another lock."""
    locks = {entry["lock_digest"] for entry in entries if entry["plan_digest"] == lock["plan_digest"]}
    if len(locks) < 2:
        return []
    return [
        f"The population of this plan was driven under {len(locks)} locks: selectors, schedules or noise may have been "
        "chosen by what was seen before, and results on it are optimistic. A plan of another seed is untouched."
    ]


def _entries(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    wanted = {"number", "event", "plan_digest", "lock_digest"}
    try:
        found = parse_json(read_named_file(path, spec_limits().max_document_bytes))
        entries = found["entries"]
        if len(entries) > _MOST_ENTRIES or any({*entry} != wanted for entry in entries):
            raise ValueError("it has entries of another form")
    except (ValueError, RecursionError, TypeError, KeyError) as error:
        raise DatasetError(f"{path}: is no record of plans: {error}; move it away") from error
    return list(entries)
