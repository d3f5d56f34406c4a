"""Small valid datasets: what they are made of, and their files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.columns import LAYER_TABLES, TABLES
from branchdrive.contract.document import dump_json
from branchdrive.contract.encoding import ENCODING_NAME, ENCODING_WIDTH, encoding_digest
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.contract.policy import ACTUATORS
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import ContractError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import parts_of
from branchdrive.testing.drive import BRANCH_TICK, NUM_TICKS, InventedScene, plans
from branchdrive.testing.group import Tables, concat, make_group, to_table
from branchdrive.testing.media import (
    ARCHIVE_FILE,
    MEDIA_FILE,
    SURROUND,
    archived,
    frame_columns,
    media_bytes,
    media_document,
)
from branchdrive.testing.town import with_map

__all__ = ["SmallDataset", "descriptor", "seal_dataset", "show_call", "table_files", "write_dataset"]

_EVIDENCE, _MEDIA, _MAP = "actor_risk_evidence", SURROUND, "map"


@dataclass(frozen=True, repr=False)
class SmallDataset:
    """A valid raw dataset: every group drives the whole bank and two nominal replays.

    Attributes:
        scenes: Where each group drives, and among whom.
        bank: The bank.
        branch_tick: First active tick of interventions.
        num_ticks: Control rows of every attempt.
        groups_per_shard: Groups of each shard but for the last.
        streams: Optional streams beside the required ones: ``actor_risk_evidence``, then ``rgb_surround`` or ``map``.
    """

    scenes: tuple[InventedScene, ...]
    bank: ActionBank
    branch_tick: int = BRANCH_TICK
    num_ticks: int = NUM_TICKS
    groups_per_shard: int = 2
    streams: tuple[str, ...] = (_EVIDENCE,)

    def _shown(self) -> dict[str, Any]:
        """What a reader of an example wants to see."""
        policies = {policy.key: _orders(policy) for policy in self.bank.interventions}
        return {
            "scenes": self.scenes, "interventions": policies, "branch_tick": self.branch_tick,
            "num_ticks": self.num_ticks, "groups_per_shard": self.groups_per_shard, "streams": self.streams,
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"SmallDataset({', '.join(f'{name}={value!r}' for name, value in self._shown().items())})"

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:
        """Show an example over several lines; Hypothesis asks for it."""
        show_call(printer, "SmallDataset", self._shown())

    @property
    def tables(self) -> dict[str, Tables]:
        """Tables by shard folder and name; not to be changed."""
        return {folder: tables for folder, (tables, _) in self._shards.items()}

    @property
    def media(self) -> dict[str, Mapping[str, bytes]]:
        """Files of images by shard folder and name."""
        return {folder: media for folder, (_, media) in self._shards.items()}

    @cached_property
    def _shards(self) -> dict[str, tuple[Tables, Mapping[str, bytes]]]:
        starts = range(0, len(self.scenes), self.groups_per_shard)
        groups = (range(start, min(start + self.groups_per_shard, len(self.scenes))) for start in starts)
        return {f"raw/shard-{number:05d}": self._shard(of_shard) for number, of_shard in enumerate(groups)}

    def _shard(self, groups: range) -> tuple[Tables, Mapping[str, bytes]]:
        tables, media = concat([self._group(index) for index in groups]), {}
        if _MEDIA in self.streams:
            frames = to_table("frames", frame_columns(tables["rollouts"]))
            tables["frames"], media[ARCHIVE_FILE] = archived(frames)
        if _MAP in self.streams:
            tables = with_map(tables, [self.scenes[index].town for index in groups], dict(enumerate(self.scenes)))
        if _EVIDENCE not in self.streams:
            del tables["actors"], tables["evidence"]
        return tables, media

    def _group(self, index: int) -> Tables:
        planned = plans(index, self.bank, self.branch_tick)
        return make_group(index, self.scenes[index], planned, bank=self.bank, num_ticks=self.num_ticks)

    @property
    def descriptor(self) -> dict[str, Any]:
        """Descriptor document, a fresh copy."""
        document = descriptor(self.bank)
        required = [name for name in document["streams"] if name != _EVIDENCE]
        document["streams"] = [*required, *(name for name in self.streams if name != _MEDIA)]
        return media_document(document) if _MEDIA in self.streams else document

    def write(self, root: Path | str) -> Path:
        """Write the dataset with its manifest into the new folder `root`, which is returned."""
        write_dataset(Path(root), self.tables, self.descriptor, media=self.media)
        return Path(root)


def show_call(printer: Any, name: str, arguments: Mapping[str, Any]) -> None:
    """Print an example as a call with one argument a line, with a printer of Hypothesis."""
    with printer.group(4, f"{name}(", ")"):
        for argument, value in arguments.items():
            printer.break_()
            printer.text(f"{argument}=")
            printer.pretty(value)
            printer.text(",")


def _orders(policy: Any) -> str:
    """What a policy does to each actuator, in a line."""
    rules = ((actuator, getattr(policy, actuator)) for actuator in ACTUATORS)
    return ", ".join(f"{name} {r.rule}" + ("" if r.value is None else f" {r.value:g}") for name, r in rules)


def descriptor(bank: ActionBank | None = None) -> dict[str, Any]:
    """Descriptor document of a small dataset with actors and evidence, a fresh copy.

    An encoding is declared where the bank has one; `bank` is the reference bank by default.
    """
    bank = bank or load_action_bank()
    try:
        encoding = {"name": ENCODING_NAME, "width": ENCODING_WIDTH, "sha256": encoding_digest(bank)}
    except ContractError:  # the bank lies outside the domain of the encoding
        encoding = None
    return {
        "spec_version": SPEC_VERSION, "dataset_id": "generated", "dataset_version": "0.1.0",
        "title": "A generated dataset", "licence": "CC-BY-4.0",
        "simulator": {"name": "none", "version": "1.0"},
        "collector": {"name": "branchdrive.testing", "version": "1.0"},
        "streams": ["ego_route_state", "controls", "route_result", _EVIDENCE], "layers": ["raw"],
        "action_bank": bank.model_dump(mode="json"), "action_encoding": encoding,
        "collection": {"seed": 7, "replay_noise": {"kind": "natural"}},
    }  # fmt: skip


def table_files(name: str, table: pa.Table) -> dict[str, bytes]:
    """Parquet files of a table by name: one, or one for each partition."""
    parts = parts_of(name, table) if name in LAYER_TABLES else {TABLES[name].file_name: table}
    return {path.split("/")[-1]: encode_table(rows) for path, rows in parts.items()}


def write_dataset(
    root: Path,
    tables: Mapping[str, Tables],
    document: Mapping[str, Any],
    *,
    seal: bool = True,
    files: Callable[[str, pa.Table], Mapping[str, bytes]] | None = None,
    media: Mapping[str, Mapping[str, bytes]] | None = None,
) -> None:
    """Write shards, descriptor and, to seal it, the manifest into the folder `root`.

    Args:
        root: The folder.
        tables: Tables by folder and name.
        document: The descriptor.
        seal: Whether to write the manifest.
        files: Files of a table by name; those of `table_files` by default.
        media: Files of images by folder and name; the one that `frame_columns` names by default.
    """
    files = files or table_files
    root.mkdir(parents=True, exist_ok=True)
    (root / DESCRIPTOR_FILE).write_bytes(dump_json(document))
    for folder, shard in tables.items():
        (root / folder).mkdir(parents=True, exist_ok=True)
        for name, table in shard.items():
            for file_name, content in files(name, table).items():
                (root / folder / file_name).write_bytes(content)
        if "frames" in shard:
            images = {MEDIA_FILE: media_bytes(shard["frames"])} if media is None else media[folder]
            for file_name, content in images.items():
                (root / folder / file_name).write_bytes(content)
    if seal:
        seal_dataset(root)


def seal_dataset(root: Path) -> None:
    """Write the manifest of the files that are there."""
    (root / MANIFEST_FILE).write_bytes(build_manifest(Folder(root)).render())
