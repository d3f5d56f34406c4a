"""Layer rules: files, documents, keys, values, nulls and order of the derived layers.

Source: spec/10-layers.md#tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from branchdrive.audit.check import ReleaseCheck, RowCheck, release_rule
from branchdrive.audit.finding import Sighting
from branchdrive.audit.release.compare import place
from branchdrive.audit.release.view import NotAtHandError, ReleaseView
from branchdrive.audit.rules.nulls import masks_agree_with_values, required_columns_hold_no_null
from branchdrive.audit.rules.values import (
    text_matches_pattern,
    values_are_finite,
    values_lie_in_range,
    words_belong_to_vocabulary,
)
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import LAYERS, table_path
from branchdrive.derive.layer.frame import Frame, repeated_rows, sort_rows


@release_rule("BD-LYR-001")
def layers_have_their_files(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Every file of a claimed layer is there."""
    wanted = [path for layer in view.descriptor.derived_layers for path in LAYERS[layer].required_files]
    sightings = [
        Sighting("a file of a claimed layer", "no such file", {"file": p}) for p in wanted if p not in view.files
    ]
    yield ReleaseCheck.of(len(wanted), sightings)


def _noted(view: ReleaseView, rule_id: str, examined: int) -> Iterator[ReleaseCheck]:
    yield ReleaseCheck.of(examined, view.problems.get(rule_id, ()))


def _num_there(view: ReleaseView, suffix: str) -> int:
    paths = (path for layer in view.descriptor.derived_layers for path in LAYERS[layer].files)
    return sum(path in view.files and path.endswith(suffix) for path in paths)


@release_rule("BD-LYR-002")
def layer_tables_decode(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Every page of every table of a claimed layer decodes within the limits."""
    yield from _noted(view, "BD-LYR-002", _num_there(view, ".parquet"))


@release_rule("BD-LYR-003")
def layer_tables_have_declared_columns(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Names and types of the columns are those of layers.json: a column of another track has no place here."""
    yield from _noted(view, "BD-LYR-003", _num_there(view, ".parquet"))


@release_rule("BD-LYR-004")
def layer_columns_carry_metadata(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Unit, frame, shape and track of every column are recorded as declared."""
    yield from _noted(view, "BD-LYR-004", len(view.table_names))


@release_rule("BD-LYR-005")
def layer_documents_conform(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Every document parses within the limits and meets its schema."""
    yield from _noted(view, "BD-LYR-005", _num_there(view, ".json"))


@release_rule("BD-LYR-006")
def layer_keys_are_unique(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """No two rows of a table have one key; that no part of a key is null is the matter of another rule."""
    for name in view.table_names:
        frame = view.rows(name)
        bad = repeated_rows(frame, LAYER_TABLES[name].key)
        if len(bad):
            view.distrusted.add(name)
        told = (("a key of its own", "the key of another row", _place(view, name, frame, row)) for row in bad.tolist())
        yield ReleaseCheck(len(view.tables[name]), len(bad), (Sighting(*words) for words in told))


def _place(view: ReleaseView, name: str, frame: Frame, row: int) -> dict[str, str | int]:
    """Location of a row: by its key, or by its number where a part of the key is null."""
    if all(view.tables[name][part][row].is_valid for part in LAYER_TABLES[name].key):
        return place(name, frame, row)
    return {"file": table_path(name), "table": name, "row": row}


RowRule = Callable[[ReleaseView], Iterable[RowCheck]]


def _rows(view: ReleaseView, rules: Iterable[RowRule]) -> Iterator[ReleaseCheck]:
    for rule in rules:
        for check in rule(view):
            if len(check.bad):
                view.distrusted.add(check.table)
            yield ReleaseCheck(check.examined, len(check.bad), _described(view, check))


def _described(view: ReleaseView, check: RowCheck) -> Iterator[Sighting]:
    if not len(check.bad):
        return
    frame = view.rows(check.table)
    for row in check.bad.tolist():
        expected, found = check.describe(row)
        where = _place(view, check.table, frame, row)
        yield Sighting(expected, found, {**where, "column": str(check.column)})


@release_rule("BD-LYR-007")
def layer_values_are_as_declared(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Numbers are finite and in range, words in the vocabulary, text in its pattern."""
    rules = (values_are_finite, values_lie_in_range, words_belong_to_vocabulary, text_matches_pattern)
    yield from _rows(view, rules)  # type: ignore[arg-type]


@release_rule("BD-LYR-008")
def layer_nulls_follow_masks(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """A masked column is null exactly where its mask is off, and no other column holds a null."""
    yield from _rows(view, (required_columns_hold_no_null, masks_agree_with_values))  # type: ignore[arg-type]


@release_rule("BD-LYR-009")
def layer_rows_are_sorted(view: ReleaseView) -> Iterator[ReleaseCheck]:
    """Rows ascend by key, action keys in the order of the bank."""
    orders = {"action_key": view.descriptor.action_bank.keys}
    for name in view.table_names:
        try:
            frame = view.frame(name)
        except NotAtHandError:
            continue
        key = LAYER_TABLES[name].key
        ordered = sort_rows(
            {**{part: frame[part] for part in key}, "row": np.arange(len(view.tables[name]))}, key, orders
        )
        bad = np.flatnonzero(ordered["row"] != np.arange(len(ordered["row"])))
        first = bad[:1].tolist()
        yield ReleaseCheck(
            len(view.tables[name]),
            len(first),
            [
                Sighting("rows in the order of their key", f"{len(bad)} rows elsewhere", place(name, frame, row))
                for row in first
            ],
        )
