"""Documents of strangers: one that conforms to its schema ends in a verdict, whatever else it says.

Every document of a release is changed at one place: a key or an entry is removed, a value is replaced, a list is
turned around or lengthened. A change that breaks the schema is checked by one rule and must be seen as such; any
other reaches the rules that read the document, the card, the tables and the readers, none of which may fail on it.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.validator.contract.changing import Place, changed, sample
from tests.validator.engine.changed_release import ChangedRelease
from tests.validator.engine.rules.release import release_draft

from branchdrive.contract.document import dump_json, schema_mismatches
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.resources import schema_dir
from branchdrive.engine.tally import Tally
from branchdrive.errors import DatasetError, UsageError
from branchdrive.model.reader import open_model
from branchdrive.testing.conforming import conforming, redrawn

NUM_CHANGES = {
    "quality/leakage.json": 50,
    "model/features.json": 50,
    "model/normalisation.json": 50,
    "benchmark/results.json": 8,
    "benchmark/latency.json": 40,
    "benchmark/lock.json": 40,
    "benchmark/protocol.json": 15,
    "benchmark/ranking_lock.json": 20,
    "benchmark/ledger.json": 40,
}
"""Changes of documents that are large or costly to judge; of the others `MOST`."""
MOST = 100

SHARES = [15, pytest.param(1, marks=pytest.mark.thorough)]
"""One of so many changes is made."""


@pytest.fixture(scope="module")
def release() -> ChangedRelease:
    """A valid release with all documents; its documents are not to be changed."""
    return ChangedRelease()


def schema_of(path: str) -> str:
    layer, _, name = path.partition("/")
    return LAYERS[layer].documents[name].schema


def failures(release: ChangedRelease, path: str, document: Any) -> list[str]:
    """Errors of the rules that read a document."""
    return [f"{tally.rule_id}: {error}" for tally in release.tallies(path, document) for error in tally.errors]


def test_every_document_of_a_release_is_changed_here(release: ChangedRelease) -> None:
    declared = {f"{layer}/{name}" for layer, about in LAYERS.items() for name in about.documents}
    assert release.documents.keys() == declared
    for path, document in release.documents.items():
        assert any(path in read for read in release.reads.values()), path
        tallies: list[Tally] = release.tallies(path, document)
        assert {tally.status for tally in tallies} <= {"pass", "skipped", "fail", "inconclusive"}, path


@pytest.mark.parametrize("share", SHARES)
def test_a_document_with_one_change_ends_in_a_verdict(release: ChangedRelease, share: int) -> None:
    errors: list[tuple[str, Place, Any, str]] = []
    conforming: Counter[str] = Counter()
    for path, document in release.documents.items():
        changes = [
            (place, new, other)
            for place, new in sample(path, document, NUM_CHANGES.get(path, MOST))
            if not schema_mismatches(other := changed(document, place, new), schema_of(path))
        ]
        for place, new, other in changes[::share]:
            conforming[path] += 1
            errors += [(path, place, new, error) for error in failures(release, path, other)]
    assert errors == []
    assert all(conforming[path] for path in release.documents), conforming


READ_BY_COMMANDS = {"descriptor", "action-bank", "action-encoding", "policy", "waivers"}
"""Schemas of what commands read beside documents of layers, which `tests.changed_input` changes."""

NOT_READ = {
    "branch-group",
    "clauses",
    "columns",
    "layers",
    "limits",
    "mask",
    "metrics",
    "pilot",
    "report",
    "rollout",
    "rules",
}
"""Schemas of resources of this package, of typed views, and of what the validator writes."""


def test_no_schema_of_a_document_is_left_out(release: ChangedRelease) -> None:
    changed_here = {schema_of(path).removesuffix(".schema.json") for path in release.documents}
    known = {file.name.removesuffix(".schema.json") for file in schema_dir().glob("*.schema.json")}
    assert known == changed_here | READ_BY_COMMANDS | NOT_READ


SMALL = ("canonical/source.json", "quality/thresholds.json", "quality/retention.json", "quality/population.json",
         "quality/variants.json", "quality/ledger.json", "benchmark/ledger.json")  # fmt: skip
"""Documents of a size that Hypothesis can draw as a whole; of the others it draws some values again."""


def any_document(path: str, document: Any) -> st.SearchStrategy[Any]:
    """Documents that conform to a schema; conditions between values leave few of some, which are filtered."""
    schema = schema_of(path)
    drawn = conforming(schema) if path in SMALL else redrawn(document, schema)
    return drawn.filter(lambda other: not schema_mismatches(other, schema))


@pytest.mark.parametrize("path", [f"{layer}/{name}" for layer, about in LAYERS.items() for name in about.documents])
@settings(max_examples=settings.default.max_examples // 10, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_document_that_conforms_ends_in_a_verdict(release: ChangedRelease, path: str, data: Any) -> None:
    document = data.draw(any_document(path, release.documents[path]))
    assert failures(release, path, document) == []


@pytest.mark.parametrize("share", SHARES)
def test_readers_refuse_a_changed_document_in_words(tmp_path: Path, share: int) -> None:
    draft = release_draft()
    root, refused = draft.write(tmp_path / "dataset"), 0
    for path in ("model/features.json", "model/normalisation.json", "quality/variants.json"):
        original = (root / path).read_bytes()
        for place, new in sample(path, draft.documents[path], 60)[::share]:
            document = changed(draft.documents[path], place, new)
            (root / path).write_bytes(dump_json(document))
            try:
                layer = open_model(root)
                layer.scalings()
                if path.startswith("quality"):
                    layer.groups(variant="extended")
            except (DatasetError, UsageError) as error:
                refused += 1
                assert str(error).isprintable(), (path, place, new)
            else:  # what the reader does not judge
                assert not schema_mismatches(document, schema_of(path)), (path, place, new)
        (root / path).write_bytes(original)
    assert refused > 60 // share


# --- tables of derived layers

ODD: dict[str, tuple[Any, ...]] = {
    "string": (None, "", "nobody", "\x00\u202e\n", "ж" * 500),
    "int": (None, -(2**31), 2**31 - 1, -1, 0),
    "bool": (None, False, True),
    "float": (None, math.inf, -math.inf, math.nan, 3e38, -0.0, 1.5),
    "list": (None, [], [math.nan] * 3, [1e308] * 400),
}
"""Values of each type, for a whole column or for one cell."""


def odd_values(kind: pa.DataType) -> tuple[Any, ...]:
    text = str(kind.value_type if pa.types.is_dictionary(kind) else kind)
    return next(
        values for name, values in ODD.items() if text.startswith(name) or (text == "double" and name == "float")
    )


def odd_tables(table: pa.Table) -> Iterator[tuple[str, pa.Table]]:
    """Tables with the columns of another one and rows that no builder writes, and what is odd about them."""
    yield "no rows", table.slice(0, 0)
    yield "one row", table.slice(0, 1)
    yield "without its first half", table.slice(len(table) // 2)
    yield "every row twice", pa.concat_tables([table, table])
    yield "backwards", table.take(pa.array(range(len(table) - 1, -1, -1)))
    for index, field in enumerate(table.schema):
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        plain = table[field.name].cast(kind)
        for value in odd_values(field.type):
            whole, cell = pa.array([value], kind).take(pa.array([0] * len(table))), pa.array([value], kind)
            for what, column in (("column", whole), ("cell", pa.concat_arrays([cell, *plain.slice(1).chunks]))):
                changed_field = pa.field(field.name, kind, metadata=field.metadata)
                yield f"{what} {field.name} of {value!r:.40}", table.set_column(index, changed_field, column)
        if len(table) > 1:
            turned = plain.take(pa.array([*range(1, len(table)), 0]))
            yield f"column {field.name} turned", table.set_column(index, field.with_type(kind), turned)


NUM_TABLES = 6
"""Odd tables of each table: those of rows are always among the candidates."""


@pytest.mark.parametrize("share", SHARES)
def test_an_odd_table_ends_in_a_verdict(release: ChangedRelease, share: int) -> None:
    errors = []
    for name, table in release.view.tables.items():
        found = list(odd_tables(table))
        for what, odd in random.Random(f"odd tables of {name}").sample(found, NUM_TABLES)[::share]:
            tallies = release.table_tallies(name, odd)
            assert len(tallies) >= 5, name
            errors += [(name, what, tally.rule_id, error) for tally in tallies for error in tally.errors]
    assert errors == []
