"""A small valid dataset without a simulator: three branch groups in two shards, in numpy alone.

Every group drives the full bank and two nominal replays on its own route among actors of every
class; together they show closing and parting actors, an overlap, static objects inside and outside
the route corridor, and frames with nobody in range. What a rule recomputes is computed here from
the definitions, not with the functions of the rules, the risk evidence excepted.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
from tests.content_cache import kept
from tests.scenes import SCENES

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.resources import load_resource
from branchdrive.testing import dataset
from branchdrive.testing.dataset import seal_dataset, table_files
from branchdrive.testing.drive import (
    BRANCH_TICK,
    EGO_BOX_M,
    NUM_TICKS,
    STRIDE,
    WINDOW_TICKS,
    InventedScene,
    Plan,
    group_name,
    plans,
)
from branchdrive.testing.group import Tables, concat, evidence_columns, route_polyline, to_table
from branchdrive.testing.group import make_group as group_of
from branchdrive.testing.media import MEDIA_FILE, frame_columns, media_document

__all__ = [
    "BRANCH_TICK", "EGO_BOX_M", "MEDIA_FILE", "NUM_TICKS", "SHARDS", "STRIDE", "WINDOW_TICKS", "Plan",
    "Tables", "bare_descriptor", "bare_tables", "base_tables", "concat", "descriptor", "drives_descriptor",
    "drives_tables", "evidence_columns", "group_name", "make_group", "media_descriptor", "media_tables", "plans",
    "route_polyline", "seal_dataset", "shared", "to_table", "with_few_attempts", "write_dataset",
]  # fmt: skip

SHARDS = {"raw/shard-00000": (0, 1), "raw/shard-00001": (2,)}
"""Groups of each shard."""


def make_group(
    index: int,
    planned: Sequence[Plan] | None = None,
    *,
    scene: InventedScene | None = None,
    bank: ActionBank | None = None,
    num_ticks: int = NUM_TICKS,
) -> Tables:
    """Tables of one branch group, without media; in the scene of its number by default."""
    return group_of(index, scene or SCENES[index], planned, bank=bank, num_ticks=num_ticks)


@cache
def base_tables() -> dict[str, Tables]:
    """Tables of the valid dataset by shard folder; shared by all callers, so never changed in place."""

    def build() -> dict[str, Tables]:
        return {folder: concat([make_group(index) for index in groups]) for folder, groups in SHARDS.items()}

    return shared(kept("base-tables", build))


def descriptor() -> dict[str, Any]:
    """Descriptor document of the valid dataset, a fresh copy."""
    named = {"dataset_id": "synthetic", "title": "A small valid dataset"}
    bank = copy.deepcopy(load_resource("action-bank.json"))
    return {**dataset.descriptor(), **named, "collector": {"name": "tests", "version": "1.0"}, "action_bank": bank}


@cache
def media_tables() -> dict[str, Tables]:
    """`base_tables` with an index of images: the six views of every attempt in the whole window."""
    return shared({folder: {**tables, "frames": _frames(tables)} for folder, tables in base_tables().items()})


def _frames(tables: Tables) -> pa.Table:
    return to_table("frames", frame_columns(tables["rollouts"]))


def media_descriptor() -> dict[str, Any]:
    """Descriptor document of `media_tables`."""
    return media_document(descriptor())


_DRIVES = (
    Plan("nominal", "nominal"),
    Plan("drive", "nominal"),
    Plan("drive", "brake_0.50"),
    Plan("drive", "steer_left_0.10", later=((BRANCH_TICK + 25, "steer_right_0.10"), (BRANCH_TICK + 60, "nominal"))),
    Plan("drive", "accelerate_0.50", later=((BRANCH_TICK + 50, "steer_left_0.05"),)),
)
"""Attempts of every group of drives: no intervention, one, and several before and after the window before is over."""


@cache
def drives_tables() -> dict[str, Tables]:
    """Tables of a valid dataset of drives, in the places of `base_tables`."""

    def build() -> dict[str, Tables]:
        return {folder: concat([make_group(g, _DRIVES) for g in groups]) for folder, groups in SHARDS.items()}

    return shared(kept("drives-tables", build))


def drives_descriptor() -> dict[str, Any]:
    """Descriptor document of `drives_tables`."""
    document = descriptor()
    return {**document, "streams": [*document["streams"], "decisions"]}


def bare_tables() -> dict[str, Tables]:
    """`base_tables` without the stream of actors and risk evidence."""
    return {
        folder: {name: tables[name] for name in ("rollouts", "controls", "observations")}
        for folder, tables in base_tables().items()
    }


def bare_descriptor() -> dict[str, Any]:
    """Descriptor document of `bare_tables`."""
    document = descriptor()
    return {**document, "streams": [name for name in document["streams"] if name != "actor_risk_evidence"]}


FEW_ACTIONS = ("nominal", "brake_0.50", "steer_left_0.10")
"""Actions of `with_few_attempts`."""


def with_few_attempts(tables: Mapping[str, Tables]) -> dict[str, Tables]:
    """The same shards with a nominal pass, its replays and two interventions of every group.

    For tests that read, copy or judge a whole dataset many times and ask nothing of its number of attempts.
    """

    def few(shard: Tables) -> Tables:
        attempts = shard["rollouts"]
        kept = attempts.filter(pc.is_in(attempts["action_key"].cast(pa.string()), pa.array(FEW_ACTIONS)))
        ids = kept["rollout_id"].cast(pa.string()).combine_chunks()
        return {
            name: rows.filter(pc.is_in(rows["rollout_id"].cast(pa.string()), ids))
            if "rollout_id" in rows.column_names
            else rows
            for name, rows in shard.items()
        }

    return shared({folder: few(shard) for folder, shard in tables.items()})


_shared: dict[int, tuple[pa.Table, dict[str, bytes]]] = {}
"""Tables that many datasets hold, with the bytes of their files once they are known."""


def shared(tables: dict[str, Tables]) -> dict[str, Tables]:
    """The same tables, whose bytes will be computed once; they live as long as the process."""
    _shared.update({id(table): (table, {}) for shard in tables.values() for table in shard.values()})
    return tables


def _files(name: str, table: pa.Table) -> dict[str, bytes]:
    """Files of a table by name; those of the shared tables are computed once."""
    _, known = _shared.get(id(table), (table, {}))
    if not known:
        known.update(table_files(name, table))
    return known


def write_dataset(root: Path, tables: Mapping[str, Tables], document: Mapping[str, Any], *, seal: bool = True) -> None:
    """Write shards, descriptor and, to seal it, the manifest into the folder `root`."""
    dataset.write_dataset(root, tables, document, seal=seal, files=_files)
