"""Croissant of a dataset: a loader that others wrote reads from it every record that our reader does."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.synthetic import seal_dataset
from tests.validator.cli.test_main import call
from tests.validator.engine.rules.release import release_draft

from branchdrive.card.croissant import croissant
from branchdrive.card.deposit import codemeta, zenodo
from branchdrive.cli.main import run
from branchdrive.contract.columns import declared_table
from branchdrive.contract.layer import paths_by_table, table_file
from branchdrive.engine.validate import validate
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import read_manifest

MOST_RECORDS = 150
"""Records of a table that are compared, of a large one the first: the loader takes a millisecond for each."""

of_the_loader = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
"""The loader uses what its own libraries have deprecated."""


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release with croissant.json, whose table of targets in training lies in two parts."""
    root = release_draft().write(tmp_path_factory.mktemp("release") / "dataset")
    first = root / "model/scalars-train-00000.parquet"
    rows = pq.read_table(first)
    pq.write_table(rows.slice(0, 20), first)
    pq.write_table(rows.slice(20), first.with_name("scalars-train-00001.parquet"))
    seal_dataset(root)
    code, out, err = call(run, "metadata", root, "--write")
    assert (code, err) == (0, "")
    assert out.startswith(f"{root}/croissant.json: ")
    return root


def document(root: Path) -> dict[str, Any]:
    parsed: dict[str, Any] = json.loads((root / "croissant.json").read_bytes())
    return parsed


def stored(root: Path) -> dict[str, pa.Table]:
    """Rows of every table, or partition of one, by the name of its record set."""
    paths = [path.relative_to(root).as_posix() for path in sorted(root.rglob("*.parquet"))]
    found: dict[str, list[str]] = {}
    for path in paths:
        file = table_file(path)
        name = Path(path).stem if file is None else file.table + (f"-{file.partition}" if file.partition else "")
        found.setdefault(name, []).append(path)
    assert len(paths_by_table(paths)) > 10
    return {
        name: pa.concat_tables([pq.read_table(root / path) for path in own], promote_options="permissive")
        for name, own in found.items()
    }


def alike(found: Any, expected: Any) -> bool:
    if isinstance(found, bytes):
        return bool(found.decode() == expected)
    if isinstance(expected, list):
        return [*found] == expected
    if isinstance(expected, int) and abs(expected) >= 2**53:
        return math.isclose(found, expected)  # the loader reads a column with nulls as numbers of 53 bits
    if isinstance(expected, float):
        return found is not None and math.isclose(found, expected, rel_tol=1e-6)
    return bool(found == expected)


@of_the_loader
def test_every_record_set_loads_what_is_stored(release: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    dataset = mlcroissant.Dataset(jsonld=release / "croissant.json")
    tables = stored(release)
    names = [record_set["@id"] for record_set in document(release)["recordSet"]]
    assert sorted(names) == sorted(tables)
    for name in names:
        records = [*islice(dataset.records(name), MOST_RECORDS)]
        rows = tables[name].slice(0, MOST_RECORDS).to_pylist()
        assert len(records) == len(rows), name
        for record, row in zip(records, rows, strict=True):
            assert {key.removeprefix(f"{name}/") for key in record} == set(row)
            wrong = {key: record[f"{name}/{key}"] for key in row if not alike(record[f"{name}/{key}"], row[key])}
            assert not wrong, (name, row)


@of_the_loader
def test_a_file_that_is_not_the_listed_one_is_not_loaded(release: Path, tmp_path: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    root = Path(shutil.copytree(release, tmp_path / "copy"))
    path = root / "model/contexts-val-00000.parquet"
    rows = pq.read_table(path)
    pq.write_table(rows.slice(1), path)
    with pytest.raises(Exception, match=r"contexts-val|[Hh]ash"):
        [*mlcroissant.Dataset(jsonld=root / "croissant.json").records("contexts-val")]


def test_fields_say_what_columns_are(release: Path) -> None:
    for record_set in document(release)["recordSet"]:
        table = declared_table(record_set["@id"].split("-")[0])
        assert [field["name"] for field in record_set["field"]] == [column.name for column in table.columns]
        for field, column in zip(record_set["field"], table.columns, strict=True):
            assert field["description"].startswith(column.description)
            assert column.unit is None or f"Unit: {column.unit}." in field["description"]
            assert f"Track: {column.track}." in field["description"]


def test_digests_are_those_of_the_manifest(release: Path) -> None:
    files = read_manifest(Folder(release))[0].files
    objects = [one for one in document(release)["distribution"] if one["@type"] == "cr:FileObject"]
    assert {one["contentUrl"]: one["sha256"] for one in objects} == {
        path: digest for path, digest in files.items() if path.endswith(".parquet")
    }


def strings(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        value = [*value.values()]
    if isinstance(value, list):
        for each in value:
            yield from strings(each)
    elif isinstance(value, str):
        yield value


def test_documents_hold_the_texts_of_the_descriptor(release: Path) -> None:
    texts = {
        "title": "Drives", "description": "Matched drives.", "creators": ["A. Author", "An Institute"],
        "citation": "Author: Drives. 2026.", "doi": "10.5281/zenodo.1", "url": "https://example.org/drives",
        "keywords": ["branching"], "licence": "CC-BY-4.0", "dataset_version": "2.3.4",
    }  # fmt: skip
    descriptor = read_descriptor(Folder(release)).model_copy(update=texts)
    files = read_manifest(Folder(release))[0].files
    for made in (croissant(descriptor, files), zenodo(descriptor), codemeta(descriptor)):
        said = " ".join(strings(made))
        for text in ("Drives", "Matched drives.", "A. Author", "An Institute", "Author: Drives. 2026.", "2.3.4"):
            assert text in said
        for text in ("10.5281/zenodo.1", "https://example.org/drives", "branching"):
            assert text in said
        assert "cc-by-4.0" in said.lower()
    assert "https://spdx.org/licenses/CC-BY-4.0.html" in strings(croissant(descriptor, files))


def test_a_dataset_without_texts_leaves_them_out(release: Path) -> None:
    assert set(zenodo(read_descriptor(Folder(release)))) <= {
        "upload_type", "title", "description", "version", "creators", "license", "keywords",
    }  # fmt: skip
    assert "citeAs" not in document(release)


def test_the_same_dataset_has_the_same_bytes(release: Path) -> None:
    for form in ("croissant", "zenodo", "codemeta"):
        first, second = (call(run, "metadata", release, "--format", form) for _ in range(2))
        assert first == second
        assert first[0] == 0
    assert call(run, "metadata", release)[1].encode() == (release / "croissant.json").read_bytes()


def test_what_is_written_beside_a_dataset_is_no_finding(tmp_path: Path) -> None:
    root = release_draft().write(tmp_path / "dataset")
    before = validate(root, select=["BD-LAY"])
    for form in ("croissant", "zenodo", "codemeta"):
        assert call(run, "metadata", root, "--format", form, "--write")[0] == 0
    after = validate(root, select=["BD-LAY"])
    assert after.findings == before.findings == ()
    assert after.dataset.identity == before.dataset.identity
    assert after.dataset.num_beside == before.dataset.num_beside + 3


def test_a_damaged_manifest_is_one_line(release: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(release, tmp_path / "copy"))
    (root / "MANIFEST.sha256").write_text("nothing\n")
    code, out, err = call(run, "metadata", root)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "its manifest is damaged" in err
