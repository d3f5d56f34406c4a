"""Tables on a terminal: any width, no column lost, no number cut, nothing of others that a terminal would obey."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from tests.validator.text.samples import TABLE

from branchdrive.text.table import Column, Passage, Table
from branchdrive.text.terminal import PLAIN_WIDTH, print_facts, print_section, render


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def page(section: Table | Passage, width: int) -> str:
    buffer = io.StringIO()
    print_section(Console(file=buffer, width=width, highlight=False, emoji=False), section, ["Look out."])
    return "\n".join(line.rstrip() for line in buffer.getvalue().split("\n"))


WIDE = """\
Distances
Warning: Look out.
Road    By     Mean, m  Spread, m  Judged
------------------------------------------------
town.a  lane     1.250        0.1  pass
        route   -0.500     <= 0.2  fail, a|b <b>
------------------------------------------------
all     route        3          -  not judged
A note on <i>.
"""

NARROW = """\
Distances
Warning: Look out.
                        Spread,
Road    By     Mean, m        m
-------------------------------
town.a  lane     1.250      0.1
        route   -0.500   <= 0.2
-------------------------------
all     route        3        -

Road    By     Judged
----------------------------
town.a  lane   pass
        route  fail, a|b <b>
----------------------------
all     route  not judged
A note on <i>.
"""


@pytest.mark.parametrize(("width", "text"), [(80, WIDE), (48, WIDE), (31, NARROW)])
def test_a_table_that_is_too_wide_is_parted(width: int, text: str) -> None:
    assert page(TABLE, width) == text


def test_columns_without_a_cell_go_first_where_there_is_too_little_room() -> None:
    columns = [Column.name("Name"), Column("Nothing at all"), Column("Number")]
    table = Table("T", columns, [["a", "", "1"], ["b", "", "2"]])
    assert page(table, 40).split("\n")[2].split() == ["Name", "Nothing", "at", "all", "Number"]
    narrow = ["T", "Warning: Look", "out.", "Name  Number", "------------", "a          1", "b          2", ""]
    assert page(table, 16).split("\n") == narrow
    assert "Nothing" in page(replace(table, rows=[]), 16)


def test_where_names_leave_no_room_there_is_a_line_for_every_cell() -> None:
    lines = page(TABLE, 20).split("\n")
    assert lines[2:7] == [
        "Road       town.a",
        "By         lane",
        "Mean, m    1.250",
        "Spread, m  0.1",
        "Judged     pass",
    ]
    assert max(map(len, lines)) <= 20


@given(
    st.lists(st.tuples(st.text("ab_ ,", max_size=12), st.booleans(), st.booleans()), min_size=1, max_size=8),
    st.integers(0, 3),
    st.integers(24, 90),
)
def test_every_number_stands_on_every_page(columns: list[tuple[str, bool, bool]], num_rows: int, width: int) -> None:
    rows = [[f"{i}.{j}{'7' * i}" for i in range(len(columns))] for j in range(num_rows)]
    table = Table("T", [Column(title, *flags) for title, *flags in columns], rows)
    found = page(table, width)
    assert max(map(len, found.split("\n"))) <= width
    assert {cell for row in rows for cell in row} <= set(re.findall(r"[\d.]+", found))


def test_the_last_name_of_a_row_is_never_left_out() -> None:
    table = Table("T", [Column.name("Name"), Column("N")], [["a", "1"], ["a", "2"]])
    assert page(table, 80).count("a  ") == 2


def test_characters_of_others_are_escaped_but_not_the_signs_of_tables() -> None:
    rows = [["\x1b[2Jx\n", "1 ± 2", "M6†", "0", "\u202e"]]
    found = page(replace(TABLE, rows=rows, title="a\nb", notes=["\x07"]), 100)
    assert "\x1b" not in found
    assert (
        "\\x1b[2Jx\\n" in found
        and "1 ± 2" in found
        and "M6†" in found
        and "\\u202e" in found
        and "a\\nb" in found
        and "\\x07" in found
    )
    assert "\\x9b" in page(Passage("\x9b", ["b\x9b"]), 100).split("\n")[1]


def test_only_a_terminal_gets_colour_and_its_own_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "48")
    monkeypatch.setenv("TERM", "xterm")
    draw = partial(print_section, section=TABLE, warnings=["Look out."])
    coloured = render(draw, Terminal())
    assert re.search("\x1b\\[3[12]m(pass|fail)", coloured)
    assert [line.rstrip() for line in re.sub(r"\x1b\[[0-9;]*m", "", coloured).split("\n")] == WIDE.split("\n")
    assert render(draw, io.StringIO()) == render(draw, Terminal(), is_file=True) == WIDE
    assert (
        len(render(partial(print_facts, facts=[("name", "word " * 100)]), io.StringIO()).split("\n")[0]) <= PLAIN_WIDTH
    )
