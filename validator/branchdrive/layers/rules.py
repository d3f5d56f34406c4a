"""Layer rules: files, documents, keys, values, nulls and order of the derived layers.

Source: spec/10-layers.md#tables.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.machine_trace import trace_mismatches
from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.layers.compare import document_check
from branchdrive.layers.view import ReleaseView
from branchdrive.raw.rules.nulls import (
    masks_agree_with_values,
    required_columns_hold_no_null,
    unrecorded_columns_are_null,
)
from branchdrive.raw.rules.values import (
    categories_are_declared,
    text_matches_pattern,
    texts_hold_no_trace,
    values_are_finite,
    values_lie_in_range,
)
from branchdrive.tables.frame import repeated_rows, sort_rows


@rule("BD-LYR-001")
def layers_have_their_files(view: ReleaseView) -> Iterator[Check]:
    """Every file of a claimed layer is there."""
    layers = [LAYERS[name] for name in view.descriptor.derived_layers]
    missing = [path for layer in layers for path in layer.missing(view.files)]
    mismatches = [Mismatch({"file": path}, "a file of a claimed layer", "no such file") for path in missing]
    yield Check.of(sum(layer.num_required(view.files) for layer in layers), mismatches)


def _noted(view: ReleaseView, rule_id: str, examined: int) -> Iterator[Check]:
    yield Check.of(examined, view.mismatches.get(rule_id, ()))


def _num_there(view: ReleaseView, suffix: str) -> int:
    paths = (path for layer in view.descriptor.derived_layers for path in LAYERS[layer].own(view.files))
    return sum(path.endswith(suffix) for path in paths)


@rule("BD-LYR-002")
def layer_tables_decode(view: ReleaseView) -> Iterator[Check]:
    """Every page of every table of a claimed layer decodes within the limits."""
    yield from _noted(view, "BD-LYR-002", _num_there(view, ".parquet"))


@rule("BD-LYR-003")
def layer_tables_have_declared_columns(view: ReleaseView) -> Iterator[Check]:
    """Names and types of the columns are those of layers.json: a column of another track has no place here."""
    yield from _noted(view, "BD-LYR-003", _num_there(view, ".parquet"))


@rule("BD-LYR-004")
def layer_columns_carry_metadata(view: ReleaseView) -> Iterator[Check]:
    """Unit, frame, shape and track of every column are recorded as declared."""
    yield from _noted(view, "BD-LYR-004", len(view.num_rows))


@rule("BD-LYR-010")
def layer_files_hold_their_rows(view: ReleaseView) -> Iterator[Check]:
    """Every row of a table in parts is in the file of its own partition and part, and no part is without rows."""
    divided = [path for name in view.table_names if LAYER_TABLES[name].is_of_groups for path in view.paths(name)]
    yield from _noted(view, "BD-LYR-010", len(divided))


@rule("BD-LYR-005")
def layer_documents_conform(view: ReleaseView) -> Iterator[Check]:
    """Every document parses within the limits and meets its schema."""
    yield from _noted(view, "BD-LYR-005", _num_there(view, ".json"))


@rule("BD-LYR-006")
def layer_keys_are_unique(view: ReleaseView) -> Iterator[Check]:
    """No two rows of a table have one key; another rule checks that no part of a key is null."""
    for name in view.table_names:
        frame = view.rows(name)
        bad = repeated_rows(frame, LAYER_TABLES[name].key)
        yield Check.of_rows(
            name, None, len(view.tables[name]), bad, lambda _: ("a unique key", "the key of another row")
        )


@rule("BD-LYR-007")
def layer_values_are_as_declared(view: ReleaseView) -> Iterator[Check]:
    """Numbers are finite and in range, categories declared, text in its pattern."""
    for check in (values_are_finite, values_lie_in_range, categories_are_declared, text_matches_pattern):
        yield from check(view)


@rule("BD-LYR-008")
def layer_nulls_follow_masks(view: ReleaseView) -> Iterator[Check]:
    """A masked column is null exactly where its mask is off, an unrecorded one throughout, no other anywhere."""
    for check in (required_columns_hold_no_null, masks_agree_with_values, unrecorded_columns_are_null):
        yield from check(view)


def _elsewhere(num_rows: int, _row: int) -> tuple[str, str]:
    return "rows in the order of their key", f"{num_rows} rows out of order"


@rule("BD-LYR-009")
def layer_rows_are_sorted(view: ReleaseView) -> Iterator[Check]:
    """Rows ascend by key, action keys in the order of the bank, in every file."""
    for name in view.table_names:
        try:
            frame = view.frame(name)
        except PreconditionError:
            continue
        key, paths, num_rows = LAYER_TABLES[name].key, view.paths(name), len(view.tables[name])
        files = np.repeat(np.arange(len(paths)), [view.num_rows[path] for path in paths])
        rows = {**{part: frame[part] for part in key}, "file": files, "row": np.arange(num_rows)}
        ordered = sort_rows(rows, ("file", *key), {"action_key": view.descriptor.action_bank.keys})
        bad = np.flatnonzero(ordered["row"] != np.arange(len(ordered["row"])))
        yield Check.of_rows(
            name,
            None,
            num_rows,
            bad[:1],
            partial(_elsewhere, len(bad)),
        )


_FIRST_TABLE = {column.name: table.name for table in reversed([*LAYER_TABLES.values()]) for column in table.columns}
"""First table with a column of a name; later ones repeat what it says, as other rules judge."""


@rule("BD-LYR-011")
def layer_texts_name_no_machine(view: ReleaseView) -> Iterator[Check]:
    """No text of a table or a document holds a path, a host or a time of the machine that wrote it."""
    yield from texts_hold_no_trace(view, lambda table, column: _FIRST_TABLE[column] == table)
    for path, document in view.documents.items():
        yield document_check(path, 1, trace_mismatches(document))
