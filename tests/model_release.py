"""A small detached release by hand: frames of the model layer from random numbers, and its files.

Only what readers of the model layer need is written; no raw layer and no manifest.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tests.synthetic import bare_descriptor, descriptor

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json
from branchdrive.contract.encoding import encode_bank
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import parts_of
from branchdrive.model.arrays import ModelArrays, pack_arrays
from branchdrive.model.features import HISTORIES, features_document
from branchdrive.model.normalisation_document import normalisation_document
from branchdrive.quality.variants import Variant, variants_document
from branchdrive.tables.arrow import to_arrow
from branchdrive.tables.frame import Values, num_rows, take

__all__ = [
    "ASSIGNMENT", "CANDIDATES", "DESCRIPTOR", "GROUPS", "OUTSIDER", "Frames", "make_arrays", "make_frames",
    "shuffled", "write_release",
]  # fmt: skip

Frames = dict[str, dict[str, Values]]

GROUPS = ("g1", "g2", "g3", "g4", "g5")
OUTSIDER = "g0"
"""A group with a partition that is not in the frozen population."""

ASSIGNMENT = {"g0": "train", "g1": "train", "g2": "train", "g3": "val", "g4": "test", "g5": "train"}
EXTENDED = ("g1", "g4")

LAYERS = ["canonical", "quality", "model"]
DESCRIPTOR = Descriptor.model_validate({**descriptor(), "layers": LAYERS})
BARE = Descriptor.model_validate({**bare_descriptor(), "layers": LAYERS, "action_encoding": None})
"""Without evidence and without an encoding."""

CANDIDATES = DESCRIPTOR.action_bank.keys


def make_frames(seed: int = 0, *, bare: bool = False, assignment: Mapping[str, str] = ASSIGNMENT) -> Frames:
    """Frames of the tables of the model layer and of `group_quality`, rows in the order of their keys.

    There are objects at all observations but the first three, none where it is bare.

    Groups are those of `assignment`, which gives their partitions; `OUTSIDER` is not in the model layer.
    """
    members = tuple(group_id for group_id in assignment if group_id != OUTSIDER)
    rng = np.random.default_rng(seed)
    frames: Frames = {}
    steps = range(1, 11)
    for name, history in HISTORIES.items():
        groups = () if bare and name == "surroundings" else members
        frames[name] = _filled(name, rng, {"group_id": groups, "offset_ticks": history.offsets})
    keys = {"group_id": members, "action_key": CANDIDATES}
    frames["candidates"] = _filled("candidates", rng, keys)
    frames["scalars"] = _filled("scalars", rng, keys)
    frames["trajectories"] = _filled("trajectories", rng, {**keys, "step": steps})
    frames["actions"] = _filled("actions", rng, {"action_key": CANDIDATES})
    vectors = np.empty(len(CANDIDATES), object)
    for i, vector in enumerate(encode_bank(DESCRIPTOR.action_bank)):
        vectors[i] = np.zeros(0) if bare else vector.astype(np.float64)
    frames["actions"]["encoding"] = np.ma.masked_array(vectors, np.full(len(vectors), bare))
    frames["actions"]["encoded"] = np.full(len(vectors), not bare)
    frames["contexts"] = {
        **_filled("contexts", rng, {"group_id": members}),
        "extended_valid": np.isin(members, EXTENDED),
    }
    for name, frame in frames.items():
        if LAYER_TABLES[name].partitions:
            frame["partition"] = np.array([assignment[group_id] for group_id in frame["group_id"].tolist()], object)
    quality = _filled("group_quality", rng, {"group_id": tuple(assignment)})
    names = np.array(list(assignment), object)
    quality["core_valid"] = names != OUTSIDER
    quality["extended_valid"] = np.isin(names, EXTENDED)
    quality["near_duplicate"] = np.zeros(len(names), bool)
    frames["group_quality"] = quality
    if not bare:
        keys = {"group_id": members, "offset_ticks": HISTORY_OFFSETS[3:], "object_index": (0, 7, 9)}
        objects = _filled("objects", rng, keys)
        objects["partition"] = np.array([assignment[group_id] for group_id in objects["group_id"].tolist()], object)
        frames["objects"] = take(objects, rng.random(num_rows(objects)) < 0.8)
    return frames


def _filled(name: str, rng: np.random.Generator, axes: dict[str, Any]) -> dict[str, Values]:
    """One row for each key, every other column recorded, at random in its range; nulls where the mask says so."""
    grid = np.meshgrid(*(np.arange(len(labels)) for labels in axes.values()), indexing="ij")
    frame: dict[str, Values] = {}
    for places, (column, labels) in zip(grid, axes.items(), strict=True):
        kind = object if LAYER_TABLES[name][column].type == "string" else np.int32
        frame[column] = np.array(list(labels), kind)[places.ravel()]
    size = len(next(iter(frame.values())))
    for declared in LAYER_TABLES[name].columns:
        if declared.name in frame:
            continue
        if declared.type == "string":
            words = np.array(declared.values or ("word",), object)
            values: Values = words[rng.integers(0, len(words), size)]
        elif declared.type == "bool":
            values = rng.random(size) < 0.7
        elif declared.type == "list<float64>":
            values = np.full(size, None, object)
        else:
            low, high = max(declared.min or 0.0, -50.0), min(50.0 if declared.max is None else declared.max, 50.0)
            values = rng.uniform(low, high, size).astype(declared.type)
        frame[declared.name] = values
    for declared in LAYER_TABLES[name].columns:
        if declared.available is not None and declared.available.mask is not None:
            frame[declared.name] = np.ma.masked_array(frame[declared.name], ~frame[str(declared.available.mask)])
    return frame


def make_arrays(frames: Frames) -> ModelArrays:
    """Arrays in the order of `GROUPS` and `CANDIDATES`."""
    return pack_arrays(frames, GROUPS, CANDIDATES)


def shuffled(frames: Frames, seed: int) -> Frames:
    """The same rows of every table in another order."""
    rng = np.random.default_rng(seed)
    return {name: take(frame, rng.permutation(num_rows(frame))) for name, frame in frames.items()}


def write_release(
    root: Path, frames: Frames, *, bare: bool = False, variants: tuple[Variant, ...] = (), **documents: Any
) -> Path:
    """Files of a release in the new folder `root`; `documents` replace ``features`` and ``normalisation``."""
    about = BARE if bare else DESCRIPTOR
    for layer in LAYERS:
        (root / layer).mkdir(parents=True)
    files = {"branchdrive.json": dump_json(about.model_dump(mode="json"))}
    for name, frame in frames.items():
        rows = parts_of(name, to_arrow(name, frame))
        files.update({path: encode_table(part) for path, part in rows.items()})
    if "normalisation" not in documents:
        documents["normalisation"] = normalisation_document(make_arrays(frames), ASSIGNMENT)
    documents = {"features": features_document(about), **documents}
    for name, document in documents.items():
        files[f"model/{name}.json"] = dump_json(document)
    files["quality/variants.json"] = dump_json(variants_document(frames["group_quality"], variants))
    for path, content in files.items():
        (root / path).write_bytes(content)
    return root
