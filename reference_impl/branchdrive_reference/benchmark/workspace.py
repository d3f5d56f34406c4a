"""Where a benchmark is at work until it is published: checkpoints, folds, and the lock, beside the release's files.

The folder is of one release: it carries the identity in its name, and goes once everything in it is published.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from branchdrive.contract.layout import BENCHMARK
from branchdrive.errors import DatasetError
from branchdrive.formats.durable import delete, make_dir, replace_file
from branchdrive.formats.folder import folder_of
from branchdrive.release.publish import benchmark_area, lock_area, make_private, publish_layer
from branchdrive_reference.benchmark.release import Release, open_release

__all__ = ["Workspace", "open_workspace"]


@dataclass(frozen=True)
class Workspace:
    """The working area of a benchmark, held by this process alone.

    Attributes:
        release: The release.
        area: Folder of what is not published yet.
    """

    release: Release
    area: Path

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints."""
        return self.area / "checkpoints"

    @property
    def folds(self) -> Path:
        """Folder of the checkpoints of the folds."""
        return self.area / "folds"

    def read(self, path: str) -> bytes | None:
        """A file of the benchmark layer: the one that waits here, else the published one, else ``None``."""
        waiting = self.area / path.removeprefix(f"{BENCHMARK}/")
        if waiting.is_file():
            return waiting.read_bytes()
        return self.release.content(path) if path in self.release.manifest.files else None

    def keep(self, path: str, content: bytes) -> None:
        """Let a file of the benchmark layer wait here until it is published."""
        waiting = self.area / path.removeprefix(f"{BENCHMARK}/")
        make_dir(waiting.parent)
        replace_file(waiting, content)

    def drop(self, path: str) -> None:
        """Let a file wait no longer; nothing happens if it does not."""
        delete(self.area / path.removeprefix(f"{BENCHMARK}/"))

    def restore(self) -> None:
        """Bring published checkpoints here, so that what is trained is not trained again."""
        make_dir(self.checkpoints)
        prefix = f"{BENCHMARK}/checkpoints/"
        for path in self.release.manifest.files if self.release.has_benchmark else ():
            name = path.removeprefix(prefix)
            if path == f"{prefix}{name}" and "/" not in name and not (self.checkpoints / name).exists():
                replace_file(self.checkpoints / name, self.release.content(path))

    def publish(self, files: dict[str, bytes]) -> None:
        """Make `files` the benchmark layer of the release, and remove those that waited."""
        manifest = publish_layer(folder_of(self.release.layer.folder, "a benchmark"), BENCHMARK, files)
        self.tidy(manifest.files)

    def tidy(self, published: Mapping[str, str] | None = None) -> None:
        """Remove what waits here and is published, byte for byte.

        Args:
            published: SHA-256 of published files by path; those of the release's manifest by default.
        """
        listed = self.release.manifest.files if published is None else published
        for file in [entry for entry in sorted(self.area.rglob("*")) if entry.is_file()]:
            path = f"{BENCHMARK}/{file.relative_to(self.area).as_posix()}"
            if listed.get(path) == hashlib.sha256(file.read_bytes()).hexdigest():
                delete(file)

    def reopened(self) -> Workspace:
        """The same working area with the release as it is now, after something was published."""
        return Workspace(open_release(self.release.root), self.area)


@contextmanager
def open_workspace(release: Release) -> Iterator[Workspace]:
    """The working area of the benchmark of a release.

    Raises:
        UsageError: Another build or benchmark is running there, or a link leads out of it.
        DatasetError: The release has changed meanwhile.
    """
    with lock_area(release.root):
        area = benchmark_area(folder_of(release.layer.folder, "a benchmark"))
        if area.name.removeprefix("benchmark-") != release.manifest.identity[:16]:
            raise DatasetError(f"{release.root}: was built again in the meantime; run the command again")
        make_private(area)
        workspace = Workspace(release, area)
        try:
            yield workspace
        finally:
            workspace.tidy()
            _drop_empty(area)


def _drop_empty(area: Path) -> None:
    for folder in (*(area / "folds").glob("*"), area / "checkpoints", area / "folds", area):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
