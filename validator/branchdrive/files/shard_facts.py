"""What the files and rows of a shard say of themselves, for the rules on the whole dataset."""

from __future__ import annotations

from dataclasses import dataclass, field

from branchdrive.contract.mismatch import Mismatch
from branchdrive.driving.response import Responses

__all__ = ["ShardFacts"]


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
        present: Tables that are there.
        rows: Rows of each table.
        rollout_ids: Identities of the attempts.
        group_ids: Identities of the groups.
        responses: What its interventions do, where its rows could be judged.
        tracks: What the ego did in the attempts of each group, as digests.
        extremes: Smallest and largest value of every column of numbers of the observations.
        num_images: Images that were looked at.
        media_mismatches: What is wrong with them.
    """

    folder: str
    num_tables: int = 0
    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    undecodable: dict[str, str] = field(default_factory=dict)
    over_limit: dict[str, str] = field(default_factory=dict)
    type_mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)
    metadata_mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)
    present: tuple[str, ...] = ()
    rows: dict[str, int] = field(default_factory=dict)
    rollout_ids: list[str] = field(default_factory=list)
    group_ids: list[str] = field(default_factory=list)
    responses: Responses = field(default_factory=Responses.none)
    tracks: dict[str, frozenset[int]] = field(default_factory=dict)
    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)
    num_images: int = 0
    media_mismatches: list[Mismatch] = field(default_factory=list)
