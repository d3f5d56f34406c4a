"""What a checkpoint says of itself: read from its header, whatever the header holds."""

from __future__ import annotations

import json
from typing import Any

import pytest

from branchdrive.contract.limits import spec_limits
from branchdrive.derive.benchmark.checkpoint import CheckpointFacts, checkpoint_facts, header_bytes

FACTS = CheckpointFacts("M3", 11, "a" * 64, "b" * 64, "c" * 64, "d" * 64)


def framed(header: Any) -> bytes:
    content = header if isinstance(header, bytes) else json.dumps(header).encode()
    return len(content).to_bytes(8, "little") + content


def header(provenance: Any) -> dict[str, Any]:
    return {"__metadata__": {"branchdrive": json.dumps({"document": {"provenance": provenance}})}}


def test_facts_are_read_from_the_header_alone() -> None:
    content = framed(header({**FACTS._asdict(), "data_digest": "more"}))
    assert header_bytes(content[:8]) == len(content)
    assert checkpoint_facts(content + b"tensors") == FACTS


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "too short"),
        (b"\xff" * 8, "the limit is"),
        ((spec_limits().max_document_bytes + 1).to_bytes(8, "little"), "the limit is"),
        (framed(header(FACTS._asdict()))[:-1], "ends before its end"),
        (framed(b"no json"), "Expecting value"),
        (framed([1]), "no `__metadata__`"),
        (framed({"__metadata__": {}}), "no `branchdrive`"),
        (framed({"__metadata__": {"branchdrive": 3}}), "`branchdrive` is no text"),
        (framed({"__metadata__": {"branchdrive": "[]"}}), "no `document`"),
        (framed(header(None)), "`provenance` is no object"),
        (framed(header({})), "no `model`"),
        (framed(header({**FACTS._asdict(), "seed": True})), "no `seed`"),
        (framed(header({**FACTS._asdict(), "training_groups_digest": None})), "no `training_groups_digest`"),
    ],
)
def test_what_is_no_checkpoint_is_refused(content: bytes, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        checkpoint_facts(content)
