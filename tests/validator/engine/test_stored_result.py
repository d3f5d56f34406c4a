"""Results as bytes: everything that a result holds comes back as it was, and nothing else is ever made of bytes."""

from __future__ import annotations

import math
import pickle
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.contract.mismatch import Mismatch, Mismatches
from branchdrive.driving.response import Responses, Sights
from branchdrive.driving.track_end import TrackEnds
from branchdrive.engine.derived_rules import LayersResult
from branchdrive.engine.finding import Finding
from branchdrive.engine.shard import ShardResult
from branchdrive.engine.stored_result import from_bytes, to_bytes
from branchdrive.engine.tally import Tallies, Tally
from branchdrive.files.group_marks import Outlines, Tracks
from branchdrive.files.identities import Identities
from branchdrive.raw.funnel import Funnel, GroupOutcome

TEXT = np.array(["a", "\u00e9\n", ""], object)
MASKED = np.ma.MaskedArray([1.5, math.nan, 3.0], mask=[False, True, False])
TALLIES = Tallies.of(
    {
        "BD-VAL-003": Tally("BD-VAL-003", 3, 4, is_claimed=False),
        "BD-VAL-001": Tally("BD-VAL-001", 3, 4, 1, [Finding("BD-VAL-001", {}, 1, "", "")]),
    }
)
VALUES: dict[str, Any] = {
    "numbers": [0, -1, 2**70, 0.1, -0.0, math.inf, True, None],
    "text": ["", "\u202e\ud800", "a" * 300],
    "bytes": b"\x00\xff",
    "nested": {("town", "lane"): (1, (2, [3])), 7: {"a": {}}},
    "sets": (frozenset({3, 1}), {"b", "a"}, frozenset()),
    "counter": Counter({"b": 2, "a": 1}),
    "scalars": [np.float32(0.1), np.int64(3), np.bool_(True), np.str_("x"), np.uint64(2**63)],
    "arrays": [np.zeros((0, 2)), np.arange(6, dtype=np.int16).reshape(2, 3), np.array(3.5), np.array([True])],
    "views": [np.arange(12).reshape(3, 4)[:, ::2], np.asfortranarray(np.eye(2))],
    "text in cells": TEXT.reshape(3, 1),
    "lists in cells": np.array([np.arange(3), np.zeros(0), None, "x"], object),
    "masked": MASKED,
    "masked text": np.ma.MaskedArray(TEXT, mask=[True, False, False], fill_value="?"),
    "fixed text": np.array(["ab", "c"]),
    "finding": Finding("BD-VAL-001", {"file": "a", "tick": 3}, 2, "x", "y", group_id="g"),
    "tally": Tally("BD-VAL-001", 3, 4, 1, [Finding("BD-VAL-001", {}, 1, "", "")], unjudged="no"),
    "mismatches": Mismatches(3, [Mismatch({"row": 3}, "a", "b")]),
    "funnel": Funnel(2, Counter({"bank": 1}), {"bank": Counter({"BD-BNK-001": 1})}, [GroupOutcome("g", rules=("r",))]),
    "identities": Identities(["g-1", "", "\ud800\n"]),
    "tallies": TALLIES,
    "tracks": Tracks(Identities(["g"]), np.zeros(2, np.int32), np.array([1, 2**64 - 1], np.uint64)),
    "outlines": Outlines(Identities(["g"]), np.zeros(1, np.int32), np.array([[math.nan, 0.5]])),
    "shard": ShardResult(
        "raw/shard-00000",
        rollout_ids=Identities(["a"]),
        groups=np.arange(64, dtype=np.uint8).reshape(2, 32),
        sights={"front": Sights(np.zeros(1), np.ones(1, bool), np.ones(1))},
        tallies=TALLIES,
    ),
    "responses": Responses.none(),
    "track ends": TrackEnds.none(),
    "layers": LayersResult({"BD-CAN-001": Tally("BD-CAN-001")}, {"stages": [{"total": 3}]}),
}


@pytest.mark.parametrize("name", VALUES)
def test_every_value_comes_back(name: str) -> None:
    content = to_bytes(VALUES[name])
    found = from_bytes(content)
    assert type(found) is type(VALUES[name])
    assert to_bytes(found) == content
    if name == "sets":  # which are printed in any order
        assert ([*map(type, found)], found) == ([*map(type, VALUES[name])], VALUES[name])
    else:
        assert repr(found) == repr(VALUES[name])


def test_arrays_keep_types_and_may_be_written_to() -> None:
    found = from_bytes(to_bytes({"a": np.arange(3, dtype=np.int16), "b": np.float32(0.1), "m": MASKED}))
    assert (found["a"].dtype, type(found["b"]), found["m"].fill_value) == (np.int16, np.float32, MASKED.fill_value)
    found["a"][0] = 7
    assert found["m"].mask.tolist() == [False, True, False]


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(max_size=5)
    | st.binary(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.lists(inner, max_size=3).map(tuple)
        | st.dictionaries(st.text(max_size=3) | st.tuples(st.text(max_size=2), st.integers()), inner, max_size=3)
    ),
    max_leaves=12,
)


@given(values)
def test_plain_values_come_back_equal(value: Any) -> None:
    assert from_bytes(to_bytes(value)) == value


@given(st.binary(max_size=64) | st.binary(max_size=40).map(lambda tail: len(tail).to_bytes(8, "little") + tail))
def test_other_bytes_are_refused_or_of_a_value(content: bytes) -> None:
    try:
        found = from_bytes(content)
    except ValueError as error:
        assert str(error).startswith("no bytes of a result: ")
    else:
        assert to_bytes(found)


@pytest.mark.parametrize(
    "document",
    ['{"array":["O",[1]]}', '{"array":["<f8",[9]]}', '{"array":["<f8",[-1]]}', '{"_class__":[]}', '{"value":1}',
     '{"Tally":{"nothing":1}}', '{"Identities":{"texts":[1]}}',
     '{"Tallies":{"rules":["BD-NO-001"],"numbers":{"array":["<i8",[1,4]]}}}',
     '{"Tallies":{"rules":["BD-VAL-001"],"numbers":{"array":["|u1",[1,4]]}}}',
     '{"Tallies":{"rules":["BD-VAL-001"],"numbers":{"array":["|u1",[8]]}}}',
     '{"Tallies":{"rules":["BD-VAL-001","BD-VAL-001"],"numbers":{"array":["<i8",[2,4]]}}}',
     '{"Tallies":{"rules":[],"numbers":{"array":["<i8",[0,4]]},"others":[{"Tally":{"rule_id":"BD-VAL-001"}}]}}',
     '{"Tallies":{"rules":[],"numbers":{"array":["<i8",[0,4]]},"others":[1]}}',
     '{"a":1,"b":2}', '{"system":["ls"]}', '{"array":["V8",[1]]}', "[" * 100_000],
)  # fmt: skip
def test_documents_of_another_form_are_refused(document: str) -> None:
    content = len(document).to_bytes(8, "little") + document.encode() + bytes(8)
    with pytest.raises(ValueError, match="no bytes of a result"):
        from_bytes(content)


@pytest.mark.parametrize("value", [object(), np.array([object()], object), np.zeros(1, complex), Exception(), print])
def test_what_has_no_form_is_refused(value: Any) -> None:
    with pytest.raises(TypeError, match="results hold no"):
        to_bytes(value)


def test_pickles_are_refused() -> None:
    with pytest.raises(ValueError, match="no bytes of a result"):
        from_bytes(pickle.dumps([1]))
