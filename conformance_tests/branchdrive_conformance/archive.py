"""The archive of all cases, as `make cases` writes it."""

from __future__ import annotations

import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import UsageError

__all__ = ["unpacked"]


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Folder of the cases in an archive, for as long as it is needed.

    Raises:
        UsageError: The file is no archive of cases of this version.
    """
    with tempfile.TemporaryDirectory(prefix="branchdrive-cases-") as scratch:
        try:
            with tarfile.open(path) as archive:
                archive.extractall(scratch, filter="data")
        except (OSError, tarfile.TarError) as error:
            raise UsageError(f"--cases: {str(path)!r} is no archive of cases: {error}") from error
        folder = Path(scratch) / f"v{SPEC_VERSION}"
        if not (folder / "bases").is_dir():
            raise UsageError(f"--cases: {str(path)!r} holds no cases of version {SPEC_VERSION}")
        yield folder
