"""What a checkpoint says of itself: read from its header, whatever the header holds."""

from __future__ import annotations

import json
from typing import Any

import pytest
from tests.each import each

from branchdrive.benchmark.checkpoint import CheckpointFacts, checkpoint_facts, header_bytes
from branchdrive.contract.limits import spec_limits

FACTS = CheckpointFacts("M3", 11, "a" * 64, "b" * 64, "c" * 64, "d" * 64)


def framed(header: Any) -> bytes:
    content = header if isinstance(header, bytes) else json.dumps(header).encode()
    return len(content).to_bytes(8, "little") + content


def header(provenance: Any) -> dict[str, Any]:
    return {"__metadata__": {"branchdrive": json.dumps({"document": {"provenance": provenance}})}}


def test_facts_are_read_from_the_header_alone() -> None:
    tensors = {
        "b": {"dtype": "F32", "shape": [2, 3], "data_offsets": [2, 26]},
        "a": {"dtype": "BOOL", "shape": [2], "data_offsets": [0, 2]},
        "none": {"dtype": "F64", "shape": [0, 9], "data_offsets": [26, 26]},
        "scalar": {"dtype": "I16", "shape": [], "data_offsets": [26, 28]},
    }
    content = framed({**header({**FACTS._asdict(), "data_digest": "more"}), **tensors})
    assert header_bytes(content[:8]) == len(content)
    assert checkpoint_facts(content, len(content) + 28) == FACTS


@each(
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
        checkpoint_facts(content, len(content))


@each(
    ("tensor", "num_bytes", "words"),
    [
        ({}, 4, "has no type, shape and place"),
        ("text", 4, "has no type, shape and place"),
        ({"dtype": "F31"}, 4, "has the type 'F31'; known are BOOL"),
        ({"dtype": ["F32"]}, 4, "has the type"),
        ({"shape": [10**17] * 200_000}, 4, "has 200000 axes; the limit is 64"),
        ({"data_offsets": [0, 4, 4]}, 4, "has no type, shape and place"),
        ({"shape": [1.0]}, 4, "is not a list of numbers"),
        ({"shape": [-1, -1]}, 4, "is not a list of numbers"),
        ({"shape": [2**62, 2**62]}, 4, "does not have the bytes of its shape"),
        ({"data_offsets": [4, 8]}, 8, "overlap or leave a gap"),
        ({}, 5, "4 bytes, and 5 follow"),
        ({}, 3, "4 bytes, and 3 follow"),
    ],
)
def test_tensors_fill_the_file(tensor: Any, num_bytes: int, words: str) -> None:
    whole = {"dtype": "F32", "shape": [1], "data_offsets": [0, 4]}
    odd = tensor and ({**whole, **tensor} if isinstance(tensor, dict) else tensor)
    entry = odd or (whole if "follow" in words else {})
    content = framed({**header(FACTS._asdict()), "weights": entry})
    with pytest.raises(ValueError, match=words):
        checkpoint_facts(content, len(content) + num_bytes)


def test_tensors_do_not_overlap() -> None:
    entry = {"dtype": "F32", "shape": [1], "data_offsets": [0, 4]}
    content = framed({**header(FACTS._asdict()), "one": entry, "other": entry})
    with pytest.raises(ValueError, match="overlap"):
        checkpoint_facts(content, len(content) + 8)
