"""The file `branchdrive.json`: a dataset's descriptor as bytes."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.refusal import mismatches_of
from branchdrive.errors import DatasetError
from branchdrive.formats.store import Store

__all__ = ["differing_fields", "differing_values", "read_descriptor", "render_descriptor"]

_SHOWN_CHARACTERS = 40


def render_descriptor(descriptor: Descriptor) -> bytes:
    """Canonical bytes of a descriptor."""
    return dump_json(descriptor.model_dump(mode="json"))


def read_descriptor(dataset: Store) -> Descriptor:
    """The descriptor of a dataset.

    Raises:
        DatasetError: There is none, or it does not conform to its schema.
    """
    content = dataset.read(DESCRIPTOR_FILE, spec_limits().max_document_bytes)
    try:
        return Descriptor.model_validate(parse_json(content))
    except ValidationError as error:
        first, *others = mismatches_of(error)
        more = f" ({len(others)} more problems)" if others else ""
        problem = f"{first.location['pointer']}: expected {first.expected}, found {first.found}{more}"
    except ValueError as error:
        problem = str(error)
    raise DatasetError(f"{dataset}: {DESCRIPTOR_FILE!r} is not a descriptor: {problem}; run `branchdrive-validate`")


def differing_fields(dataset: Store, descriptor: Descriptor) -> list[str]:
    """What tells a dataset from `descriptor`, one text for every field that differs.

    Raises:
        DatasetError: The dataset's descriptor cannot be read.
    """
    found = read_descriptor(dataset).model_dump(mode="json")
    texts = differing_values(found, descriptor.model_dump(mode="json"))
    return texts or [f"{DESCRIPTOR_FILE!r} is formatted otherwise"]


def differing_values(found: Any, given: Any) -> list[str]:
    """What tells two JSON values apart, one text for every member of objects in them that differs."""
    return _differences("", found, given)


def _differences(place: str, found: Any, given: Any) -> list[str]:
    if isinstance(found, dict) and isinstance(given, dict):
        names = [*found, *(name for name in given if name not in found)]
        pairs = ((f"{place}.{name}" if place else name, found.get(name), given.get(name)) for name in names)
        return [text for pair in pairs for text in _differences(*pair)]
    if found == given:
        return []
    texts = [repr(value) if len(repr(value)) <= _SHOWN_CHARACTERS else "" for value in (found, given)]
    place = place or "all of it"
    return [f"{place} is {texts[0]}, not {texts[1]}" if all(texts) else f"{place} differs"]
