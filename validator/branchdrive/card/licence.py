"""The licence file of a release: the identifier that the descriptor states, and where its text is.

Source: spec/10-layers.md#release.
"""

from __future__ import annotations

import re

__all__ = ["render_licence"]


def render_licence(spdx: str) -> str:
    """Text of `LICENCE.txt`: the licence of the data by its SPDX identifier or expression, and where its text is."""
    parts = spdx.split()
    ids = parts[::2]
    is_spdx = len(parts) % 2 == 1 and all(part in ("AND", "OR", "WITH") for part in parts[1::2])
    is_spdx &= all(re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.+-]*", part) and "LicenseRef-" not in part for part in ids)
    lines = [f"SPDX-License-Identifier: {spdx}" if is_spdx else f"Licence: {spdx}", ""]
    lines.append("The data of this dataset, all files of this folder and below it, are licensed under the above.")
    if is_spdx:
        exceptions = {after for part, after in zip(parts[1::2], parts[2::2], strict=True) if part == "WITH"}
        places = [f"  https://spdx.org/licenses/{part}.html" for part in dict.fromkeys(ids) if part not in exceptions]
        lines += [
            "The full text is at:",
            "",
            *places,
            *(f"  https://spdx.org/licenses/{e}.html" for e in sorted(exceptions)),
        ]
    else:
        lines.append(
            "It is no identifier of the SPDX licence list; ask the publisher of the dataset for its full text."
        )
    lines += [
        "",
        "Software that made, reads or validates the data is not part of them and may be under another licence.",
    ]
    return "\n".join(lines) + "\n"
