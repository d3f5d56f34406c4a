"""Openings that a dataset and its detached release have recorded are kept, all of them, and each once."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import build, call, contents
from tests.validator.release.test_stages import entries

from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import LEDGER_FILE as LEDGER
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError
from branchdrive.quality.benchmark_openings import BENCHMARK_EVENTS, locks_of, with_benchmark
from branchdrive.quality.ledger import EVENTS, num_test_openings, opened, recorded
from branchdrive.release.openings import merged_ledger


def ledger(*rounds: str) -> dict[str, Any] | None:
    """A ledger of rounds, each named by a letter that stands for its digests."""
    found = None
    for name in rounds:
        found = opened(found, split_digest=name * 64, thresholds_digest=name * 64)
    return found


@pytest.mark.parametrize(
    ("first", "second", "merged"),
    [
        ("", "", ""),
        ("a", "", "a"),
        ("", "a", "a"),
        ("a", "ab", "ab"),
        ("ab", "a", "ab"),
        ("ab", "ab", "ab"),
        ("ab", "ac", "abc"),
        ("a", "b", "ab"),
        ("ab", "b", "ab"),
        ("ab", "cb", "abc"),
        ("ab", "acbd", "abcd"),
    ],
)
def test_two_ledgers_are_one(first: str, second: str, merged: str) -> None:
    assert merged_ledger(ledger(*first), ledger(*second)) == ledger(*merged)


def test_openings_for_a_benchmark_are_merged_with_the_rounds() -> None:
    def looked(rounds: str, *locks: str) -> dict[str, Any] | None:
        openings = [{"event": BENCHMARK_EVENTS[0], "lock_digest": lock * 64} for lock in locks]
        return with_benchmark(ledger(*rounds), {"entries": openings})

    assert merged_ledger(looked("a", "e"), looked("a", "e")) == looked("a", "e")
    assert merged_ledger(ledger("a"), looked("a", "e")) == looked("a", "e")
    merged = merged_ledger(looked("a", "e"), looked("ab", "f"))
    assert merged is not None
    assert locks_of(merged, BENCHMARK_EVENTS[0]) == ["e" * 64, "f" * 64]
    assert num_test_openings(merged) == 2
    assert [entry["number"] for entry in merged["entries"]] == list(range(1, 9))


def test_a_ledger_out_of_order_is_refused() -> None:
    fixed = recorded(None, next(iter(EVENTS)), split_digest="b" * 64, thresholds_digest="b" * 64)["entries"][0]
    wrong = {"entries": [{**fixed, "event": "test_opened", "partition": "test"}]}
    with pytest.raises(DatasetError, match="restore the file"):
        merged_ledger(ledger("a"), wrong)


def test_a_detached_release_takes_over_the_openings_of_its_dataset(release: Path, tmp_path: Path) -> None:
    before = contents(release)
    code, out, _ = call("build", release, "--output", tmp_path / "other", "--seed", str(SEED + 1), "--no-leakage")
    assert code == 0
    assert "The test partition was opened 2 times" in out
    assert entries(tmp_path / "other")[:3] == entries(release)
    assert num_test_openings({"entries": entries(tmp_path / "other")}) == 2
    assert validate(tmp_path / "other", raw=release).verdict == "valid"
    assert contents(release) == before
    first = contents(tmp_path / "other")
    build(release, output=tmp_path / "other", seed=SEED + 1)
    assert contents(tmp_path / "other") == first


def test_later_openings_of_the_dataset_reach_the_release(release: Path, tmp_path: Path) -> None:
    build(release, output=tmp_path / "other")
    assert entries(tmp_path / "other") == entries(release)
    build(release, seed=SEED + 1)
    build(release, output=tmp_path / "other")
    assert entries(tmp_path / "other") == entries(release)
    assert num_test_openings({"entries": entries(release)}) == 2
    assert validate(tmp_path / "other", raw=release).verdict == "valid"


def test_a_ledger_of_the_dataset_that_cannot_be_read_is_refused(release: Path, tmp_path: Path) -> None:
    (release / LEDGER).write_bytes(dump_json({"entries": "none"}))
    with pytest.raises(DatasetError, match=LEDGER):
        build(release, output=tmp_path / "other")
    shutil.rmtree(tmp_path / "other", ignore_errors=True)
    (release / LEDGER).unlink()
    build(release, output=tmp_path / "other")
    assert num_test_openings({"entries": entries(tmp_path / "other")}) == 1
