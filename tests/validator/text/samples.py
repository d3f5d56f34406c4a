"""A table with everything that a table may have."""

from __future__ import annotations

from branchdrive.text.table import Column, Table

TABLE = Table(
    "Distances",
    [
        Column.name("Road", is_code=True),
        Column.name("By"),
        Column("Mean, m"),
        Column("Spread, m"),
        Column("Judged", is_text=True),
    ],
    [
        ["town.a", "lane", "1.250", "0.1", "pass"],
        ["town.a", "route", "-0.500", "<= 0.2", "fail, a|b <b>"],
        ["all", "route", "3", "-", "not judged"],
    ],
    ["A note on <i>."],
    has_total=True,
)
