"""The front matter of a dataset card: what hubs read of a release, and which files hold the splits of its tables.

YAML whose texts are written as JSON, which is YAML too. Source: spec/10-layers.md#card.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import LAYERS, table_pattern
from branchdrive.contract.text import one_line

__all__ = ["front_matter"]

SPLITS: Mapping[str, str] = {"val": "validation"}
"""Partitions that hubs know by another name."""

_TAGS = ("branchdrive", "autonomous-driving", "counterfactual")
_DEFAULT = "scalars"
_BANK = "bank"
"""Split of the table of actions, which are of no partition."""

_HUB_LICENCES = frozenset({
    "agpl-3.0", "apache-2.0", "bsd-2-clause", "bsd-3-clause", "cc-by-2.0", "cc-by-2.5", "cc-by-3.0", "cc-by-4.0",
    "cc-by-nc-2.0", "cc-by-nc-3.0", "cc-by-nc-4.0", "cc-by-nc-nd-3.0", "cc-by-nc-nd-4.0", "cc-by-nc-sa-2.0",
    "cc-by-nc-sa-3.0", "cc-by-nc-sa-4.0", "cc-by-nd-4.0", "cc-by-sa-3.0", "cc-by-sa-4.0", "cc0-1.0",
    "cdla-permissive-1.0", "cdla-permissive-2.0", "cdla-sharing-1.0", "etalab-2.0", "eupl-1.1", "gpl-2.0", "gpl-3.0",
    "isc", "lgpl-3.0", "mit", "mpl-2.0", "odc-by", "odbl", "pddl", "unlicense",
})  # fmt: skip
"""Identifiers of licences that hubs know, which are those of SPDX in lower case but for `_HUB_NAMES`."""

_HUB_NAMES = {"odc-by-1.0": "odc-by", "odbl-1.0": "odbl", "pddl-1.0": "pddl"}
"""Identifiers of hubs where they are others, by that of SPDX."""


def front_matter(descriptor: Descriptor, population: Mapping[str, Any], optional: Collection[str] = ()) -> list[str]:
    """Lines of the front matter, its fences included.

    Args:
        descriptor: What the release is.
        population: Its stages by partition: a partition without a group in the frozen population is no split.
        optional: Names of the optional tables that it has.
    """
    lines = ["---", *_licence(descriptor.licence), f"pretty_name: {_text(descriptor.title)}", "tags:"]
    lines += [f"- {_text(tag)}" for tag in dict.fromkeys((*_TAGS, *descriptor.keywords))]
    if "model" in descriptor.layers:
        groups = next((stage["groups"] for stage in population["stages"] if stage["stage"] == "frozen"), None) or {}
        present = [name for name in population["partitions"] if groups.get(name)]
        lines += ["configs:", *(line for table in _tables(descriptor, optional) for line in _config(table, present))]
    return [*lines, "---"]


def _licence(spdx: str) -> list[str]:
    known = spdx.lower()
    known = _HUB_NAMES.get(known, known)
    if known in _HUB_LICENCES:
        return [f"license: {known}"]
    return ["license: other", f"license_name: {_text(re.sub('[^a-z0-9.]+', '-', known).strip('-'))}"]


def _tables(descriptor: Descriptor, optional: Collection[str]) -> Iterator[str]:
    """Tables of the model layer that have a row for every group; which media there are hangs on the group."""
    for name, table in LAYERS["model"].tables.items():
        if name == "surroundings" and "actor_risk_evidence" not in descriptor.streams:
            continue
        if name != "media_index" and (not table.optional or name in optional):
            yield name


def _config(table: str, partitions: Sequence[str]) -> list[str]:
    files = {_BANK: table_pattern(table)}
    if LAYER_TABLES[table].partitions:
        files = {SPLITS.get(name, name): table_pattern(table, name) for name in partitions}
    return [
        f"- config_name: {table}",
        *(["  default: true"] if table == _DEFAULT else []),
        "  data_files:",
        *(line for split, path in files.items() for line in (f"  - split: {split}", f"    path: {path}")),
    ]


def _text(text: str) -> str:
    return json.dumps(one_line(text), ensure_ascii=False)
