"""Claims of a media index: each thing that is said once, of each range once, in the order of bytes."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st
from tests.synthetic import to_table

from branchdrive.contract.camera import Camera, TopDownCamera
from branchdrive.contract.columns import table_schema
from branchdrive.contract.limits import spec_limits
from branchdrive.raw.media.image_claims import ImageClaims

COLUMNS = ("file", "offset_bytes", "size_bytes", "camera", "encoding", "checksum")


def camera(name: str, *, stream: str = "rgb_top_down", side_px: int = 16) -> Camera:
    place = {"origin_row_px": 0.0, "origin_column_px": 0.0, "px_per_m": 1.0}
    return TopDownCamera.model_validate(
        {"name": name, "stream": stream, "width_px": side_px, "height_px": side_px, "projection": "top_down", **place}
    )


def index(rows: list[dict[str, Any]]) -> pa.Table:
    """A media index; what a row leaves out is that of the first image of a file."""
    usual = {
        "rollout_id": "g0.nominal.a1", "tick": 0, "camera": "front", "file": "a.bin", "offset_bytes": 0,
        "size_bytes": 10, "checksum": "0" * 16, "encoding": "png",
    }  # fmt: skip
    whole = [{**usual, **row} for row in rows]
    if not whole:
        return table_schema("frames").empty_table()
    return to_table("frames", {name: [row[name] for row in whole] for name in usual})


said = st.fixed_dictionaries({
    "file": st.sampled_from(["a.bin", "b.tar", "../x", ""]), "offset_bytes": st.integers(-1, 2),
    "size_bytes": st.integers(0, 2), "camera": st.sampled_from(["front", "rear"]),
    "checksum": st.sampled_from(["0" * 16, "1" * 16]), "tick": st.sampled_from([0, 5, None]),
})  # fmt: skip


@given(st.lists(said, max_size=12))
def test_every_row_is_in_one_claim_with_all_that_say_the_same(rows: list[dict[str, Any]]) -> None:
    frames = index(rows)
    claims = ImageClaims(frames)
    expected: dict[tuple[Any, ...], list[int]] = {}
    for number, row in enumerate(frames.to_pylist()):
        if row["file"] in ("a.bin", "b.tar") and row["tick"] is not None:
            expected.setdefault(tuple(row[name] for name in COLUMNS), []).append(number)
            assert claims.key(number) == (row["rollout_id"], row["tick"], row["camera"])
    found = {
        (name, place.offset, place.size, claim.camera, claim.encoding, claim.checksum): claim.rows.tolist()
        for name in claims.num_rows
        for place in claims.places(name)
        for claim in place.claims
    }
    assert found == expected
    assert list(found) == sorted(found)
    assert list(claims.places("nowhere")) == []


def test_equal_ranges_are_counted_once_and_ends_of_files_cut_them() -> None:
    claims = ImageClaims(index([{}, {"tick": 5}, {"offset_bytes": 8}, {"offset_bytes": -5}, {"file": "b.bin"}]))
    assert claims.num_rows == {"a.bin": 4, "b.bin": 1}
    assert claims.num_bytes("a.bin", 100) == 20
    assert claims.num_bytes("a.bin", 12) == 14
    assert claims.num_bytes("nowhere", 12) == 0


def test_rows_of_a_range_are_bounded() -> None:
    most = spec_limits().max_range_rows
    cameras = {"front": camera("front"), "bev": camera("bev", stream="semantic_bev")}
    rows = [{"tick": 5 * number} for number in range(most)]
    assert ImageClaims(index(rows)).excess(cameras) is None
    excess = ImageClaims(index([*rows, {"tick": 1, "camera": "rear"}])).excess(cameras)
    assert excess == f"names 10 bytes from 0 of 'a.bin' in {most + 1} rows; the limit is {most}"
    two = [{"offset_bytes": 10, "tick": tick, "camera": "bev"} for tick in (0, 5)]
    assert ImageClaims(index([*rows, two[0]])).excess(cameras) is None
    excess = ImageClaims(index([*rows, *two])).excess(cameras)
    assert excess == "names 10 bytes from 10 of 'a.bin', a semantic map, in 2 rows; the limit is 1"


def test_pixels_of_a_shard_are_bounded_and_repeated_ranges_counted_once() -> None:
    side_px = 16_384
    most = spec_limits().max_shard_pixels // side_px**2
    cameras = {"front": camera("front", side_px=side_px)}
    rows = [{"offset_bytes": number, "tick": tick} for number in range(most) for tick in (0, 5)]
    assert ImageClaims(index(rows)).excess(cameras) is None
    excess = ImageClaims(index([*rows, {"offset_bytes": most}])).excess(cameras)
    assert excess == f"names images of {(most + 1) * side_px**2:,} pixels; the limit is {most * side_px**2:,}"
    assert ImageClaims(index([])).excess(cameras) is None


def test_a_name_that_a_file_stores_twice_is_one() -> None:
    frames = index([{"tick": 0}, {"tick": 5}])
    for name in ("file", "checksum"):
        (value,) = set(frames[name].to_pylist())
        twice = pa.DictionaryArray.from_arrays(pa.array([0, 1], pa.int32()), pa.array([value, value]))
        frames = frames.set_column(frames.column_names.index(name), name, twice)
    (place,) = ImageClaims(frames).places("a.bin")
    assert [claim.rows.tolist() for claim in place.claims] == [[0, 1]]
