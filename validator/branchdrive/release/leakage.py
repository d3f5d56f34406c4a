"""The leakage stage: the audit of the core-valid groups, part by part, so that an interrupted one goes on.

Finished parts lie on disk. They are believed only in a folder that this builder made, under a key of all that a part
depends on, and where they have the form of that part; anything else is computed again.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json
from branchdrive.contract.layout import LEAKAGE_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.resources import SPEC_VERSION, load_resource
from branchdrive.contract.schema_check import compiled_schema
from branchdrive.engine.raw_rows import REPLAYS
from branchdrive.errors import DatasetError, PlatformError
from branchdrive.formats.durable import delete, make_dir, replace_file
from branchdrive.formats.folder import Folder
from branchdrive.formats.image_codec import NO_DECODER, can_decode
from branchdrive.leakage.audit import Progress
from branchdrive.leakage.classifier import SequenceClassifier, Unavailable, sequence_classifier
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.protocol import AuditProtocol
from branchdrive.leakage.replays import collected_inputs, core_valid_homes
from branchdrive.leakage.streams import examined_cameras
from branchdrive.release.audit_process import AuditTask, audit_in_own_process
from branchdrive.release.scan import RawPart
from branchdrive.release.stage_work import StageWork
from branchdrive.runtime.executor import jobs_of
from branchdrive.runtime.ray_executor import RayExecutor

__all__ = ["StoredParts", "build_leakage"]

_SCHEMA = "leakage.schema.json"


def build_leakage(
    work: StageWork,
    area: Path,
    *,
    seed: int,
    protocol: AuditProtocol | None = None,
    classifier: SequenceClassifier | Unavailable | None = None,
    progress: Progress | None = None,
) -> None:
    """Audit what precedes the branch in the replays of the core-valid groups.

    Args:
        work: The raw layer, and canonical and quality layer.
        area: Working area of the build; finished parts wait there for a build that goes on.
        seed: Of everything random.
        protocol: Numbers of the audit; None is the default.
        classifier: Of the recurrent tests; None is the installed one, if there is any.
        progress: Called with parts done, parts in total, and the name of the next.

    Raises:
        PlatformError: There are images to examine, and nothing that decodes them.
        ToolError: The audit's process died.
    """
    scan = work.scan
    if examined_cameras(scan.descriptor) and not can_decode():
        raise PlatformError(NO_DECODER)
    homes = core_valid_homes(work.layers.rows("group_quality"))
    classifier = classifier or sequence_classifier()
    engine = work.executor.shared() if isinstance(work.executor, RayExecutor) else None
    inputs = SpooledReplays(scan.parts, homes, scan.descriptor)
    task = AuditTask(inputs, seed, protocol, classifier, jobs_of(work.executor), engine)
    document = audit_in_own_process(task, partial(StoredParts.of, area), progress)
    work.layers.put_document(LEAKAGE_FILE, document)


@dataclass(frozen=True)
class SpooledReplays:
    """Replays of core-valid groups that wait in a spool.

    Attributes:
        parts: Where they are.
        homes: Partition of each group.
        descriptor: Of the dataset.
    """

    parts: tuple[RawPart, ...]
    homes: Mapping[str, str]
    descriptor: Descriptor

    def __call__(self) -> ReplayInputs:
        """What the audit may see of them, in memory."""
        frames = (part.spool.get(f"{shard}.{REPLAYS}") for part in self.parts for shard in part.shards)
        return collected_inputs(frames, self.homes, self.descriptor)


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
            part = parse_json(Folder(self.folder).read(path.name, spec_limits().max_document_bytes))
        except (DatasetError, ValueError, RecursionError):
            return None
        if not _form("gate" if name == "gate" else "classifier")(part):
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
def _form(kind: str) -> Callable[[Any], bool]:
    """Whether a value is a part: the gate as the document has it, or what a classifier gives before it is judged."""
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
    return compiled_schema(forms[kind], _SCHEMA)
