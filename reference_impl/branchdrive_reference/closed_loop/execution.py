"""Drives of all groups: one file for each group, so that a run that was killed goes on without losing or repeating one.

A file of a group is written when all arms were driven in it. Which process drives a group changes nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.limits import spec_limits
from branchdrive.driving.target import Targets
from branchdrive.errors import DatasetError
from branchdrive.formats.durable import make_dir, replace_file
from branchdrive.formats.named_file import read_named_file
from branchdrive.runtime.environment import leave_out_pandas
from branchdrive.runtime.progress import unwatched
from branchdrive.runtime.workers import run_each
from branchdrive_reference.closed_loop.arm import Arm
from branchdrive_reference.closed_loop.course import Choices, Course, Driven, Schedule
from branchdrive_reference.closed_loop.outcome import outcome_of
from branchdrive_reference.closed_loop.plan import Plan
from branchdrive_reference.closed_loop.recorder import Recorder
from branchdrive_reference.closed_loop.selector import Selector
from branchdrive_reference.closed_loop.sight import SensorNoise
from branchdrive_reference.closed_loop.site import Field, Nominal, Place

__all__ = ["GroupDriver", "drive_groups", "read_groups"]

_GROUPS = "groups"


@dataclass(frozen=True, eq=False)
class GroupDriver:
    """Drives all arms in a group and writes its file.

    Attributes:
        folder: Folder of the run.
        field: The world.
        seed: Seed of the population.
        bank: Candidates.
        selectors: By name.
        arms: What is driven.
        unrecorded: Columns that the dataset does not record.
        looks_ahead: Whether the bank is driven ahead at every decision, and not at the branch alone.
        recorder: Keeps what is driven as a raw dataset; ``None`` where figures are enough.
    """

    folder: Path
    field: Field
    seed: int
    bank: ActionBank
    selectors: Mapping[str, Selector]
    arms: Sequence[Arm]
    unrecorded: tuple[str, ...]
    looks_ahead: bool = False
    recorder: Recorder | None = None

    def __call__(self, place: Place, between: Callable[..., None]) -> str:
        """Drive a group; its id. Its file comes last, so that a group that has one is recorded as well."""
        replace_file(_path(self.folder, place.group_id), dump_json(self.drive(place, between)))
        return place.group_id

    def drive(self, place: Place, between: Callable[..., None]) -> dict[str, Any]:
        """What the arms came to in a group, as JSON data."""
        site = self.field.site(self.seed, place.index)
        nominal = site.nominal()
        if isinstance(nominal, str):
            self._record(place, None, ())
            return {"group_id": place.group_id, "left_out_because": nominal, "bank": None, "banks": None, "drives": []}
        courses: dict[tuple[int, int, float], Course] = {}

        def course(arm: Arm) -> Course:
            schedule, replay = arm.schedule, arm.condition.replay
            key = (schedule.every_ticks, schedule.num_decisions, replay)
            if key not in courses:
                courses[key] = Course(
                    site, nominal, self.bank, schedule, replay_noise=replay, unrecorded=self.unrecorded
                )
            return courses[key]

        drives: list[dict[str, Any]] = []
        banks: dict[tuple[Schedule, float, Choices], list[list[float | None]]] = {}
        recorded: dict[tuple[Schedule, float, Choices], tuple[Arm, Driven]] = {}
        for arm in self.arms:
            between()
            noise = SensorNoise(arm.condition.sensor, place.seed)
            driven = course(arm).drive(self.selectors[arm.selector], noise)
            for number in range(len(driven.choices) if self.looks_ahead else 0):
                state = (arm.schedule, arm.condition.replay, driven.choices[:number])
                if state not in banks:
                    between()
                    banks[state] = _bank(course(arm).bank_targets(driven.choices[:number]))
            recorded.setdefault((arm.schedule, arm.condition.replay, driven.choices), (arm, driven))
            drives.append({**arm.document, **outcome_of(driven, nominal.branch_tick, self.bank)})
        self._record(place, nominal, [*recorded.values()])
        exact = next(course(arm) for arm in self.arms if arm.condition.replay == 0)
        return {
            "group_id": place.group_id,
            "left_out_because": None,
            "branch_tick": nominal.branch_tick,
            "bank": _bank(exact.bank_targets()),
            "banks": [self._state(*state, bank) for state, bank in banks.items()] if self.looks_ahead else None,
            "drives": drives,
        }

    def _state(
        self, schedule: Schedule, replay: float, choices: Choices, bank: list[list[float | None]]
    ) -> dict[str, Any]:
        """What the bank came to at the decision after some choices, as JSON data."""
        return {
            "every_ticks": schedule.every_ticks,
            "num_decisions": schedule.num_decisions,
            "replay_noise": replay,
            "choices": [self.bank.keys[choice] for choice in choices],
            "bank": bank,
        }

    def _record(self, place: Place, nominal: Nominal | None, drives: Sequence[tuple[Arm, Driven]]) -> None:
        if self.recorder is not None:
            self.recorder.write(place, nominal, drives)


def _bank(targets: Targets) -> list[list[float | None]]:
    return [[value if np.isfinite(value) else None for value in row] for row in targets.values.tolist()]


def _path(folder: Path, group_id: str) -> Path:
    return folder / _GROUPS / f"{group_id}.json"


def drive_groups(
    driver: GroupDriver,
    plan: Plan,
    *,
    closed: Collection[str] | None = None,
    jobs: int,
    between: Callable[[], object] = lambda: None,
    watch: Callable[[int, int], None] = unwatched,
) -> None:
    """Drive the groups that were not driven yet.

    Args:
        driver: What drives a group.
        plan: All groups.
        closed: Groups that are recorded; a group that is none of them is driven again. ``None`` asks for none.
        between: Called after every group.
        jobs: Worker processes; 1 works in this process.
        watch: Called with the number of finished groups and of all, at the beginning and after every group.

    Raises:
        UsageError: A selector cannot decide.
        WorkerError: A worker process died.
        KeyboardInterrupt: The user interrupted; whatever was finished is kept.
    """
    make_dir(driver.folder / _GROUPS)
    missing = [
        place for place in plan.places
        if not _path(driver.folder, place.group_id).exists() or (closed is not None and place.group_id not in closed)
    ]  # fmt: skip
    done = len(plan.places) - len(missing)
    watch(done, len(plan.places))
    with closing(run_each(driver, missing, jobs=jobs, start=leave_out_pandas)) as finished:
        for _ in finished:
            done += 1
            between()
            watch(done, len(plan.places))


def read_groups(folder: Path, plan: Plan) -> list[dict[str, Any]]:
    """What the arms came to in every group of a plan, in its order.

    Raises:
        DatasetError: A file is missing or cannot be read.
    """
    found = []
    for place in plan.places:
        path = _path(folder, place.group_id)
        try:
            document = parse_json(read_named_file(path, spec_limits().max_document_bytes))
        except (OSError, ValueError, RecursionError) as error:
            raise DatasetError(f"{path}: {error}; remove it, and run the command again") from error
        if not isinstance(document, dict) or document.get("group_id") != place.group_id:
            raise DatasetError(f"{path}: is not of this group; remove it, and run the command again")
        found.append(document)
    return found
