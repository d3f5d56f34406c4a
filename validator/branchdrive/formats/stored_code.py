"""Files that hold code: pickles, whose reading executes what they store, programs and scripts.

They are told by their first bytes, and pickles that have no such bytes by the names that people give them; nothing of
them is read beyond that. Source: spec/09-security.md#serialisation.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["HEAD_BYTES", "stored_code"]

HEAD_BYTES = 4
"""First bytes that tell."""

_HEADS: Mapping[bytes, str] = MappingProxyType(
    {
        **{bytes([0x80, protocol]): "a pickle" for protocol in range(2, 6)},
        b"\x7fELF": "a program",
        b"MZ\x90\x00": "a program",
        b"\xcf\xfa\xed\xfe": "a program",
        b"\xce\xfa\xed\xfe": "a program",
        b"\xca\xfe\xba\xbe": "a program",
        b"#!/": "a script",
    }
)

_PICKLE_SUFFIXES = (".pkl", ".pickle", ".joblib", ".pt", ".pth")


def stored_code(name: str, head: bytes) -> str | None:
    """What kind of code a file holds, by its name and its first `HEAD_BYTES`; ``None`` where these tell of none."""
    if name.lower().endswith(_PICKLE_SUFFIXES):
        return "a pickle"
    return next((kind for start, kind in _HEADS.items() if head.startswith(start)), None)
