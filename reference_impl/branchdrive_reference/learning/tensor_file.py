"""Files of tensors with one document: safetensors, whole or refused, and the same bytes for the same content.

The document stands in the metadata of the file as canonical JSON, beside a digest over it and every tensor's name,
type, shape and bytes. Files are untrusted: they are bounded, hold no code, and what the digest does not confirm is
refused. The digest finds damage; who wants to know that a file is the one that was locked compares its SHA-256.

Source: safetensors format; limits are this project's choice.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.text import printable
from branchdrive.errors import DatasetError
from branchdrive.formats.durable import replace_file
from branchdrive.formats.folder import Folder
from branchdrive.formats.store import Store
from branchdrive.runtime.environment import install_command

try:
    import safetensors
    import safetensors.torch
    import torch
    from torch import Tensor
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"`branchdrive_reference.learning` needs the package {error.name!r}: {install_command('models')}",
        name=error.name,
    ) from error

__all__ = ["TensorFile", "read_tensors", "write_tensors"]

MAX_BYTES = 256 * 1024 * 1024
"""Size of the largest file that is read."""

_KEY = "branchdrive"
_LENGTH_BYTES = 8


class TensorFile(NamedTuple):
    """Content of a file.

    Attributes:
        document: JSON data.
        tensors: By name, in the order of names.
        sha256: Of the whole file, hexadecimal.
    """

    document: dict[str, Any]
    tensors: dict[str, Tensor]
    sha256: str


def write_tensors(path: Path, document: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Create or replace a file at once and durably."""
    kept = {name: values.detach().cpu().contiguous() for name, values in tensors.items()}
    about = dump_json({"document": document, "digest": _digest(document, kept)}).decode()
    replace_file(path, safetensors.torch.save(kept, {_KEY: about}))


def read_tensors(path: Path, store: Store | None = None) -> TensorFile:
    """Content of a file.

    Args:
        path: Where it is.
        store: The place that the path is relative to; this machine by default.

    Raises:
        DatasetError: There is no such file, it is too large, no file of this kind, or it was damaged.
    """
    place, name = (Folder(path.parent), path.name) if store is None else (store, path.as_posix())
    content = place.read(name, MAX_BYTES)
    try:
        about = _about(content)
        loaded = safetensors.torch.load(content)  # in an order of its own, another one in every process
        tensors = {name: _own(loaded[name]) for name in sorted(loaded)}
        document = about["document"]
        is_whole = isinstance(document, dict) and about == {
            "document": document,
            "digest": _digest(document, tensors),
        }
    except (LookupError, TypeError, ValueError, RuntimeError, safetensors.SafetensorError) as error:
        raise DatasetError(f"{path}: not a tensor file of BranchDrive ({_line(error)})") from error
    if not is_whole:
        raise DatasetError(f"{path}: its content was changed after it was written; make it again")
    return TensorFile(document, tensors, hashlib.sha256(content).hexdigest())


def _own(values: Tensor) -> Tensor:
    """A copy in memory of torch; its own copying would wake all threads for each tensor."""
    kept = torch.empty_like(values)
    kept.numpy()[...] = values.numpy()
    return kept


def _about(content: bytes) -> Any:
    size = int.from_bytes(content[:_LENGTH_BYTES], "little")
    metadata = parse_json(content[_LENGTH_BYTES : _LENGTH_BYTES + size])["__metadata__"]
    if list(metadata) != [_KEY]:
        raise ValueError(f"its metadata are not `{_KEY}` alone")
    if not isinstance(metadata[_KEY], str):
        raise TypeError(f"`{_KEY}` is no text")
    return parse_json(metadata[_KEY].encode())


def _digest(document: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256(dump_json(document))
    for name in sorted(tensors):
        values = tensors[name]
        digest.update(f"\n{name} {values.dtype} {list(values.shape)}\n".encode())
        digest.update(values.numpy().tobytes())
    return digest.hexdigest()


def _line(error: Exception) -> str:
    return f"{type(error).__name__}: {printable(str(error)[:120])}"
