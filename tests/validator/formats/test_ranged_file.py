from __future__ import annotations

import io

from hypothesis import given
from hypothesis import strategies as st

from branchdrive.formats import ranged_file
from branchdrive.formats.ranged_file import RangedFile

MEBIBYTE = 1 << 20


class Fetched:
    """A file whose fetches are noted."""

    def __init__(self, content: bytes, first: bytes = b"") -> None:
        self.content, self.fetches = content, list[tuple[int, int]]()
        self.file = RangedFile(len(content), self._fetch, first)

    def _fetch(self, start: int, stop: int) -> bytes:
        self.fetches.append((start, stop))
        return self.content[start:stop]


STEPS = st.lists(st.tuples(st.none() | st.integers(0, 40), st.integers(-1, 40)), max_size=8)
"""Places to go to, and sizes to read there."""


@given(st.binary(max_size=32), STEPS, st.integers(0, 8))
def test_it_reads_as_a_file_in_memory_does(content: bytes, steps: list[tuple[int | None, int]], known: int) -> None:
    ours, plain = Fetched(content, content[:known]).file, io.BytesIO(content)
    for place, size in steps:
        if place is not None:
            assert ours.seek(place) == plain.seek(place)
        assert ours.read(size) == plain.read(size)
        if plain.tell() <= len(content):
            assert ours.tell() == plain.tell()


def test_a_read_in_the_middle_fetches_its_bytes_alone() -> None:
    one = Fetched(bytes(range(256)) * 64)
    one.file.seek(1000)
    assert one.file.read(24) == one.content[1000:1024]
    assert one.fetches == [(1000, 1024)]


def test_a_whole_file_is_fetched_once() -> None:
    one = Fetched(bytes(3 * MEBIBYTE))
    assert len(one.file.read(one.file.seek(0, io.SEEK_END) - one.file.seek(0) + len(one.content) + 1)) == 3 * MEBIBYTE
    assert one.fetches == [(0, 3 * MEBIBYTE)]


def test_small_pieces_one_after_the_other_take_few_fetches() -> None:
    one = Fetched(bytes(20 * MEBIBYTE))
    while one.file.read(MEBIBYTE // 4):
        pass
    assert [stop - start for start, stop in one.fetches] == [MEBIBYTE, 8 * MEBIBYTE, 8 * MEBIBYTE, 3 * MEBIBYTE]


def test_no_fetch_is_larger_than_the_most() -> None:
    one = Fetched(bytes(2 * ranged_file.MOST_BYTES + 1))
    assert len(one.file.read()) == len(one.content)
    assert [stop - start for start, stop in one.fetches] == [ranged_file.MOST_BYTES, ranged_file.MOST_BYTES, 1]


def test_an_empty_file_is_not_fetched() -> None:
    one = Fetched(b"")
    assert (one.file.read(), one.file.readinto(bytearray(4)), one.fetches) == (b"", 0, [])
