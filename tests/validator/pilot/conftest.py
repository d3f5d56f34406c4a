"""A pilot on disk, and its groups one by one for the collector that copies them."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests import synthetic
from tests.validator.engine import datasets

from branchdrive.contract.document import dump_json
from branchdrive.formats.parquet import encode_table
from branchdrive.pilot.pilot import Pilot, read_pilot


@pytest.fixture(scope="session")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Few attempts of every group in a folder of its own, and the descriptor; read-only by agreement."""
    root = tmp_path_factory.mktemp("source")
    (root / "branchdrive.json").write_bytes(dump_json(synthetic.descriptor()))
    for index in range(3):
        folder = root / synthetic.group_name(index)
        folder.mkdir()
        for name, table in synthetic.with_few_attempts({"": synthetic.make_group(index)})[""].items():
            (folder / f"{name}.parquet").write_bytes(encode_table(table))
    return root


@pytest.fixture(scope="session")
def pilot(tmp_path_factory: pytest.TempPathFactory) -> Pilot:
    """The valid dataset of three groups, read."""
    return read_pilot(datasets.write(tmp_path_factory.mktemp("pilot") / "dataset"))
