"""Names beside a dataset: what people, hubs and systems add to its folder, which is no part of it and never read.

Source: spec/03-layout.md#companions.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from fnmatch import translate

from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import (
    CARD_FILE,
    DESCRIPTOR_FILE,
    LICENCE_FILE,
    MANIFEST_FILE,
    RAW_DIR,
    STAGING_DIR,
    folded,
)
from branchdrive.contract.limits import spec_limits

__all__ = ["CODEMETA_FILE", "CROISSANT_FILE", "IGNORE_FILE", "ZENODO_FILE", "Companions", "ignored_names"]

IGNORE_FILE = ".branchdriveignore"
"""Patterns of further names in the root that are no part of the dataset, one a line."""

CROISSANT_FILE, ZENODO_FILE, CODEMETA_FILE = "croissant.json", ".zenodo.json", "codemeta.json"
"""What search engines, loaders and archives read about a dataset."""

_IN_ROOT = frozenset({
    ".cache", ".git", ".gitattributes", ".gitignore", ".huggingface", CARD_FILE, IGNORE_FILE, CROISSANT_FILE,
    ZENODO_FILE, CODEMETA_FILE,
})  # fmt: skip
_ANYWHERE = frozenset({".DS_Store", "Thumbs.db"})
_OWN = frozenset(map(folded, (DESCRIPTOR_FILE, LICENCE_FILE, MANIFEST_FILE, RAW_DIR, STAGING_DIR, *LAYERS)))
"""Names in the root that an ignore file cannot take from the dataset, nor names that some systems take for them."""


class Companions:
    """Which paths of a folder are no part of the dataset in it.

    Args:
        listed: Paths that the manifest lists: they are part of it, whatever they are called.
        patterns: Patterns of the ignore file.
    """

    def __init__(self, listed: Collection[str] = (), patterns: Collection[str] = ()) -> None:
        self._listed = frozenset(path for whole in map(folded, listed) for path in (whole, whole.split("/")[0]))
        self._ignored = re.compile("|".join(map(_expression, patterns))) if patterns else None

    def __contains__(self, path: str) -> bool:
        same = folded(path)
        if same in self._listed:
            return False
        name = path.rsplit("/", 1)[-1]
        if name in _ANYWHERE:
            return True
        if "/" in path or same in _OWN:
            return False
        return name in _IN_ROOT or bool(self._ignored and self._ignored.match(name))


def _expression(pattern: str) -> str:
    """Regular expression of a pattern, in which `*` and `?` alone have a meaning."""
    return translate(pattern.replace("[", "[[]"))


def ignored_names(content: bytes) -> tuple[str, ...]:
    """Patterns of an ignore file: names in the root, with `*` and `?`; blank lines and those from `#` on say nothing.

    Raises:
        ValueError: It is not UTF-8, exceeds the limits, or a line is no pattern of a name.
    """
    limits = spec_limits()
    if len(content) > limits.max_ignore_bytes:
        raise ValueError(f"has more than {limits.max_ignore_bytes} bytes, the limit")
    lines = [line.removesuffix("\r") for line in content.decode("utf-8").split("\n")]
    patterns = tuple(line.removesuffix("/") for line in lines if line.strip() and not line.startswith("#"))
    if len(patterns) > limits.max_ignore_patterns:
        raise ValueError(f"has {len(patterns)} patterns; the limit is {limits.max_ignore_patterns}")
    for pattern in patterns:
        if "/" in pattern or pattern != pattern.strip():
            raise ValueError(f"names {pattern!r}, and a pattern is of one name in the root, without blanks around it")
    return patterns
