"""What the files and rows of a shard say of themselves, for the rules on the whole dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mismatch, Mismatches
from branchdrive.driving.response import Responses, Sights
from branchdrive.driving.track_end import TrackEnds
from branchdrive.files.group_marks import Outlines, Tracks
from branchdrive.files.identities import Identities, repeated_texts

__all__ = ["ShardFacts", "num_groups", "repeated_rollouts", "scattered_groups"]


@dataclass
class ShardFacts:
    """Facts of one shard that rules on the whole dataset judge; mismatches of files are by path.

    Attributes:
        folder: The shard's folder, relative to the root.
        num_tables: Tables that were looked for.
        digests: SHA-256 of every file that was read.
        unreadable: Why files could not be read.
        undecodable: Why tables do not decode.
        over_limit: How files exceed the limits.
        type_mismatches: Columns that are missing, undeclared or of another type.
        metadata_mismatches: Columns whose unit, frame, shape or track is not recorded as declared.
        trace_mismatches: Metadata of files that hold a trace of the machine that wrote them.
        present: Tables that are there.
        rows: Rows of each table.
        rollout_ids: Identities of the attempts.
        group_ids: Identities of the groups.
        judged: Of every rule on single attempts, how many fail it and how many were examined; of relations of motion,
            how many break them and how many were compared, whatever contacts they have.
        num_missing_attempts: How many attempts lack, by the numbers of the others.
        in_contact: How many attempts have a contact, of how many with evidence.
        groups: SHA-256 of the content of each branch group, in the order of their identities ``[groups, 32]``; ``None``
            where they were not computed, or rows have no place in them.
        responses: What its interventions do, where its rows could be judged.
        sights: What the images of each camera show of that, by its name.
        outlines: What each group is like, whatever its names, its place and its direction.
        tracks: What the ego did in the attempts of each group, as digests.
        calibration: Sign, unit and clock of recorded motion: values of every quantity in its attempts.
        extremes: Smallest and largest value of every column of numbers of the observations.
        track_ends: Where tracks of actors begin and end.
        widths: Numbers of egos and of tracks of vehicles that are too narrow, too wide, and of all, by their table.
        maps: Digest of the map of each town, where its rows could be judged.
        lanes: Numbers of vehicles along each lane and against it, by town and lane.
        num_images: Images that were looked at.
        media_mismatches: Which of them are not where the index says, by file.
        archive_mismatches: What archives of media hold beside them, by archive.
        stored_code: Media that hold code, and of which kind.
        scenario_types: Scenario types of the attempts, where their rows could be judged.
    """

    folder: str
    num_tables: int = 0
    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    undecodable: dict[str, str] = field(default_factory=dict)
    over_limit: dict[str, str] = field(default_factory=dict)
    type_mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)
    metadata_mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)
    trace_mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)
    present: tuple[str, ...] = ()
    rows: dict[str, int] = field(default_factory=dict)
    rollout_ids: Sequence[str] = field(default_factory=Identities)
    group_ids: Sequence[str] = field(default_factory=Identities)
    judged: dict[str, tuple[int, int]] = field(default_factory=dict)
    num_missing_attempts: int = 0
    in_contact: tuple[int, int] = (0, 0)
    groups: NDArray[np.uint8] | None = None
    responses: Responses = field(default_factory=Responses.none)
    sights: dict[str, Sights] = field(default_factory=dict)
    outlines: Outlines = field(default_factory=Outlines.none)
    tracks: Tracks = field(default_factory=Tracks.none)
    calibration: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)
    track_ends: TrackEnds = field(default_factory=TrackEnds.none)
    widths: dict[str, tuple[int, int, int]] = field(default_factory=dict)
    maps: dict[str, str] = field(default_factory=dict)
    lanes: dict[tuple[str, str], tuple[int, int]] = field(default_factory=dict)
    num_images: int = 0
    media_mismatches: dict[str, Mismatches] = field(default_factory=dict)
    archive_mismatches: dict[str, Mismatches] = field(default_factory=dict)
    stored_code: dict[str, str] = field(default_factory=dict)
    scenario_types: frozenset[str] = frozenset()


def repeated_rollouts(shards: Sequence[ShardFacts]) -> dict[str, int]:
    """Identities of attempts that occur more than once in the dataset, and how often."""
    return {text: len(places) for text, places in repeated_texts([shard.rollout_ids for shard in shards]).items()}


def scattered_groups(shards: Sequence[ShardFacts]) -> dict[str, list[str]]:
    """Identities of groups that lie in several shards, and the folders of these."""
    repeated = repeated_texts([shard.group_ids for shard in shards])
    return {text: [shards[place].folder for place in places] for text, places in repeated.items()}


def num_groups(shards: Sequence[ShardFacts]) -> int:
    """Groups of the dataset; one that lies in several shards is one."""
    repeated = scattered_groups(shards).values()
    return sum(len(shard.group_ids) for shard in shards) - sum(len(folders) - 1 for folders in repeated)
