"""How much of a dataset's images a validation decodes. Source: spec/07-rules.md#media."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, TypeAlias

__all__ = ["MEDIA_MODES", "SAMPLE_STEP", "MediaMode"]

MediaMode: TypeAlias = Literal["full", "sample", "index"]

SAMPLE_STEP = 1024
"""One image in so many is decoded where a sample is."""

MEDIA_MODES: Mapping[MediaMode, str] = MappingProxyType(
    {
        "full": "every image is decoded",
        "sample": f"a drawn image in {SAMPLE_STEP:,} is decoded",
        "index": "no image is decoded",
    }
)
"""What each mode does; bytes are compared with the index in any of them."""
