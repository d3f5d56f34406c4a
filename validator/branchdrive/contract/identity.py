"""Identity of data by what they say: digests of documents and layers over decoded content, for any writer.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from typing import Any

from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import IDENTITY_LAYERS

__all__ = ["claimed_files", "content_identity", "derived_content", "document_digest", "layer_content"]


def document_digest(document: Any) -> str:
    """SHA-256 of a JSON document as it is parsed; order of members, blanks and forms of numbers leave it alone.

    >>> document_digest({"a": 1.0, "b": []}) == document_digest({"b": [], "a": 1})
    True
    """
    try:
        return hashlib.sha256(_SPELLED[type(document)](document).encode()).hexdigest()
    finally:
        _keys.cache_clear()  # what a document calls its members is not kept longer than the document


def _text(value: str) -> str:
    return f"s{len(value) if value.isascii() else len(value.encode())}:{value}"


def _number(value: float) -> str:
    return f"i{int(value)};" if value.is_integer() else f"d{value.hex()};"


def _array(value: list[Any]) -> str:
    return f"a{len(value)}:" + "".join([_SPELLED[type(item)](item) for item in value])


def _object(value: dict[str, Any]) -> str:
    spelled = [f"o{len(value)}:"]
    for key, text in _keys(tuple(value)):
        item = value[key]
        spelled += text, _SPELLED[type(item)](item)
    return "".join(spelled)


@lru_cache(1024)
def _keys(keys: tuple[str, ...]) -> list[tuple[str, str]]:
    """Keys with what spells them, by their code points, which is the order of their bytes too."""
    return [(key, _text(key)) for key in sorted(keys)]


_SPELLED: dict[type, Callable[[Any], str]] = {
    type(None): lambda _: "n",
    bool: lambda value: "t" if value else "f",
    int: "i{};".format,
    float: _number,
    str: _text,
    list: _array,
    dict: _object,
}
"""What is digested of a value of JSON, by its type: one text for the whole document, encoded at the end."""


def layer_content(parts: Mapping[str, str]) -> str:
    """Digest of a layer from those of its parts by name: groups and maps of the raw one, else tables and documents."""
    lines = (f"{name} {parts[name]}\n" for name in sorted(parts, key=str.encode))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def claimed_files(claimed: Collection[str], there: Collection[str]) -> frozenset[str]:
    """Paths of the tables and documents of the claimed derived layers: those that must be there, and those that are."""
    layers = [layer for name, layer in LAYERS.items() if name in claimed and name in IDENTITY_LAYERS]
    files = (path for layer in layers for path in layer.files if path in layer.required_files or path in there)
    return frozenset(files)


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
