"""The licence file of a release: the identifier that the descriptor states, and where its text is.

Source: spec/10-layers.md#release.
"""

from __future__ import annotations

import re

__all__ = ["licence_urls", "render_licence"]


def licence_urls(spdx: str) -> list[str]:
    """Where the texts of an SPDX identifier or expression are, exceptions last; nowhere for anything else."""
    parts = spdx.split()
    ids = parts[::2]
    is_spdx = len(parts) % 2 == 1 and all(part in ("AND", "OR", "WITH") for part in parts[1::2])
    is_spdx &= all(re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.+-]*", part) and "LicenseRef-" not in part for part in ids)
    if not is_spdx:
        return []
    exceptions = {after for part, after in zip(parts[1::2], parts[2::2], strict=True) if part == "WITH"}
    names = [*(part for part in dict.fromkeys(ids) if part not in exceptions), *sorted(exceptions)]
    return [f"https://spdx.org/licenses/{name}.html" for name in names]


def render_licence(spdx: str) -> str:
    """Text of `LICENCE.txt`: the licence of the data by its SPDX identifier or expression, and where its text is."""
    places = licence_urls(spdx)
    lines = [f"SPDX-License-Identifier: {spdx}" if places else f"Licence: {spdx}", ""]
    lines.append("The data of this dataset, all files of this folder and below it, are licensed under the above.")
    if places:
        lines += ["The full text is at:", "", *(f"  {place}" for place in places)]
    else:
        lines.append(
            "It is no identifier of the SPDX licence list; ask the publisher of the dataset for its full text."
        )
    lines += [
        "",
        "Software that made, reads or validates the data is not part of them and may be under another licence.",
    ]
    return "\n".join(lines) + "\n"
