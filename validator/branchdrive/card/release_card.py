"""The card of a release, from its descriptor and whatever documents it has."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from branchdrive.card.card import render_card
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import paths_by_table
from branchdrive.contract.layout import FILTERING_FILE, LEAKAGE_FILE, RESULTS_FILE, SOURCE_FILE

__all__ = ["ADDED", "REQUIRED", "release_card"]

_QUALITY = ("population", "split", "thresholds", "retention", "ledger", "variants")

REQUIRED = {"source": SOURCE_FILE, **{name: f"quality/{name}.json" for name in _QUALITY}}
"""Documents that every card is made of: paths by the argument of `render_card`."""

ADDED = {"leakage": LEAKAGE_FILE, "filtering": FILTERING_FILE, "results": RESULTS_FILE}
"""Those that a release may do without."""


def release_card(descriptor: Descriptor, documents: Mapping[str, Any], files: Collection[str] = ()) -> str:
    """The card as Markdown.

    Args:
        descriptor: Of the release.
        documents: Its documents by path; others than `REQUIRED` and `ADDED` are not looked at.
        files: Paths of its files, of which those of optional tables count.
    """
    required = {name: documents[path] for name, path in REQUIRED.items()}
    added: dict[str, Any] = {name: documents.get(path) for name, path in ADDED.items()}
    optional = [name for name in paths_by_table(files) if LAYER_TABLES[name].optional]
    return render_card(descriptor, **required, **added, optional=optional)
