"""A file that the user names, wherever it lies and whatever links lead there; it is no device."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from branchdrive.errors import DatasetError
from branchdrive.formats.file_error import machine_faults

__all__ = ["read_named_file"]


def read_named_file(path: Path, max_bytes: int) -> bytes:
    """Content of a regular file.

    Raises:
        DatasetError: There is none, it cannot be opened, or it has more than `max_bytes` bytes; the message leaves
            the path to the caller.
    """
    try:
        with machine_faults(path):
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        raise DatasetError("does not exist") from None
    except (OSError, ValueError) as error:
        raise DatasetError(f"cannot be opened ({getattr(error, 'strerror', None) or error})") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise DatasetError("is not a regular file")
    with os.fdopen(descriptor, "rb") as stream:
        content = stream.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise DatasetError(f"has more than {max_bytes} bytes, the spec limit")
    return content
