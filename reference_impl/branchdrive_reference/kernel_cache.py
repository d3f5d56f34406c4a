"""Keeping the on-disk kernel cache honest.

numba decides by the file of a kernel alone whether its cached machine code is still good, but the code of
kernels from other files is compiled into it. So the cache is emptied whenever any source of the package
differs from the sources it was filled from; otherwise an edited or upgraded package could go on
simulating with old code.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

__all__ = ["drop_stale_kernels"]

_STAMP = Path("__pycache__", "kernel-sources.sha256")
_CACHED = ("*.nbi", "*.nbc")


def _digest(package_dir: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(package_dir.rglob("*.py")):
        digest.update(path.relative_to(package_dir).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def drop_stale_kernels(package_dir: Path) -> bool:
    """Remove cached kernels below `package_dir` that were compiled from other sources; whether there was a reason to.

    Where the folder cannot be written, numba keeps its cache elsewhere and nothing is done.
    """
    stamp, digest = package_dir / _STAMP, _digest(package_dir)
    with suppress(OSError):
        if stamp.read_text(encoding="ascii") == digest:
            return False
    with suppress(OSError):
        for pattern in _CACHED:
            for path in package_dir.rglob(pattern):
                path.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest, encoding="ascii")
    return True
