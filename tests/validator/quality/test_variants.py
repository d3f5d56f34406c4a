"""Variants: declared by flags, counted and digested apart from the frozen population."""

from __future__ import annotations

import hashlib
from typing import Any

import pytest
from tests.each import each
from tests.validator.quality.release import concat, numbered, paper_groups, reaching, shuffled

from branchdrive.contract.document import dump_json, parse_json
from branchdrive.errors import UsageError
from branchdrive.quality.variants import FLAGS, RESERVED, declared_of, declared_variants, variants_document

LOST = {"name": "lost", "title": "What the bank cost", "where": {"exact_bank": False}}


def digest(*group_ids: str) -> str:
    return hashlib.sha256("".join(f"{group_id}\n" for group_id in group_ids).encode()).hexdigest()


def test_the_frozen_population_and_the_extended_variant_come_with_every_release() -> None:
    groups = numbered(concat([reaching("b", 6, 2, "train"), reaching("a", 5, 1, "test"), reaching("c", 2, 1)]))
    groups["near_duplicate"][groups["group_id"] == "b-0001"] = True
    assert variants_document(groups) == {
        "frozen": {
            "where": {"core_valid": True, "near_duplicate": False},
            "num_groups": 2,
            "digest": digest("a-0000", "b-0000"),
        },
        "variants": [
            {
                "name": "extended",
                "title": "Replay-valid by the extended variables too",
                "where": {"core_valid": True, "extended_valid": True, "near_duplicate": False},
                "num_groups": 1,
                "digest": digest("b-0000"),
            }
        ],
    }


def test_a_declared_variant_leaves_the_frozen_population_as_it_is() -> None:
    groups = paper_groups()
    document = variants_document(groups, declared_variants([LOST]))
    assert document["frozen"] == variants_document(groups)["frozen"]
    assert document["frozen"]["num_groups"] == 606
    assert [(v["name"], v["num_groups"]) for v in document["variants"]] == [("extended", 600), ("lost", 716)]


def test_the_order_of_the_rows_decides_nothing() -> None:
    groups = paper_groups()
    assert variants_document(shuffled(groups, 5)) == variants_document(groups)


def test_a_stored_document_recomputes() -> None:
    groups = paper_groups()
    stored = parse_json(dump_json(variants_document(groups, declared_variants([LOST]))))
    assert variants_document(groups, declared_of(stored)) == stored


def test_a_variant_that_nothing_belongs_to_is_empty() -> None:
    document = variants_document(reaching("a", 0, 0), declared_variants([LOST]))
    assert [v["num_groups"] for v in document["variants"]] == [0, 0]
    assert document["frozen"]["digest"] == hashlib.sha256(b"").hexdigest()


def test_flags_are_the_boolean_columns() -> None:
    assert {"exact_bank", "eligible", "core_valid", "extended_valid", "near_duplicate"} <= set(FLAGS)
    assert not {"town", "partition", "num_nominal_replays"} & set(FLAGS)


INVALID: dict[str, tuple[Any, str]] = {
    "no list": ({}, "a list of at most 100 objects"),
    "too many": ([LOST] * 101, "a list of at most 100 objects"),
    "no object": ([3], "variant 0: expected an object"),
    "a key too many": ([{**LOST, "towns": []}], "variant 0: expected an object"),
    "a key too few": ([{"name": "a"}], "variant 0: expected an object"),
    "no identifier": ([{**LOST, "name": "Not good\n"}], "`name` must match"),
    "a final newline": ([{**LOST, "name": "lost\n"}], "`name` must match"),
    "no title": ([{**LOST, "title": ""}], "`title` must be one printable line"),
    "two lines": ([{**LOST, "title": "a\nb"}], "`title` must be one printable line"),
    "no condition": ([{**LOST, "where": {}}], "at least one column"),
    "no truth value": ([{**LOST, "where": {"eligible": 1}}], "true or false"),
    "no flag": ([{**LOST, "where": {"town": True}}], "are not flags of `group_quality`"),
    "the same name": ([LOST, LOST], "variant 1: the name 'lost' is taken"),
    **{name: ([{**LOST, "name": name}], "is taken") for name in RESERVED},
}


@each("case", INVALID)
def test_what_cannot_be_declared_is_refused(case: str) -> None:
    declared, message = INVALID[case]
    with pytest.raises(UsageError, match=message):
        declared_variants(declared)
