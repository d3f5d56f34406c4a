"""A study of a stranger's dataset: bounded memory, and nothing on the terminal that is not plain text."""

from __future__ import annotations

import io
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.reference_impl.study import samples
from tests.reference_impl.study.samples import replaced

from branchdrive import UsageError, open_dataset
from branchdrive.cli.main import run
from branchdrive.text.terminal import PLAIN_WIDTH
from branchdrive_reference.study.label import MAX_TEXT_CHARACTERS, label, labels, sentence
from branchdrive_reference.study.text import render_study

NOMINAL = "g0.nominal.a1"
EVIL = "\x1b]0;mine\x07\x1b[2J\nsecond line \u202e" + "x" * 200


def study(*arguments: object) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    return run(["study", *map(str, arguments)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


@pytest.mark.parametrize("column", ["scenario_type", "town", "status", "group_id"])
def test_text_of_a_dataset_is_escaped_and_short(tmp_path: Path, column: str) -> None:
    samples.written(tmp_path / "d", {"rollouts": replaced(column, {NOMINAL: EVIL})})
    code, out, err = study(tmp_path / "d")
    assert (code, err) == (0, "")
    assert all(line.isprintable() and line.isascii() for line in out.splitlines())
    assert max(map(len, out.splitlines())) <= PLAIN_WIDTH
    assert ("\\x1b]0;mine\\x07" in out) == (column != "group_id")
    assert "x" * 61 not in out.replace("\n", "").replace(" ", "")
    code, out, _ = study(tmp_path / "d", "--format", "json")
    assert code == 0 and all(line.isprintable() and line.isascii() for line in out.splitlines())


def test_the_heading_is_escaped(tmp_path: Path) -> None:
    text = render_study(replace(samples.studied(tmp_path / "d"), dataset_id=EVIL), io.StringIO())
    assert text.splitlines()[0].startswith("\\x1b]0;mine\\x07")


def test_a_path_is_escaped(tmp_path: Path) -> None:
    root = samples.written(tmp_path / "d\x1b[2J\x07\n")
    (root / samples.FIRST / "controls.parquet").write_bytes(b"PAR1")
    code, out, err = study(root)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err[:-1].isprintable() and "\\x1b[2J" in err


@pytest.mark.parametrize("column", ["scenario_type", "town", "status", "group_id"])
def test_a_name_that_no_format_allows_is_refused(tmp_path: Path, column: str) -> None:
    samples.written(tmp_path / "d", {"rollouts": replaced(column, {NOMINAL: "\x1b" * 3_000_000})})
    code, out, err = study(tmp_path / "d")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"`{column}` holds a text of 3,000,000 characters, '\\x1b" in err
    assert "may hold 1,000; run `branchdrive-validate`" in err
    assert err[:-1].isprintable() and len(err) < 400


def test_the_longest_text_is_still_a_name(tmp_path: Path) -> None:
    longest = "x" * MAX_TEXT_CHARACTERS
    found = samples.studied(tmp_path / "d", {"rollouts": replaced("town", {NOMINAL: longest})})
    assert found.population.towns[longest] == 1


def test_one_long_name_does_not_make_every_name_long(tmp_path: Path) -> None:
    from branchdrive.raw.shard_view import ShardView
    from branchdrive_reference.study.facts import shard_facts

    edit = replaced("town", {NOMINAL: "x" * 1_000_000})
    dataset = open_dataset(samples.written(tmp_path / "d", {"rollouts": edit}))
    names = [name for name in dataset.descriptor.tables if name != "frames"]
    view = ShardView({name: dataset.shards[0].decode(name) for name in names}, dataset.descriptor)
    tracemalloc.start()
    with np.errstate(all="ignore"):
        facts = shard_facts(view)
    largest = max(trace.size for trace in tracemalloc.take_snapshot().traces)
    tracemalloc.stop()
    assert facts.groups.town.dtype == facts.groups.scenario_type.dtype == facts.banks.scenario_type.dtype == object
    assert largest < 2_000_000


def test_text_that_would_not_fit_in_memory_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples.written(tmp_path / "d")
    monkeypatch.setattr("branchdrive.formats.table_file.written_out_bytes", lambda table: 300_000_000)
    code, out, err = study(tmp_path / "d")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "its text is" in err


def test_labels_are_one_line_of_bounded_length() -> None:
    assert label("CutIn") == "CutIn"
    assert label("x" * 60) == "x" * 60
    assert label("x" * 61) == "x" * 57 + "..."
    assert label("\x1b\x07\n") == "\\x1b\\x07\\n"
    assert len(label("\U0001f600" * 60)) == 60
    assert labels(["a", "\n"]) == "a, \\n"
    assert labels(map(str, range(42))).endswith("38, 39 and 2 more")
    assert sentence(UsageError("\x1b" * 3_000_000)) == ("\\x1b" * 125)
