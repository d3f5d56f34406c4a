"""Bytes as parts of other bytes: ranges ``[start, stop]`` of them, and base64 of what they do not hold."""

from __future__ import annotations

import base64
from collections.abc import Sequence

__all__ = ["Part", "spliced"]

Part = list[int] | str


def spliced(content: bytes, parts: Sequence[Part]) -> bytes:
    """The bytes that parts of `content` make.

    Raises:
        ValueError: A range is not within the content.
    """
    made = []
    for part in parts:
        if isinstance(part, str):
            made.append(base64.b64decode(part))
            continue
        start, stop = part
        if not 0 <= start < stop <= len(content):
            raise ValueError(f"bytes {start} to {stop} are not within {len(content)}")
        made.append(content[start:stop])
    return b"".join(made)
