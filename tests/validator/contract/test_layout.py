from __future__ import annotations

import pytest
from tests.each import each

from branchdrive.contract.layout import MAX_SHARD_INDEX, layer_of, shard_index, shard_name, unsafe_reason
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import UsageError


@pytest.mark.parametrize("index", [0, 7, 99_999, 100_000, MAX_SHARD_INDEX])
def test_shard_names_and_indices_are_inverse(index: int) -> None:
    assert shard_index(shard_name(index)) == index


@pytest.mark.parametrize("index", [-1, MAX_SHARD_INDEX + 1])
def test_shards_out_of_range_have_no_name(index: int) -> None:
    with pytest.raises(UsageError, match=f"shard {index} is not in 0 .. 999999999"):
        shard_name(index)


@pytest.mark.parametrize(
    "name",
    [
        "shard-7",
        "shard-000007",
        "shard-0000a",
        "shard-\u0660\u0660\u0660\u0660\u0667",
        ".shard-00007.partial",
        "shard-00007 ",
    ],
)
def test_other_names_are_no_shards(name: str) -> None:
    assert shard_index(name) is None


@each(
    ("path", "layer"),
    [
        ("branchdrive.json", None),
        ("raw", None),
        ("raw/notes.txt", "raw"),
        ("raw/shard-00000/rollouts.parquet", "raw"),
        ("raw/shard-00000/evidence.parquet", "raw"),
        ("raw/shard-00000/frames.parquet", "media"),
        ("raw/shard-00000/media.tar", "media"),
        ("raw/shard-00000/front/000080.jpeg", "media"),
        ("raw/shard-00000/deeper/rollouts.parquet", "media"),
        ("raw/shard-7/rollouts.parquet", "raw"),
        ("canonical/links.parquet", "canonical"),
        ("quality/split.json", "quality"),
        ("model/features.parquet", "model"),
        ("benchmark/results.json", "benchmark"),
        ("media/film.mp4", None),
        ("elsewhere/file", None),
    ],
)
def test_a_file_belongs_to_the_layer_of_its_folder(path: str, layer: str | None) -> None:
    assert layer_of(path) == layer


@each(
    ("path", "reason"),
    [
        ("", "empty"),
        ("/etc/passwd", "absolute"),
        ("../secret", "leaves"),
        ("raw/../../secret", "leaves"),
        ("raw/./x", "not normalised"),
        ("raw//x", "not normalised"),
        ("raw/", "not normalised"),
        ("raw\\x", "backslash"),
        ("C:/x", "colon"),
        ("raw/x:stream", "colon"),
        ("raw/a\x00b", "control"),
        ("raw/a\nb", "control"),
        ("raw/a\x85b", "control"),
        ("raw/\u202etxt.exe", "control"),
        ("raw/a\ud800", "control"),
        ("raw/a\u2028b", "control"),
        ("raw/name.", "dot"),
        ("raw/name /x", "blank"),
        ("a/" * 9 + "x", "deeper"),
        ("x" * 241, "longer"),
        ("ä" * 121, "longer"),
    ],
)
def test_unsafe_paths_are_told_apart_with_a_reason(path: str, reason: str) -> None:
    assert reason in str(unsafe_reason(path))


@pytest.mark.parametrize(
    "path", ["a", "raw/shard-00000/x.parquet", "a/" * 8 + "x", "x" * 240, "raw/..name", "raw/ä.txt"]
)
def test_plain_relative_paths_are_safe(path: str) -> None:
    assert unsafe_reason(path, spec_limits()) is None
