"""Crash drill: the command is killed on its way, run again until it ends, and must hold what an undisturbed run holds.

The undisturbed time is cut into equal parts, one more than there are kills: each run is killed after one part, the last
one goes to the end. What a machine loses that fails, beyond what a killed process does, is not tried.
"""

from __future__ import annotations

from branchdrive.contract.text import counted
from branchdrive.errors import BranchDriveError
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.reruns import NO_COMMAND, Reruns
from branchdrive.pilot.sameness import compare_runs
from branchdrive.pilot.section import Concern, Section

__all__ = ["crash_drill"]

_TITLE = "Crash drill"

_NEVER = "power failures and full disks: a kill leaves what the system has buffered, they do not"

_GOES_ON = 0.95
"""Share of the undisturbed time from which on a resumed run seems to have begun from the start."""

_LONG_S = 60.0
"""Parts from which on the time that a command takes to start, and the load of a machine, matter little."""

_COMMIT = (
    "Write a group aside, sync its files, and rename it into place when all of it is there; on the way in, delete what "
    "is half written and collect every group that is not in place."
)


def crash_drill(pilot: Pilot, reruns: Reruns | None, *, num_kills: int) -> Section:
    """Kill the command on its way, let it go on, and compare with the undisturbed run."""
    if not pilot.parts:
        return Section("crash", _TITLE, not_examined=[pilot.unread])
    if reruns is None:
        return Section("crash", _TITLE, not_examined=[NO_COMMAND])
    fresh = reruns.fresh
    if fresh.failure is not None:
        return Section("crash", _TITLE, not_examined=[f"the undisturbed command {fresh.failure}"])
    part_s = fresh.seconds / (num_kills + 1)
    killed_s: list[float] = []
    for number in range(1, num_kills + 1):
        what = f"crash drill, killed after {part_s:.1f} s ({number} of {num_kills})"
        run = reruns.run("killed", what, pilot.group_ids, limit_s=part_s)
        if run.exit_code is not None:
            if run.failure is not None:
                return _refused(killed_s, run.failure)
            break  # it was through before its time
        killed_s.append(run.seconds)
    if not killed_s:
        return Section("crash", _TITLE, not_examined=["the command ended before it could be killed"])
    last = reruns.run("killed", "crash drill, resumed to the end", pilot.group_ids)
    if last.failure is not None:
        return _refused(killed_s, last.failure)
    facts = [
        f"Killed {counted(len(killed_s), 'time')}, after {part_s:.1f} s each, and run again: the last run took "
        f"{last.seconds:.1f} s, an undisturbed one takes {fresh.seconds:.1f} s."
    ]
    figures = {"kills": len(killed_s), "part_s": part_s, "last_s": last.seconds, "undisturbed_s": fresh.seconds}
    try:
        found = compare_runs(fresh.dataset, last.dataset)
    except (BranchDriveError, OSError) as error:
        return Section(
            "crash", _TITLE, facts, [Concern(f"What a resume leaves is no finished dataset: {error}.", _COMMIT)],
            figures={**figures, "equal": False},
        )  # fmt: skip
    facts.append(f"Against the undisturbed run: {found.text}.")
    concerns = []
    if found.lost:
        whole = f"loses {counted(len(found.lost_groups), 'group')}" if found.lost_groups else "loses attempts"
        concerns.append(Concern(f"A resume {whole}: {found.text}.", _COMMIT))
    elif not found.is_same:
        concerns.append(
            Concern(
                f"A resume holds other data than an undisturbed run: {found.text}.",
                f"{_COMMIT} Where Determinism names order or seeds, this is one more case of it.",
                is_problem=pilot.descriptor.collection.replay_noise.kind != "natural",
            )
        )
    if last.seconds > _GOES_ON * fresh.seconds and part_s >= _LONG_S:
        concerns.append(
            Concern(
                f"The last run took {last.seconds:.1f} s of {fresh.seconds:.1f} s: it seems to have started over.",
                "Keep finished groups, and skip them on the way in, or a long collection never ends on a machine that "
                "is taken away now and then.",
                is_problem=False,
            )
        )
    return Section("crash", _TITLE, facts, concerns, not_examined=[_NEVER], figures={**figures, "equal": found.is_same})


def _refused(killed_s: list[float], failure: str) -> Section:
    return Section(
        "crash", _TITLE,
        concerns=[
            Concern(
                f"After {counted(len(killed_s), 'kill')} the command does not go on: it {failure}.",
                "Called again with the folder of a killed run, the command has to go on by itself: replace a stale "
                "lock, delete what is half written, keep what is finished.",
            )
        ],
        figures={"kills": len(killed_s), "equal": False},
    )  # fmt: skip
