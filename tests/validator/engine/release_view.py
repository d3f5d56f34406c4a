"""A release as its rules see it, in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.derived import layers_tasks
from branchdrive.engine.derived_rules import view_of
from branchdrive.engine.reading import read_dataset
from branchdrive.engine.spool import Spool
from branchdrive.files.survey import take_survey
from branchdrive.formats.folder import Folder
from branchdrive.formats.table_file import parts_of
from branchdrive.layers.view import RawLayer, ReleaseView
from branchdrive.runtime.executor import in_process


def release_view(root: Path) -> ReleaseView:
    """View of the release at `root`, with its raw layer and all its rows."""
    survey, selected = take_survey(Folder(root)), frozenset(CATALOGUE)
    with Spool.temporary() as spool:
        reading = read_dataset(survey, selected, in_process, spool=spool, release=survey)
        assert reading.layers is not None and not reading.errors
        view = view_of(next(layers_tasks(reading, reading.layers, selected))[0])
        assert view.raw.rows is not None
        raw = RawLayer(dict(view.raw.rows), digest=view.raw.digest, descriptor=view.raw.descriptor)
        tables = {name: table.take(np.arange(table.num_rows)) for name, table in view.tables.items()}
        num_rows = {path: len(rows) for name in tables for path, rows in parts_of(name, tables[name]).items()}
        return ReleaseView(
            view.descriptor, tables, view.documents, view.contents, raw, view.files,
            digests=view.digests, sizes=view.sizes, num_rows=num_rows,
        )  # fmt: skip
