"""What the files of a shard say of themselves, whatever rules find in their rows."""

from __future__ import annotations

from dataclasses import dataclass, field

from branchdrive.contract.mismatch import Mismatch

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
        attempts: Digest of the content of each attempt by its identity; ``None`` where they were not computed, or rows
            have no place in them.
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
    attempts: dict[str, str] | None = None
    num_images: int = 0
    media_mismatches: list[Mismatch] = field(default_factory=list)
