"""Content of the derived layers of a folder, read from their files.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

from collections.abc import Collection

from branchdrive.contract.document import parse_json
from branchdrive.contract.identity import derived_content, document_digest
from branchdrive.contract.layer import table_file
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import read_table
from branchdrive.tables.content import table_digest

__all__ = ["file_content", "layers_content", "read_document"]


def layers_content(dataset: Store, paths: Collection[str]) -> dict[str, str]:
    """Digest of the content of each derived layer whose tables and documents are `paths`.

    Raises:
        DatasetError: A file is missing, cannot be read or does not have the declared columns.
    """
    return derived_content(file_content(dataset, paths), paths)


def file_content(dataset: Store, paths: Collection[str]) -> dict[str, str]:
    """Digest of what each of these tables and documents says, by path.

    Raises:
        DatasetError: As `layers_content`.
    """
    return {path: _digest(dataset, path) for path in sorted(paths)}


def _digest(dataset: Store, path: str) -> str:
    if (file := table_file(path)) is not None:
        return table_digest(file.table, read_table(dataset, path, file.table))
    return document_digest(read_document(dataset, path))


def read_document(dataset: Store, path: str) -> object:
    """A JSON document, whether or not it conforms to its schema.

    Raises:
        DatasetError: It cannot be read, or is no JSON within the limits.
    """
    try:
        return parse_json(dataset.read(path, spec_limits().max_document_bytes))
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{dataset}: {path!r}: {error}; run `branchdrive-validate`") from error
