"""The file of a group's picture. The only place where text of a dataset becomes part of a path."""

from __future__ import annotations

import re
from pathlib import Path

from branchdrive.contract.columns import PATTERNS
from branchdrive.errors import UsageError
from branchdrive_reference.study.label import label

__all__ = ["picture_path"]


def picture_path(folder: Path, group_id: str, file_format: str) -> Path:
    """Where the picture of a group lies, directly in `folder`.

    Raises:
        UsageError: The id is none that the format allows: it might name a place elsewhere.
    """
    if not re.fullmatch(PATTERNS["id"], group_id):
        raise UsageError(
            f"group '{label(group_id)}' has an id that the format does not allow; no picture is named after it"
        )
    return folder / f"{group_id}.{file_format}"
