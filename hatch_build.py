"""The readme of the package's page: README.md with links that lead there from anywhere.

Links of the README are relative, so that they work in a checkout; an index of packages has no files they could lead to.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

__all__ = ["ReadmeHook", "absolute_links"]

_LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)(?:\./)?(?P<path>[^)\s]+)")
_FENCE = re.compile(r"(^```.*?^```)", re.DOTALL | re.MULTILINE)


def absolute_links(text: str, base: str) -> str:
    """Markdown with its relative links below `base`; code blocks and links within the page stay as they are."""
    parts = _FENCE.split(text)
    return "".join(
        part if part.startswith("```") else _LINK.sub(lambda link: f"{base}/{link['path']}", part) for part in parts
    )


class ReadmeHook(MetadataHookInterface):
    """Gives the metadata their readme."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set `readme`, with links below the homepage of `[project.urls]`; without one they stay relative."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        base = metadata.get("urls", {}).get("Homepage")
        text = absolute_links(text, base) if base else text
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
