"""The page on loading a release shows what works, and tells what there is."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
from tests.model_release import DESCRIPTOR, make_arrays, make_frames, write_release
from tests.repo.checkout import ROOT

from branchdrive.driving.feature import InputContract
from branchdrive.model.features import features_document

if TYPE_CHECKING:
    from pathlib import Path

PAGE = (ROOT / "docs" / "model-layer.md").read_text(encoding="utf-8")


def test_the_examples_run_one_after_the_other(tmp_path: Path) -> None:
    root = write_release(tmp_path / "release", make_frames())
    names: dict[str, Any] = {}
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    for block in blocks:
        exec(block.replace("build/release", str(root)), names)
    assert len(blocks) == 3
    assert (names["features"].shape, names["speed"].shape, names["actions"].shape) == ((3, 336), (1, 16), (13, 29))
    assert np.isfinite(names["known"]).all()
    paths = make_arrays(make_frames()).trajectories.values[[0, 1, 4]]
    np.testing.assert_allclose(names["metres"], paths, atol=1e-9)
    assert names["table"].num_rows == 650
    assert names["batch"]["trajectory"].shape == (3, 13, 10, 5)


def test_the_table_has_the_arrays_of_the_features_document() -> None:
    rows = re.findall(r"^\| ([a-z]+) \| `\[(.*?)\]`( and mask)? \|", PAGE, re.M)
    shown = {}
    for name, shape, mask in rows:
        sizes = ["groups" if size == "N" else int(size) for size in shape.split(", ")]
        shown[name] = sizes
        if mask:
            shown[f"{name}_available"] = sizes
    assert shown == {name: about["shape"] for name, about in features_document(DESCRIPTOR)["arrays"].items()}


def test_the_table_has_every_contract() -> None:
    rows = re.findall(r"^\| ([a-z]+) \| `[a-z_]+_inputs` \|", PAGE, re.M)
    assert rows == [contract.value for contract in InputContract]
