"""The log of committed shards: whole lines count, whatever a kill or a damage leaves of the others."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.writer.place_log import CommittedShard, FileState, KnownFile, PlaceLog


def shard(index: int, *group_ids: str) -> CommittedShard:
    places = {group_id: 2 * index + offset for offset, group_id in enumerate(group_ids)}
    files = {"controls.parquet": KnownFile("0" * 64, FileState(10, 20 + index, 30))}
    return CommittedShard.of(index, places, [f"{group_id}.a1" for group_id in group_ids], files)


SHARDS = (shard(0, "a", "b"), shard(7, "c"), shard(2, "d", "e"), shard(7, "c", "f"))
"""The last of them replaces the second."""


def begun(path: Path, *shards: CommittedShard) -> PlaceLog:
    log = PlaceLog(path)
    log.begin(2)
    for each in shards:
        log.append(each)
    return log


def known(log: PlaceLog) -> dict[int, CommittedShard | None]:
    return {index: log.read_shard(index) for index in log.shards}


def of(*shards: CommittedShard) -> dict[int, CommittedShard]:
    return {each.index: each for each in shards}


def test_it_tells_what_was_appended(tmp_path: Path) -> None:
    log = begun(tmp_path / "log", *SHARDS)
    for reader in (log, PlaceLog(tmp_path / "log")):
        assert reader.read_on()
        assert known(reader) == of(*SHARDS)
        assert (reader.groups_per_shard, reader.last_place, reader.is_torn) == (2, 15, False)
        assert reader.committed == {"a": 0, "b": 1, "c": 14, "d": 4, "e": 5, "f": 15}
        assert [reader.holder_of(place) for place in (1, 2, 15)] == ["b", None, "f"]


def test_whoever_has_read_it_reads_on(tmp_path: Path) -> None:
    first, second = begun(tmp_path / "log"), PlaceLog(tmp_path / "log")
    for number, each in enumerate(SHARDS):
        (first, second)[number % 2].append(each)
    assert first.read_on()
    assert second.read_on()
    assert known(first) == known(second) == of(*SHARDS)


def test_cut_off_at_any_byte_it_has_the_whole_lines_and_takes_further_ones(tmp_path: Path) -> None:
    path = tmp_path / "log"
    begun(path, *SHARDS[:3])
    content = path.read_bytes()
    header = content.index(b"\n") + 1
    added = shard(9, "z")
    for length in range(len(content) + 1):
        path.write_bytes(content[:length])
        log = PlaceLog(path)
        assert log.read_on() == (length >= header)
        if length < header:
            continue
        whole = SHARDS[: content[header:length].count(b"\n")]
        assert known(log) == of(*whole)
        assert log.is_torn == (not content[:length].endswith(b"\n"))
        log.append(added)
        assert known(log) == of(*whole, added)
        again = PlaceLog(path)
        assert again.read_on()
        assert known(again) == known(log)


@given(st.data())
def test_a_damaged_byte_costs_no_line_before_it(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    path = tmp_path_factory.mktemp("damaged") / "log"
    begun(path, *SHARDS[:3])
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] = data.draw(st.sampled_from([0, 0x0A, 0x22, 0xFF, 0x7B]))
    path.write_bytes(content)
    log = PlaceLog(path)
    header = content.index(b"\n") + 1
    if log.read_on() and place >= header:
        assert known(log).items() >= of(*SHARDS[: content[header:place].count(b"\n")]).items()


def test_a_log_that_is_begun_anew_or_gone_is_noticed(tmp_path: Path) -> None:
    log = begun(tmp_path / "log", *SHARDS)
    PlaceLog(tmp_path / "log").begin(3, [SHARDS[0]])
    assert log.read_on()
    assert (log.groups_per_shard, known(log), log.last_place) == (3, of(SHARDS[0]), 1)
    (tmp_path / "log").unlink()
    assert not log.read_on()
    assert (log.committed, log.shards) == ({}, [])
