"""Studies and pictures of a stranger's dataset whose descriptor or manifest is changed at one place."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.changed_input import poor_ends
from tests.reference_impl.study import samples
from tests.sampling import sampled

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.runtime.executor import in_process


@pytest.mark.parametrize(
    ("path", "size"),
    sampled([(DESCRIPTOR_FILE, 8), (DESCRIPTOR_FILE, 60), (MANIFEST_FILE, 2), (MANIFEST_FILE, 20)], every=2),
)
def test_a_changed_dataset_is_shown_or_refused_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str, size: int
) -> None:
    monkeypatch.setattr("branchdrive.runtime.executor.isolated", lambda jobs: in_process)
    root = samples.written(tmp_path / "d")
    draw = ("draw", root, "--output", tmp_path / "p", "--group", "g0", "--format", "svg")
    assert poor_ends(root, path, size, ("study", root), draw) == []
