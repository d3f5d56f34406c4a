"""Bytes of a value that waits under a name: a digest of both, and the value.

Who asks for it believes no value: one that is damaged, cut off or another's is none.
"""

from __future__ import annotations

import hashlib

__all__ = ["MAX_ENTRY_BYTES", "DamagedError", "sealed", "unsealed"]

MAX_ENTRY_BYTES = 256 << 20
"""What is larger does not wait, and is not read."""

_DIGEST_BYTES = hashlib.sha256().digest_size


class DamagedError(Exception):
    """What lies under a name is not what was put there."""


def sealed(name: str, value: bytes) -> bytes | None:
    """Bytes that wait under a name; ``None`` where they were too many."""
    return _digest(name, value) + value if len(value) <= MAX_ENTRY_BYTES - _DIGEST_BYTES else None


def unsealed(name: str, content: bytes) -> bytes:
    """The value that waited under a name.

    Raises:
        DamagedError: These are no bytes of one, or those of another name.
    """
    value = content[_DIGEST_BYTES:]
    if content[:_DIGEST_BYTES] != _digest(name, value):
        raise DamagedError(name)
    return value


def _digest(name: str, value: bytes) -> bytes:
    """Digest of a value under its name, so that a renamed one is noticed."""
    return hashlib.sha256(b"\0".join((name.encode(), value))).digest()
