"""Finished parts of a leakage audit on disk, for a build that goes on where another was interrupted.

What lies there is believed only in a folder that this builder made, under a key of all that a part depends on,
and where it has the form of that part; anything else is computed again.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

from branchdrive.contract.document import parse_json
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.resources import SPEC_VERSION, load_resource
from branchdrive.errors import DatasetError
from branchdrive.formats.durable import delete, make_dir, replace_file
from branchdrive.formats.untrusted import read_file

__all__ = ["StoredParts"]

_SCHEMA = "leakage.schema.json"


@dataclass(frozen=True)
class StoredParts:
    """Parts of one audit in a folder of their own.

    Attributes:
        folder: Where they lie, a file for each.
    """

    folder: Path

    @classmethod
    def of(cls, area: Path, audit_key: str) -> StoredParts:
        """Parts of the audit with this key in the working area of a build.

        The folder's name covers versions of program and specification, and the area itself: a copy of the area
        that came with a dataset has another inode, and nothing in it is believed.
        """
        depends = [audit_key, version("branchdrive"), SPEC_VERSION, area.stat().st_ino]
        key = hashlib.sha256(json.dumps(depends).encode()).hexdigest()
        folder = area / f"leakage-{key}"
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            folder.unlink()
        make_dir(folder)
        return cls(folder)

    def get(self, name: str) -> dict[str, Any] | None:
        """A part that is there and has its form."""
        path = self._path(name)
        try:
            part = parse_json(read_file(self.folder, path.name, spec_limits().max_document_bytes))
        except (DatasetError, ValueError, RecursionError):
            return None
        if not _form("gate" if name == "gate" else "classifier").is_valid(part):
            return None
        found: dict[str, Any] = part
        return found

    def put(self, name: str, part: dict[str, Any]) -> None:
        """Keep a part."""
        path = self._path(name)
        if not path.is_symlink() and path.is_dir():
            delete(path)
        replace_file(path, json.dumps(part, allow_nan=False).encode())

    def _path(self, name: str) -> Path:
        return self.folder / f"{name.replace('/', '-')}.json"


@cache
def _form(kind: str) -> Any:
    """Validator of a part: the gate as the document has it, or what a classifier gives before it is judged."""
    schema = load_resource(_SCHEMA)
    result = schema["$defs"]["test"]["properties"]
    forms = {
        "gate": schema["properties"]["gate"],
        "classifier": {
            "type": "object",
            "additionalProperties": False,
            "required": ["score", "training"],
            "properties": {"score": {"$ref": "#/$defs/score"}, "training": result["training"]},
        },
    }
    return Draft202012Validator({**forms[kind], "$defs": schema["$defs"]})
