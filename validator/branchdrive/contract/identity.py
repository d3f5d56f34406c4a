"""Identity of data by what they say: digests of documents and layers over decoded content, for any writer.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import IDENTITY_LAYERS

__all__ = ["claimed_files", "content_identity", "derived_content", "document_digest", "layer_content"]


def document_digest(document: Any) -> str:
    """SHA-256 of a JSON document as it is parsed; order of members, blanks and forms of numbers leave it alone.

    >>> document_digest({"a": 1.0, "b": []}) == document_digest({"b": [], "a": 1})
    True
    """
    return hashlib.sha256(b"".join(_encoded(document))).hexdigest()


def _encoded(value: Any) -> Iterator[bytes]:
    if value is None or isinstance(value, bool):
        yield {None: b"n", True: b"t", False: b"f"}[value]
    elif isinstance(value, int) or (isinstance(value, float) and value.is_integer()):
        yield b"i%d;" % int(value)
    elif isinstance(value, float):
        yield b"d" + value.hex().encode() + b";"
    elif isinstance(value, str):
        text = value.encode()
        yield b"s%d:" % len(text) + text
    elif isinstance(value, list):
        yield b"a%d:" % len(value)
        for item in value:
            yield from _encoded(item)
    else:
        yield b"o%d:" % len(value)
        for key in sorted(value, key=str.encode):
            yield from _encoded(key)
            yield from _encoded(value[key])


def layer_content(parts: Mapping[str, str]) -> str:
    """Digest of a layer from those of its parts by name: groups and maps of the raw one, else tables and documents."""
    lines = (f"{name} {parts[name]}\n" for name in sorted(parts, key=str.encode))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def claimed_files(claimed: Collection[str], there: Collection[str]) -> frozenset[str]:
    """Paths of the tables and documents of the claimed derived layers: those that must be there, and those that are."""
    layers = [layer for name, layer in LAYERS.items() if name in claimed and name in IDENTITY_LAYERS]
    return frozenset(path for layer in layers for path in (*layer.missing(there), *layer.own(there)))


def derived_content(files: Mapping[str, str], paths: Collection[str]) -> dict[str, str]:
    """Digest of the content of each derived layer, from those of its tables and documents by path.

    Args:
        files: Digest of what each file says.
        paths: Files of the layers; a layer of which one has no digest has none either.
    """
    parts: dict[str, dict[str, str | None]] = {}
    for path in paths:
        parts.setdefault(path.split("/")[0], {})[path] = files.get(path)
    known = {name: {path: digest for path, digest in own.items() if digest} for name, own in parts.items()}
    return {name: layer_content(own) for name, own in known.items() if len(own) == len(parts[name])}


def content_identity(layers: Mapping[str, str], claimed: Collection[str]) -> str | None:
    """Identity of the content of a dataset; ``None`` where that of a layer is not known.

    Args:
        layers: Digest of the content of each layer.
        claimed: Layers that count; without the raw one, a release has one identity in place and detached.
    """
    names = [name for name in IDENTITY_LAYERS if name in claimed]
    if not names or not set(names) <= layers.keys():
        return None
    return hashlib.sha256("".join(f"layer {name} {layers[name]}\n" for name in names).encode()).hexdigest()
