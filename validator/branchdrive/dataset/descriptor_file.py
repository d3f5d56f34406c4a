"""The file `branchdrive.json`: a dataset's descriptor as bytes."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.limits import spec_limits
from branchdrive.dataset.layout import DESCRIPTOR_FILE
from branchdrive.dataset.untrusted import read_file
from branchdrive.errors import DatasetError

__all__ = ["read_descriptor", "render_descriptor"]


def render_descriptor(descriptor: Descriptor) -> bytes:
    """Canonical bytes of a descriptor."""
    return dump_json(descriptor.model_dump(mode="json"))


def read_descriptor(root: Path) -> Descriptor:
    """The descriptor of the dataset at `root`.

    Raises:
        DatasetError: There is none, or it does not conform to its schema.
    """
    content = read_file(root, DESCRIPTOR_FILE, spec_limits().max_document_bytes)
    try:
        return Descriptor.model_validate(parse_json(content))
    except ValidationError as error:
        first = error.errors()[0]
        place = "/".join(map(str, first["loc"])) or "the document"
        problem = f"{place}: {first['msg']} ({error.error_count()} problems)"
    except ValueError as error:
        problem = str(error)
    raise DatasetError(f"{root}: {DESCRIPTOR_FILE!r} is no descriptor: {problem}; run `branchdrive-validate`")
