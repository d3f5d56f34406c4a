"""Tables as values."""

from __future__ import annotations

import pytest
from tests.validator.text.samples import TABLE

from branchdrive.text.table import Column, Table


def test_every_row_has_a_cell_for_every_column() -> None:
    with pytest.raises(ValueError, match=r"table 'T' has 2 columns, but a row \['a'\]"):
        Table("T", [Column("A"), Column("B")], [["a", "b"], ["a"]])


def test_columns_are_taken_by_their_places() -> None:
    short = TABLE.only([0, 1, 2, 4])
    assert [column.title for column in short.columns] == ["Road", "By", "Mean, m", "Judged"]
    assert [row[2:] for row in short.rows] == [["1.250", "pass"], ["-0.500", "fail, a|b <b>"], ["3", "not judged"]]
    assert (short.title, short.notes, short.has_total) == (TABLE.title, TABLE.notes, True)
