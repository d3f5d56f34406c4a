"""Determinism of a collector by running it again: in a fresh process, in another order, without other seeds before.

Runs are compared by decoded content, attempt by attempt; files may differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from branchdrive.errors import BranchDriveError
from branchdrive.formats.store import Store
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.rerun import Run
from branchdrive.pilot.reruns import NO_COMMAND, Reruns
from branchdrive.pilot.sameness import Sameness, compare_runs
from branchdrive.pilot.section import Concern, Section
from branchdrive.text.table import Column, Table

__all__ = ["determinism"]

_TITLE = "Determinism"

_NEVER = "another machine, other versions of libraries or drivers, and another number of workers: run it there as well"

_STATE = (
    "Draw everything from the group's own seed at the start of each rollout: seed every random generator (Python, "
    "numpy, simulator, traffic manager) again, start from a fresh world, and take nothing from the place in the list "
    "or from what ran before."
)


class _Trial(NamedTuple):
    """One run beside the pilot or the fresh run, and what came of it."""

    name: str
    what: str
    run: Run
    sameness: Sameness | None
    failure: str | None


def determinism(pilot: Pilot, reruns: Reruns | None) -> Section:
    """Run the command again and compare, as far as its placeholders allow."""
    if not pilot.parts:
        return Section("determinism", _TITLE, not_examined=[pilot.unread])
    if reruns is None:
        return Section("determinism", _TITLE, not_examined=[NO_COMMAND])
    trials = list(_trials(pilot, reruns))
    concerns = [concern for trial in trials for concern in _concerns(trial, trials)]
    if pilot.descriptor.collection.replay_noise.kind == "natural" and trials[-1].name == "again":
        concerns = [_as_declared(concern) for concern in concerns]
    rows = [
        [
            trial.what, f"{trial.run.seconds:.1f}",
            trial.failure or ("equal" if trial.sameness and trial.sameness.is_same else "differs"),
        ]
        for trial in trials
    ]  # fmt: skip
    heads = [Column.name("Run"), Column("Seconds"), Column("Content", is_text=True)]
    facts = [f"{trial.what}: {trial.sameness.text}." for trial in trials if trial.sameness is not None]
    return Section(
        "determinism", _TITLE, facts, concerns, [Table("Runs", heads, rows)], [*_untried(reruns, trials), _NEVER],
        {trial.name: _figures(trial) for trial in trials},
    )  # fmt: skip


def _trials(pilot: Pilot, reruns: Reruns) -> Iterator[_Trial]:
    command, group_ids = reruns.command, pilot.group_ids
    fresh = reruns.fresh
    first = _compared("fresh", "The same groups in a fresh process", pilot.dataset, fresh)
    yield first
    if first.failure is not None:
        return
    if first.sameness is not None and not first.sameness.is_same:
        run = reruns.run("again", "the same groups in a second fresh process", group_ids)
        again = _compared("again", "The same groups in a second fresh process", fresh.dataset, run)
        yield again
        if again.sameness is None or not again.sameness.is_same:
            return  # what differs every time tells nothing of order and seeds
    if len(group_ids) > 1 and (command.takes("groups") or command.takes("order")):
        run = reruns.run("reverse", "the groups in reverse order", group_ids, is_reversed=True)
        yield _compared("reverse", "The groups in reverse order", fresh.dataset, run)
    if len(group_ids) > 1 and command.takes("groups"):
        last = group_ids[-1:]
        run = reruns.run("alone", "the last group alone, without other seeds before it", last)
        yield _compared("alone", f"{last[0]} alone, without other seeds before it", fresh.dataset, run, last)


def _compared(name: str, what: str, first: Store, run: Run, group_ids: list[str] | None = None) -> _Trial:
    if run.failure is not None:
        return _Trial(name, what, run, None, run.failure)
    try:
        return _Trial(name, what, run, compare_runs(first, run.dataset, group_ids), None)
    except (BranchDriveError, OSError) as error:
        return _Trial(name, what, run, None, f"left no finished dataset: {error}")


def _concerns(trial: _Trial, trials: list[_Trial]) -> list[Concern]:
    if trial.failure is not None:
        return [
            Concern(
                f"{trial.what}: the command {trial.failure}.",
                "The command has to collect the groups of the pilot into {out}, finish the dataset there and exit "
                "with 0; try it by hand with an empty folder.",
            )
        ]
    found = trial.sameness
    if found is None or found.is_same:
        return []
    by_name = {each.name: each for each in trials}
    again = by_name.get("again")
    if trial.name == "fresh" and again is not None and again.sameness is not None and again.sameness.is_same:
        differing = f" Descriptors differ in {', '.join(found.descriptor)}." if found.descriptor else ""
        return [
            Concern(
                f"The command gives the same every time, but not what the pilot holds: {found.text}.{differing}",
                "Run the command with the options, versions and machine of the pilot, or collect the pilot again.",
            )
        ]
    if trial.name in ("fresh", "again"):
        return [
            Concern(
                f"{trial.what} gives other data: {found.text}.",
                "Something is drawn from the process: an unseeded generator, the order of a set or of threads, "
                f"wall-clock time, or an asynchronous simulator. {_STATE}",
            )
        ]
    if trial.name == "reverse":
        return [Concern(f"What a group holds depends on the order of groups: {found.text}.", _STATE)]
    return [Concern(f"What a group holds depends on the seeds that ran before it: {found.text}.", _STATE)]


def _as_declared(concern: Concern) -> Concern:
    what = f"{concern.what} The descriptor declares natural noise, so that equal runs are not promised."
    return Concern(what, concern.remedy, is_problem=False)


def _untried(reruns: Reruns, trials: list[_Trial]) -> Iterator[str]:
    names = {trial.name for trial in trials}
    why = ""
    if trials[0].failure is not None:
        why = "the command fails"
    elif trials[-1].name == "again":
        why = "equal runs differ as it is"
    elif len(reruns.pilot.group_ids) == 1:
        why = "the pilot has one group"
    if "reverse" not in names:
        yield f"another order of groups: {why or 'the command has neither {groups} nor {order}'}"
    if "alone" not in names:
        yield f"a group without other seeds before it: {why or 'the command has no {groups}, a list of ids in order'}"


def _figures(trial: _Trial) -> dict[str, Any]:
    found = trial.sameness
    cell = found.difference.first_cell if found is not None else None
    return {
        "seconds": trial.run.seconds,
        "failure": trial.failure,
        "equal": None if found is None else found.is_same,
        "attempts": None if found is None else found.num_compared,
        "changed": None if found is None else len(found.changed),
        "lost": None if found is None else len(found.lost),
        "added": None if found is None else len(found.added),
        "first": None if cell is None else {"table": cell[0], "column": cell[1], **cell[2].location},
    }
