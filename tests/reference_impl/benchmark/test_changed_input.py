"""Steps of the benchmark on a stranger's release, or with a protocol of theirs, changed at one place."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.changed_input import changed_contents, poor_end, poor_ends
from tests.sampling import sampled

from branchdrive.contract.layout import (
    BENCHMARK_LEDGER_FILE,
    DESCRIPTOR_FILE,
    LOCK_FILE,
    MANIFEST_FILE,
    PROTOCOL_FILE,
    RANKING_LOCK_FILE,
    RESULTS_FILE,
)

FILES = (DESCRIPTOR_FILE, MANIFEST_FILE, PROTOCOL_FILE, LOCK_FILE, RANKING_LOCK_FILE, BENCHMARK_LEDGER_FILE,
         RESULTS_FILE, "model/features.json", "model/normalisation.json", "quality/variants.json")  # fmt: skip
STEPS = {
    "train": ("--models", "M0", "--no-guard"),
    "lock": (),
    "predict": (),
    "evaluate": ("--no-figures",),
}
"""Options of every step."""


@pytest.mark.parametrize("step", sampled(STEPS, every=3))
def test_a_changed_release_is_used_or_refused_in_words(done: Path, tmp_path: Path, step: str) -> None:
    for place, path in enumerate(FILES):
        root = shutil.copytree(done, tmp_path / str(place))
        assert poor_ends(root, path, 1, (step, root, *STEPS[step])) == [], path
        shutil.rmtree(root)


@pytest.mark.parametrize("step", sampled(["train", "lock", "evaluate"], every=2))
def test_a_changed_protocol_is_used_or_refused_in_words(
    done: Path, small_protocol: Path, tmp_path: Path, step: str
) -> None:
    file = tmp_path / "protocol.json"
    for number, (what, content) in enumerate(changed_contents(f"{step}.json", small_protocol.read_bytes(), 4)):
        file.write_bytes(content)
        root = shutil.copytree(done, tmp_path / str(number))
        assert poor_end(step, root, *STEPS[step], "--protocol", file) == "", what
        shutil.rmtree(root)
