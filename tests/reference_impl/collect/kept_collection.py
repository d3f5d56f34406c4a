"""Collections that tests look at and do not watch."""

from __future__ import annotations

from pathlib import Path

from tests.content_cache import kept_folder

from branchdrive_reference.collect.campaign import collect

__all__ = ["identity_of", "kept_collection"]


def kept_collection(root: Path, *, num_groups: int, seed: int) -> Path:
    """The new folder `root` with a collection of one process, no faults and no noise; `root`."""
    name = f"collected-{seed}-{num_groups}"
    return kept_folder(name, lambda folder: collect(folder, num_groups=num_groups, seed=seed), root)


def identity_of(num_groups: int, seed: int, folder: Path) -> str:
    """Identity of such a collection, which is copied into the folder `folder`."""
    root = kept_collection(folder / "collected", num_groups=num_groups, seed=seed)
    return collect(root, num_groups=num_groups, seed=seed).identity
