"""Documents of a benchmark at work: the one that waits in the working area, else the published one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from branchdrive.contract.document import dump_json, parse_json, schema_violations
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.limits import spec_limits
from branchdrive.dataset.untrusted import read_named_file
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol, default_protocol, read_protocol
from branchdrive.errors import DatasetError, UsageError
from branchdrive_reference.benchmark.release import LAYER, Release
from branchdrive_reference.benchmark.workspace import PROTOCOL, Workspace

__all__ = ["choose_protocol", "protocol_file", "published_document", "stored_document"]


def choose_protocol(workspace: Workspace, file: Path | None) -> BenchmarkProtocol:
    """The protocol in `file`, else the one that waits or is published, else the default one; it waits from now on.

    Raises:
        UsageError: The file holds no protocol.
        DatasetError: The stored one cannot be read.
    """
    if file is not None:
        protocol = protocol_file(file)
    else:
        stored = stored_document(workspace, PROTOCOL)
        protocol = default_protocol() if stored is None else read_protocol(stored)
    if workspace.read(PROTOCOL) != dump_json(protocol.document):
        workspace.keep(PROTOCOL, dump_json(protocol.document))
    return protocol


def protocol_file(file: Path) -> BenchmarkProtocol:
    """The protocol in a file.

    Raises:
        UsageError: There is none.
    """
    try:
        return read_protocol(parse_json(read_named_file(file, spec_limits().max_document_bytes)))
    except (ValueError, RecursionError, DatasetError) as error:
        raise UsageError(f"{file}: {error}") from error


def stored_document(workspace: Workspace, path: str) -> Any | None:
    """A JSON document of the benchmark layer, waiting or published; ``None`` if there is none.

    Raises:
        DatasetError: It cannot be read.
    """
    content = workspace.read(path)
    if content is None:
        return None
    try:
        document = parse_json(content)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{workspace.release.root}: {path!r} {error}; delete it and lock anew") from error
    _check(workspace.release, path, document, "delete it and lock anew")
    return document


def published_document(release: Release, path: str) -> Any | None:
    """A published JSON document of the benchmark layer; ``None`` if there is none.

    Raises:
        DatasetError: It cannot be read, or is none of this version.
    """
    document = release.document(path)
    if document is not None:
        _check(release, path, document, "restore the file")
    return document


def _check(release: Release, path: str, document: Any, remedy: str) -> None:
    declared = LAYERS[LAYER].documents.get(path.removeprefix(f"{LAYER}/"))
    for violation in schema_violations(document, declared.schema) if declared is not None else ():
        raise DatasetError(
            f"{release.root}: {path!r} at {violation.pointer or '/'}: expected {violation.expected}; {remedy}"
        )
