"""Damaged files: whatever bytes are flipped, cut or moved, the validator says so and never fails itself."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests import synthetic

from branchdrive.engine.validate import validate
from branchdrive.engine.worker import Died, isolated

NUM_CASES = 90


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes with one kind of damage."""
    data = bytearray(content)
    size = max(len(data), 1)
    start, length = int(rng.integers(size)), int(rng.integers(1, 64))
    match rng.integers(7):
        case 0:  # single bits
            for place in rng.integers(size, size=rng.integers(1, 6)):
                data[place : place + 1] = bytes(b ^ (1 << int(rng.integers(8))) for b in data[place : place + 1])
        case 1:  # bits of the last kilobyte, where Parquet keeps its footer
            for place in size - 1 - rng.integers(min(size, 1000), size=rng.integers(1, 6)):
                data[place : place + 1] = bytes(b ^ (1 << int(rng.integers(8))) for b in data[place : place + 1])
        case 2:  # cut off
            del data[start:]
        case 3:  # a piece missing
            del data[start : start + length]
        case 4:  # a piece overwritten
            data[start : start + length] = rng.bytes(length)
        case 5:  # a piece twice
            data[start:start] = data[start : start + length]
        case _:  # a piece zeroed
            data[start : start + length] = bytes(length)
    return bytes(data)


def judge(root: Path) -> tuple[str, tuple[str, ...]]:
    report = validate(root)
    return report.verdict, report.errors


def test_damage_is_found_and_never_an_error(valid_root: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(40)
    files = sorted(path.relative_to(valid_root) for path in valid_root.rglob("*") if path.is_file())
    cases: list[tuple[Path, bool]] = []
    for index in range(NUM_CASES):
        root = tmp_path / str(index)
        shutil.copytree(valid_root, root)
        victim = root / files[index % len(files)]
        before = victim.read_bytes()
        victim.write_bytes(damaged(before, rng))
        is_sealed = bool(rng.integers(2)) and victim.name != "MANIFEST.sha256"
        if is_sealed:  # the damage was there when the manifest was written
            synthetic.seal_dataset(root)
        if victim.read_bytes() != before:
            cases.append((root, is_sealed))
    assert len(cases) > NUM_CASES * 0.9
    outcomes = dict(isolated(1)(judge, [root for root, _ in cases]))
    for index, (root, is_sealed) in enumerate(cases):
        found = outcomes[index]
        if isinstance(found, Died):  # then it must be a finding of the process that started the one that died
            report = validate(root, executor=isolated(1))
            found = (report.verdict, report.errors)
        verdict, errors = found
        assert errors == (), root
        assert verdict in (("valid", "invalid") if is_sealed else ("invalid",)), root


@pytest.mark.parametrize("seed", range(3))
def test_files_may_be_exchanged(seed: int, valid_root: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    root = tmp_path / "dataset"
    shutil.copytree(valid_root, root)
    tables = sorted((root / "raw").rglob("*.parquet"))
    content = [path.read_bytes() for path in tables]
    for path, source in zip(tables, rng.permutation(len(tables)), strict=True):
        path.write_bytes(content[source])
    synthetic.seal_dataset(root)
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
