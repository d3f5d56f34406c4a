"""What a checkpoint says about itself, read from its header alone: no tensor is read and no code is run.

A checkpoint is a safetensors file: eight bytes with the length of a header, little-endian, then the header as JSON.
Its metadata hold JSON text under ``branchdrive`` with ``{"document": {"provenance": {..}}}``. Every other entry is a
tensor with its type, shape and place; the tensors fill what follows the header, without a gap and without a rest.

Source: safetensors format; spec/14-benchmark.md#checkpoints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from branchdrive.contract.document import parse_json
from branchdrive.contract.limits import spec_limits

__all__ = ["LENGTH_BYTES", "CheckpointFacts", "checkpoint_facts", "header_bytes", "num_parameters"]

LENGTH_BYTES = 8
"""Bytes before the header."""

_METADATA, _KEY = "__metadata__", "branchdrive"
_ITEM_BYTES = {
    "BOOL": 1, "U8": 1, "I8": 1, "U16": 2, "I16": 2, "F16": 2, "BF16": 2, "U32": 4, "I32": 4, "F32": 4, "U64": 8,
    "I64": 8, "F64": 8, "C64": 8, "F8_E4M3": 1, "F8_E5M2": 1,
}  # fmt: skip
"""Types of tensors and the size of their items."""
_MAX_RANK = 64
"""Axes of a tensor; the product of thousands of large numbers would take minutes."""


class CheckpointFacts(NamedTuple):
    """Provenance of a checkpoint.

    Attributes:
        model: Name of the model.
        seed: Seed of its training.
        split_digest: Digest of the split that it was trained under.
        normalisation_digest: SHA-256 of the normalisation file.
        config_digest: Of the configuration of the model and its training.
        training_groups_digest: Of the groups that it was trained on, see `data.groups_digest`.
    """

    model: str
    seed: int
    split_digest: str
    normalisation_digest: str
    config_digest: str
    training_groups_digest: str


def header_bytes(head: bytes) -> int:
    """Bytes of the file up to the end of its header, from its first eight bytes.

    Raises:
        ValueError: There are fewer, or the header is larger than a document may be.
    """
    if len(head) < LENGTH_BYTES:
        raise ValueError("the file is too short to have a header")
    size, limit = int.from_bytes(head[:LENGTH_BYTES], "little"), spec_limits().max_document_bytes
    if size > limit:
        raise ValueError(f"the header has {size} bytes; the limit is {limit}")
    return LENGTH_BYTES + size


def checkpoint_facts(head: bytes, num_bytes: int) -> CheckpointFacts:
    """Provenance of a checkpoint from its first bytes, the whole header among them.

    Args:
        head: Of the file.
        num_bytes: Of the whole file.

    Raises:
        ValueError: They are no such header, the metadata lack a fact, or the tensors do not fill the file.
    """
    return _facts(_header(head, num_bytes))


def num_parameters(head: bytes, num_bytes: int) -> int:
    """Numbers in the tensors of a checkpoint, from its first bytes; see `checkpoint_facts`."""
    entries = _header(head, num_bytes)
    return sum(math.prod(entry["shape"]) for name, entry in entries.items() if name != _METADATA)


def _header(head: bytes, num_bytes: int) -> Mapping[str, Any]:
    """The header, which has provenance and whose tensors fill the file."""
    size = header_bytes(head)
    if len(head) < size:
        raise ValueError("the header ends before its end")
    header: Any = parse_json(head[LENGTH_BYTES:size])
    _facts(header)
    _check_tensors({name: entry for name, entry in header.items() if name != _METADATA}, num_bytes - size)
    return header  # type: ignore[no-any-return]


def _facts(header: Any) -> CheckpointFacts:
    provenance = header
    for name, is_text in ((_METADATA, False), (_KEY, True), ("document", False), ("provenance", False)):
        if not isinstance(provenance, dict) or name not in provenance:
            raise ValueError(f"the metadata have no `{name}`")
        provenance = provenance[name]
        if is_text:
            if not isinstance(provenance, str):
                raise ValueError(f"`{name}` is no text")
            provenance = parse_json(provenance.encode())
    if not isinstance(provenance, dict):
        raise ValueError("`provenance` is no object")
    for name in CheckpointFacts._fields:
        wanted = int if name == "seed" else str
        if type(provenance.get(name)) is not wanted:
            raise ValueError(f"the provenance has no `{name}`")
    return CheckpointFacts(*(provenance[name] for name in CheckpointFacts._fields))


def _check_tensors(entries: Mapping[str, Any], num_bytes: int) -> None:
    """Whether the tensors fill `num_bytes` one after the other."""
    places = []
    for name, entry in entries.items():
        try:
            kind, shape, (begin, end) = entry["dtype"], entry["shape"], entry["data_offsets"]
            numbers = (*shape, begin, end)
        except (LookupError, TypeError, ValueError):
            raise ValueError(f"the tensor {name!r} has no type, shape and place") from None
        if not isinstance(kind, str) or kind not in _ITEM_BYTES:
            raise ValueError(f"the tensor {name!r} has the type {str(kind)[:20]!r}; known are {', '.join(_ITEM_BYTES)}")
        if len(shape) > _MAX_RANK:
            raise ValueError(f"the tensor {name!r} has {len(shape)} axes; the limit is {_MAX_RANK}")
        if not all(type(number) is int and number >= 0 for number in numbers):
            raise ValueError(f"the shape or place of the tensor {name!r} is not a list of numbers")
        if end - begin != math.prod(shape) * _ITEM_BYTES[kind]:
            raise ValueError(f"the tensor {name!r} does not have the bytes of its shape")
        places.append((begin, end))
    filled = 0
    for begin, end in sorted(places):
        if begin != filled:
            raise ValueError("the tensors overlap or leave a gap")
        filled = end
    if filled != num_bytes:
        raise ValueError(f"the tensors have {filled} bytes, and {num_bytes} follow the header")
