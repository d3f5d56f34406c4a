"""Release rules: the raw layer is the one that was named, and card and licence say what is true.

Source: paper, "Release Structure" and "Intended Use"; spec/10-layers.md#release.
"""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.card.card import ADDED, REQUIRED, release_card
from branchdrive.card.licence import render_licence
from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.layout import CARD_FILE, DESCRIPTOR_FILE, LICENCE_FILE, SOURCE_FILE
from branchdrive.contract.mismatch import Check, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.layers.compare import document_check, text_agrees, text_mismatches
from branchdrive.layers.view import ReleaseView


@rule("BD-REL-001")
def raw_layer_is_the_named_one(view: ReleaseView) -> Iterator[Check]:
    """The digest of the given raw layer is the one in `source.json`."""
    document = view.document(SOURCE_FILE)
    if view.raw.digest is None:
        raise PreconditionError(view.raw.reason or "digests were not computed")
    yield document_check(SOURCE_FILE, 1, text_mismatches("/raw_layer", view.raw.digest, document["raw_layer"]))


@rule("BD-REL-002")
def raw_dataset_agrees(view: ReleaseView) -> Iterator[Check]:
    """The descriptor of the raw dataset is that of the release, but for the layers that it claims."""
    document, raw = view.document(SOURCE_FILE), view.raw.descriptor
    if raw is None:
        raise PreconditionError(view.raw.reason)
    for name, expected in (("dataset_id", raw.dataset_id), ("dataset_version", raw.dataset_version)):
        yield document_check(SOURCE_FILE, 1, text_mismatches(f"/{name}", expected, document[name]))
    named, own = (descriptor.model_dump(mode="json", exclude={"layers"}) for descriptor in (raw, view.descriptor))
    yield document_check(DESCRIPTOR_FILE, len(named), document_mismatches(named, own))


@rule("BD-REL-003")
def card_says_what_the_layers_say(view: ReleaseView) -> Iterator[Check]:
    """The card is the one that descriptor, documents and the names of the files give."""
    there = [*REQUIRED.values(), *(path for path in ADDED.values() if path in view.files)]
    card = release_card(view.descriptor, {path: view.document(path) for path in there}, view.files)
    yield text_agrees(view, CARD_FILE, card)


@rule("BD-REL-004")
def licence_is_the_named_one(view: ReleaseView) -> Iterator[Check]:
    """The licence file names the licence of the descriptor."""
    yield text_agrees(view, LICENCE_FILE, render_licence(view.descriptor.licence))
