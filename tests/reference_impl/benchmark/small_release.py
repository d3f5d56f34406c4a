"""A detached release with groups enough for every partition, a protocol of small models, and commands run in a test."""

from __future__ import annotations

import argparse
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from tests.model_release import CANDIDATES, make_frames, write_release
from tests.reference_impl.learning.small_models import MEAN, small
from tests.validator.benchmark.samples import paper_protocol

from branchdrive.contract.layout import STAGING_DIR
from branchdrive.driving.target import TARGETS
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.model.arrays import pack_arrays
from branchdrive.model.features import target_mask
from branchdrive.model.normalisation_document import normalisation_document
from branchdrive_reference.benchmark.command import benchmark, curve, evaluate, export, latency, lock, predict, train

__all__ = [
    "ASSIGNMENT", "COMMANDS", "contents", "invoke", "invoke_both", "is_clean", "make_release", "protocol",
    "smallest_protocol", "write_protocol",
]  # fmt: skip

_SIZES = {"train": 12, "val": 3, "calibration": 4, "test": 4}
ASSIGNMENT = {f"{name}{i:02}": name for name, size in _SIZES.items() for i in range(size)}

COMMANDS: dict[str, Any] = {
    "train": train, "lock": lock, "predict": predict, "evaluate": evaluate, "benchmark": benchmark, "export": export,
    "latency": latency, "curve": curve,
}  # fmt: skip


def make_release(root: Path, seed: int = 0) -> Path:
    """The files of a release with its manifest."""
    frames = make_frames(seed, assignment=ASSIGNMENT)
    for target in TARGETS:  # a bank without all separations is neither ranked nor guarded
        values = np.ma.getdata(frames["scalars"][target.name])
        frames["scalars"][target.name] = np.ma.masked_array(values, np.zeros(values.shape, bool))
        frames["scalars"][target_mask(target.name)] = np.ones(values.shape, bool)
    arrays = pack_arrays(frames, sorted(ASSIGNMENT), CANDIDATES)
    write_release(root, frames, normalisation=normalisation_document(arrays, ASSIGNMENT))
    write_manifest(Folder(root), build_manifest(Folder(root)))
    return root


def protocol(**training: Any) -> dict[str, Any]:
    """The models of the paper, but small, and few draws; `training` replaces attributes of the training."""
    document = json.loads(json.dumps(paper_protocol()))
    for model in document["models"]:
        found = MEAN if model["id"] == "M0" else small(model["id"], **{"max_epochs": 2, **training})
        model["configuration"] = found.record
        model["seeds"] = model["seeds"][:2]
    document["statistics"] |= {"resamples": 100, "flips": 100}
    document["shuffles"]["seeds"] = [0, 1]
    return document


def smallest_protocol(**training: Any) -> dict[str, Any]:
    """The same with a model that is a mean, and one that is learned, with one seed; and with one profile."""
    document = protocol(**training)
    mean, *_, learned = document["models"]
    document["models"] = [mean, {**learned, "seeds": learned["seeds"][:1]}]
    document["profiles"] = document["profiles"][:1]
    kept = {None, document["profiles"][0]["name"]}
    for family in document["families"]:
        family["members"] = [member for member in family["members"] if member.get("profile") in kept]
    document["families"] = [family for family in document["families"] if family["members"]]
    return document


def write_protocol(path: Path, document: dict[str, Any]) -> Path:
    """The new file `path` with a protocol."""
    path.write_text(json.dumps(document))
    return path


def invoke(command: str, *arguments: str | Path) -> str:
    """What a command prints; errors are raised as they are."""
    return invoke_both(command, *arguments)[0]


def invoke_both(command: str, *arguments: str | Path) -> tuple[str, str]:
    """The same, and what it writes to stderr, which is no terminal."""
    module, stdout, stderr = COMMANDS[command], io.StringIO(), io.StringIO()
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    assert module.run(parser.parse_args([str(one) for one in arguments]), stdout, stderr) == 0
    return stdout.getvalue(), stderr.getvalue()


def contents(root: Path) -> dict[str, bytes]:
    """Bytes of every file below `root`, by path."""
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def is_clean(root: Path) -> bool:
    """Whether the release is whole: no working area, and every file as the manifest has it."""
    return (
        not (root / STAGING_DIR).exists()
        and build_manifest(Folder(root)).render() == (root / "MANIFEST.sha256").read_bytes()
    )
