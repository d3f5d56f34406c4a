"""Whether a collection fits on its disk, before it begins."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from branchdrive.errors import PlatformError

__all__ = ["GROUPS_PER_SHARD", "DiskNeed", "disk_need", "free_disk_bytes"]

GROUPS_PER_SHARD = 32
"""Groups that are staged together before their shard is written."""

_GROUP_BYTES = 410_000
"""Shard bytes of a group. Measured: 364 kB, the mean of one group of every scenario type with replay noise 1 and
without faults; half of that without noise, since equal histories compress. Rounded up by an eighth."""

_STAGED_GROUP_BYTES = 4_300_000
"""Staged bytes of a group. Measured: 3.98 MB in blocks of 4 KiB, the mean of the same groups; rounded up."""

_GROUPS_IN_WORK_PER_JOB = 2
_MIB, _GIB = 2**20, 2**30


@dataclass(frozen=True)
class DiskNeed:
    """Room that a collection takes and has.

    Attributes:
        num_groups: Groups that are still to be collected.
        needed_bytes: Bytes of their shards and of what is staged at a time.
        free_bytes: Free bytes of the disk.
    """

    num_groups: int
    needed_bytes: int
    free_bytes: int

    def __str__(self) -> str:
        return f"about {_readable(self.needed_bytes)} needed, {_readable(self.free_bytes)} free"

    def check(self, root: Path) -> None:
        """Refuse a collection that does not fit.

        Raises:
            PlatformError: It does not.
        """
        if self.needed_bytes > self.free_bytes:
            raise PlatformError(
                f"{root}: {self.num_groups:,} groups do not fit on this disk: {self}; "
                "make room, choose another folder or fewer groups"
            )


def _readable(num_bytes: int) -> str:
    if num_bytes < _GIB:
        return f"{num_bytes / _MIB:,.0f} MiB"
    return f"{num_bytes / _GIB:,.1f} GiB"


def disk_need(root: Path, num_groups: int, *, jobs: int) -> DiskNeed:
    """Room that `num_groups` groups take on the disk of `root`, which need not exist yet."""
    staged = min(num_groups, GROUPS_PER_SHARD + _GROUPS_IN_WORK_PER_JOB * jobs)
    needed = num_groups * _GROUP_BYTES + staged * _STAGED_GROUP_BYTES
    return DiskNeed(num_groups, needed, free_disk_bytes(root))


def free_disk_bytes(root: Path) -> int:
    """Free bytes of the disk that holds `root` or, while it does not exist, its nearest parent that does."""
    existing = next(path for path in (root, *root.absolute().parents) if path.exists())
    return shutil.disk_usage(existing).free
