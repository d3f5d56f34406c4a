"""What a checkpoint says about itself, read from its header alone: no tensor is read and no code is run.

A checkpoint is a safetensors file: eight bytes with the length of a header, little-endian, then the header as JSON.
Its metadata hold JSON text under ``branchdrive`` with ``{"document": {"provenance": {..}}}``.

Source: safetensors format; spec/14-benchmark.md#checkpoints.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from branchdrive.contract.document import parse_json
from branchdrive.contract.limits import spec_limits

__all__ = ["LENGTH_BYTES", "CheckpointFacts", "checkpoint_facts", "header_bytes"]

LENGTH_BYTES = 8
"""Bytes before the header."""

_KEY = "branchdrive"


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


def checkpoint_facts(head: bytes) -> CheckpointFacts:
    """Provenance of a checkpoint from its first bytes, the whole header among them.

    Raises:
        ValueError: They are no such header, or the metadata lack a fact.
    """
    size = header_bytes(head)
    if len(head) < size:
        raise ValueError("the header ends before its end")
    provenance: Any = parse_json(head[LENGTH_BYTES:size])
    for name, is_text in (("__metadata__", False), (_KEY, True), ("document", False), ("provenance", False)):
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
