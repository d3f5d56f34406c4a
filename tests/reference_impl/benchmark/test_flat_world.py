"""A world without heights, speed limits, commands, hazards and target speed, from its raw layer to a benchmark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.content_cache import kept_folder
from tests.reference_impl.benchmark.small_release import invoke, smallest_protocol, write_protocol
from tests.synthetic_release import raw_descriptor, raw_tables
from tests.validator.engine.rules.draft import Draft
from tests.validator.release.running import build

from branchdrive.contract.columns import RECORDABLE
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.validate import validate
from branchdrive.model.features import HISTORIES, recorded_features
from branchdrive.model.reader import open_model
from branchdrive_reference.benchmark.onnx_export import OUTPUT, contexts_of, open_selector

ABSENT = 7, 4
"""Features of the state and of the expert that need an unrecorded column."""


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release in place with an own benchmark."""
    folder = tmp_path_factory.mktemp("flat")
    protocol = write_protocol(folder / "protocol.json", smallest_protocol())

    def benchmark(root: Path) -> None:
        write_flat(root)
        build(root)
        invoke("benchmark", root, "--protocol", protocol, "--no-figures")

    return kept_folder("flat-release", benchmark, folder / "release")


def write_flat(root: Path) -> None:
    """A raw layer that records nothing that a dataset may leave out."""
    d = Draft(raw_tables(), {**raw_descriptor(), "unrecorded": list(RECORDABLE), "driver": {"kind": "log"}})
    for place in RECORDABLE:
        table, column = place.split(".")
        d.set(table, column, None)
    d.write(root)


def test_it_is_valid_with_its_benchmark(release: Path) -> None:
    report = validate(release)
    assert report.errors == ()
    assert [f.message for f in report.findings if CATALOGUE[f.rule].decides] == []
    assert report.verdict == "valid"
    card = (release / "README.md").read_text()
    assert "| Driver | recorded log |" in card
    assert "`observations.speed_limit_mps`" in card


def test_what_it_does_not_record_is_no_number_and_tells_nothing(release: Path) -> None:
    layer = open_model(release)
    for normalised, expected in ((False, np.nan), (True, 0.0)):
        found = layer.mixed_inputs("train", normalised=normalised)
        for table, values, absent in zip(("state", "expert"), (found.state, found.expert), ABSENT, strict=True):
            is_recorded = recorded_features(table, layer.descriptor)
            assert (~is_recorded).sum() == absent
            assert np.isfinite(values[..., is_recorded]).all()
            np.testing.assert_array_equal(values[..., ~is_recorded], expected)
    state = layer.column("sensor", "state", "speed_limit_mps")
    assert np.ma.getmaskarray(state).all()
    assert not np.ma.isMaskedArray(layer.column("sensor", "state", "speed_mps"))
    names = [feature.name for feature in HISTORIES["state"].features]
    assert names[8] == "speed_limit_mps"


@pytest.mark.thorough
def test_an_exported_selector_ignores_what_is_not_recorded(release: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    invoke("export", release, "--output", tmp_path / "selector.onnx")  # compares it with torch
    session, layer = open_selector((tmp_path / "selector.onnx").read_bytes()), open_model(release)
    ((state, controls),) = contexts_of(layer, "val", 1)
    found = session.run([OUTPUT], {"state": state, "controls": controls})[0]
    assert np.isfinite(found).all()
    invented = np.where(recorded_features("state", layer.descriptor), state, np.float32(13.5))
    np.testing.assert_array_equal(session.run([OUTPUT], {"state": invented, "controls": controls})[0], found)
