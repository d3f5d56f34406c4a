"""A pilot in memory: the validator's report, the tables of every shard, and the rows that a release would be built of.

A pilot is a dozen groups, so that all of it fits into memory at once.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from branchdrive.contract.descriptor import Descriptor
from branchdrive.driving.response import Responses
from branchdrive.engine.examine import examine
from branchdrive.engine.raw_rows import raw_rows_of
from branchdrive.engine.reading import Progress
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.errors import BranchDriveError, UsageError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.quality.collected import Collected
from branchdrive.quality.qualification import first_attempts
from branchdrive.raw.examination import Examination
from branchdrive.raw.motion.response import responses
from branchdrive.raw.shard import find_shards
from branchdrive.raw.shard_view import ShardView
from branchdrive.runtime.executor import Executor, in_process
from branchdrive.tables.frame import Frame, concat

__all__ = ["MAX_GROUPS", "ROLLOUTS_WANTED", "Part", "Pilot", "read_pilot"]

MAX_GROUPS = 500
"""Groups of the largest pilot: all of it lies in memory."""

ROLLOUTS_WANTED = 24_000
"""Rollouts of the collection that a forecast is made for, unless the user says how many groups."""


@dataclass(frozen=True)
class Part:
    """One shard: its tables, and what the rules found on them."""

    view: ShardView
    examination: Examination


@dataclass(frozen=True)
class Pilot:
    """What the sections of the report are made of.

    Attributes:
        dataset: Where it is.
        report: The validator's.
        validation_s: How long the validation took.
        num_wanted: Groups of the collection that forecasts are for.
        parts: Shards that can be read; none where one cannot.
        unread: Why there are none.
        rows: Rows for derived layers of all shards, by name; none where the raw layer breaks the format.
        no_rows: Why there are none.
    """

    dataset: Store
    report: Report
    validation_s: float
    num_wanted: int
    parts: Sequence[Part]
    unread: str
    rows: Mapping[str, Frame]
    no_rows: str

    @property
    def num_groups(self) -> int:
        """Groups of the pilot."""
        return self.report.dataset.num_groups

    @property
    def group_ids(self) -> list[str]:
        """Groups in order of their identities."""
        return sorted(group_id for part in self.parts for group_id in part.view.group_ids)

    @property
    def descriptor(self) -> Descriptor:
        """What the dataset says of itself; asked for only where there are parts."""
        return self.parts[0].view.descriptor

    @cached_property
    def collected(self) -> Collected:
        """What all shards hold; asked for only where there are parts."""
        return Collected.merged(
            Collected.of(part.view, part.examination, first_attempts(part.view, part.examination))
            for part in self.parts
        )

    def responses(self) -> Responses:
        """What the interventions of all shards did."""
        return Responses.of_all(
            responses(part.view, part.examination.selection, part.examination.broken)[1] for part in self.parts
        )


def read_pilot(
    root: Place, *, num_wanted: int | None = None, executor: Executor = in_process, progress: Progress | None = None
) -> Pilot:
    """Validate the dataset at `root` and read what it holds.

    Args:
        root: The dataset folder.
        num_wanted: Groups that are to be collected; by default as many as have `ROLLOUTS_WANTED` rollouts.
        executor: How the validator runs shards.
        progress: Called after every shard that was validated.

    Raises:
        UsageError: There is no dataset, or it is larger than a pilot.
    """
    dataset, begin_s = open_store(root), time.perf_counter()
    report = validate(dataset, executor=executor, progress=progress)
    validation_s = time.perf_counter() - begin_s
    facts = report.dataset
    if facts.num_groups > MAX_GROUPS:
        raise UsageError(
            f"{str(root)!r} has {facts.num_groups:,} groups; a pilot has at most {MAX_GROUPS}, and a dozen will do"
        )
    parts, unread = _parts(dataset)
    rows, no_rows = _rows(parts) if parts else ({}, unread)
    if num_wanted is None:
        per_group = max(1.0, facts.num_rollouts / max(1, facts.num_groups))
        num_wanted = max(1, round(ROLLOUTS_WANTED / per_group))
    return Pilot(dataset, report, validation_s, num_wanted, parts, unread, rows, no_rows)


def _parts(dataset: Store) -> tuple[list[Part], str]:
    """Shards of a dataset, or why they cannot be read."""
    try:
        descriptor = read_descriptor(dataset)
        parts = []
        for shard in find_shards(dataset):
            tables = {name: shard.decode(name) for name in descriptor.tables}
            view = ShardView(tables, descriptor, file_prefix=shard.prefix)
            parts.append(Part(view, examine(view)[1]))
    except BranchDriveError as error:
        return [], str(error)
    return parts, "" if parts else "the dataset holds no raw shard"


def _rows(parts: Sequence[Part]) -> tuple[Mapping[str, Frame], str]:
    """Rows for derived layers of all shards, or why there are none."""
    if any(part.examination.broken.any() for part in parts):
        return {}, "attempts break the format (see Conformance)"
    with np.errstate(all="ignore"):
        frames = [raw_rows_of(part.view, part.examination, optional=()) for part in parts]
    return {name: concat([frame[name] for frame in frames]) for name in frames[0]}, ""
