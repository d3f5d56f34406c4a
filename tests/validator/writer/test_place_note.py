"""What a rollouts file notes of the places of its groups, and what is made of it in a shard with another number."""

from __future__ import annotations

import json

import pyarrow as pa
import pytest

from branchdrive.errors import DatasetError
from branchdrive.writer.place_note import PlaceNote


def table(note: object = None) -> pa.Table:
    rollouts = pa.table({"group_id": ["a", "a", "b"]})
    return rollouts if note is None else rollouts.replace_schema_metadata({"branchdrive.places": json.dumps(note)})


def test_a_note_comes_back_and_says_places_in_the_shard() -> None:
    note = PlaceNote(4, {"a": 9, "b": 11})
    found = PlaceNote.of(note.add_to(table()), "here")
    assert found == note
    assert note.in_shard(2) == {"a": 9, "b": 11}
    assert note.in_shard(5) == {"a": 21, "b": 23}


def test_other_programs_leave_no_note() -> None:
    assert PlaceNote.of(table(), "here") is None


@pytest.mark.parametrize(
    "note",
    [
        [],
        {"groups_per_shard": 2},
        {"groups_per_shard": 0, "places": {"a": 0, "b": 1}},
        {"groups_per_shard": True, "places": {"a": 0, "b": 1}},
        {"groups_per_shard": 2, "places": {"a": 0}},
        {"groups_per_shard": 2, "places": {"a": 0, "b": 2}},
        {"groups_per_shard": 2, "places": {"a": -1, "b": 0}},
        {"groups_per_shard": 2, "places": {"a": 0, "b": "1"}},
        {"groups_per_shard": 2, "places": [0, 1]},
    ],
    ids=str,
)
def test_a_damaged_note_is_refused(note: object) -> None:
    with pytest.raises(DatasetError, match="here: the writer's note of places is damaged; restore the file"):
        PlaceNote.of(table(note), "here")
