"""The archive of all cases: how `make cases` writes it, and how the runner reads it."""

from __future__ import annotations

import gzip
import io
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

from branchdrive.contract.layout import unsafe_reason
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.contract.text import quote
from branchdrive.errors import UsageError

__all__ = ["pack", "unpacked"]


def pack(folder: Path, target: Path) -> str:
    """Write all files below `folder` into one archive, and its digest into a file beside it.

    Equal files give an equal archive with one version of zlib.

    Returns:
        SHA-256 of the archive, hexadecimal.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            entry = tarfile.TarInfo(path.relative_to(folder.parent).as_posix())
            content = path.read_bytes()
            entry.size, entry.mode = len(content), 0o644
            archive.addfile(entry, io.BytesIO(content))
    target.write_bytes(gzip.compress(packed.getvalue(), mtime=0))
    digest = sha256(target.read_bytes()).hexdigest()
    target.with_name(f"{target.name}.sha256").write_text(f"{digest}  {target.name}\n", encoding="utf-8")
    return digest


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Folder of the cases in an archive, for as long as it is needed.

    Raises:
        UsageError: The file is no archive of cases of this version.
    """
    with tempfile.TemporaryDirectory(prefix="branchdrive-cases-") as scratch:
        try:
            with tarfile.open(path) as archive:
                for entry in archive:
                    content = archive.extractfile(entry) if entry.isreg() else None
                    if content is None or unsafe_reason(entry.name) is not None:
                        raise UsageError(f"--cases: {str(path)!r} holds {quote(entry.name)}, no plain file inside it")
                    target = Path(scratch) / entry.name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(content.read())
        except (OSError, tarfile.TarError) as error:
            raise UsageError(f"--cases: {str(path)!r} is no archive of cases: {error}") from error
        folder = Path(scratch) / f"v{SPEC_VERSION}"
        if not (folder / "bases").is_dir():
            raise UsageError(f"--cases: {str(path)!r} holds no cases of version {SPEC_VERSION}")
        yield folder
