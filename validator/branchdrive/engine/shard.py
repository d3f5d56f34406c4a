"""Audit of one shard, from bytes to tallies and rows: the function that workers run.

Each file is read once; that buffer is hashed and decoded in full, so what was judged is what was digested.

Source: spec/07-rules.md#trust, spec/10-layers.md#derivation.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.media import MediaMode
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.engine.examine import VIEW_RULES, examine
from branchdrive.engine.spool import Spool
from branchdrive.engine.tally import Tallies, Tally
from branchdrive.errors import DatasetError, DecodeError, LimitError
from branchdrive.files.identities import Identities
from branchdrive.files.shard_facts import ShardFacts
from branchdrive.formats.store import Store, size_of
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.raw.content import group_content
from branchdrive.raw.funnel import Funnel
from branchdrive.raw.map_work import map_excess
from branchdrive.raw.media.image_eye import Look
from branchdrive.raw.media.images import Images
from branchdrive.raw.media.reading import read_media
from branchdrive.raw.motion.calibration import calibration
from branchdrive.raw.motion.extent import vehicle_widths
from branchdrive.raw.motion.lane_use import lane_use
from branchdrive.raw.motion.outline import outlines
from branchdrive.raw.motion.prevalence import broken_relations, num_in_contact, num_missing_attempts
from branchdrive.raw.motion.response import observed_extremes, responses, tracks
from branchdrive.raw.motion.sight import sights
from branchdrive.raw.motion.track_ends import track_ends
from branchdrive.raw.semantic.bodies import SemanticActors, SemanticPeople, SemanticVehicles
from branchdrive.raw.semantic.frame import SemanticFrames
from branchdrive.raw.semantic.ground import SemanticGround
from branchdrive.raw.semantic.signs import SemanticSigns
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import map_digests
from branchdrive.tables.schema import metadata_mismatches, trace_mismatches, type_mismatches

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["ShardResult", "ShardTask", "audit_shard", "spooled_name"]


@dataclass(frozen=True)
class ShardTask:
    """What a worker needs to audit one shard.

    Attributes:
        dataset: The dataset.
        folder: The shard's folder, relative to the root.
        files: Its regular files, relative to the root.
        descriptor: ``None`` where the dataset's descriptor is unusable: then rows cannot be judged.
        selected: Rules to run on rows.
        is_hashed: Whether to digest the files.
        spool: Where rows for the derived layers go; ``None`` where they need none.
        optional: Optional tables of the derived layers that rows are put for.
        media: How many images are decoded.
        repeated_rollouts: Its attempts whose identity occurs more than once in the dataset, once that is known.
        scattered_groups: Its groups that lie in other shards too, once that is known.
    """

    dataset: Store
    folder: str
    files: tuple[str, ...]
    descriptor: Descriptor | None
    selected: frozenset[str]
    is_hashed: bool
    spool: Spool | None = None
    optional: frozenset[str] = frozenset()
    media: MediaMode = "full"
    repeated_rollouts: frozenset[str] = frozenset()
    scattered_groups: frozenset[str] = frozenset()


@dataclass
class ShardResult(ShardFacts):
    """What became of one shard: small, so that it travels between processes.

    Attributes:
        tallies: Totals of the rules on its rows.
        left_out: Why its rows could not be judged; ``None`` if they could.
        funnel: How far its groups get.
        frames: Frames for the derived layers that are in the spool, under the name of the shard.
        no_frames: Why there are none.
        is_failed: Whether a rule failed on it, asked for or not.
    """

    tallies: Tallies = field(default_factory=lambda: Tallies.of({}))
    left_out: str | None = None
    funnel: Funnel = field(default_factory=Funnel)
    frames: tuple[str, ...] = ()
    no_frames: str = "the raw layer could not be read"
    is_failed: bool = False

    def leave_out(self, reason: str | None, selected: frozenset[str]) -> None:
        """Judge none of its rows, for a reason that every rule on rows then has."""
        self.left_out = reason
        self.tallies = Tallies.of({r: Tally(r, unjudged=reason) for r in VIEW_RULES if r in selected})


def spooled_name(folder: str) -> str:
    """Name of a shard in a spool."""
    return folder.replace("/", "-")


def audit_shard(task: ShardTask) -> ShardResult:
    """Read, hash, decode and judge one shard; whatever the files hold becomes part of the result."""
    result = ShardResult(task.folder)
    tables: dict[str, pa.Table] = {}
    # A claimed table lies right in the shard's folder; what lies deeper or is not claimed is hashed, never read.
    claimed = tuple(TABLES) if task.descriptor is None else task.descriptor.tables
    table_of = {f"{task.folder}/{TABLES[name].file_name}": name for name in claimed}
    for path in task.files:
        name = table_of.get(path)
        if name is None:
            continue
        result.num_tables += 1
        result.present = (*result.present, name)
        table = _read_table(task, path, name, result)
        if table is not None:
            result.rows[name] = table.num_rows
            wrong = result.type_mismatches[path] = list(type_mismatches(table.schema, name))
            result.metadata_mismatches[path] = [] if wrong else list(metadata_mismatches(table.schema, name))
            result.trace_mismatches[path] = list(trace_mismatches(table.schema))
            tables[name] = table
    view = _view(task, tables, result)
    images = _read_media(task, tables, view, [path for path in task.files if path not in table_of], result)
    tables.clear()  # the view holds what is needed of them
    if view is not None:
        view.images = images
        _judge(task, view, result)
    return result


def _read_media(
    task: ShardTask, tables: dict[str, pa.Table], view: ShardView | None, media: list[str], result: ShardResult
) -> Images | None:
    """Read what is no table, and say what the images show; ``None`` without an index that can be read."""
    frames = tables.get("frames")
    if frames is not None and result.type_mismatches[f"{task.folder}/{TABLES['frames'].file_name}"]:
        frames = None
    reading = read_media(
        task.dataset,
        task.folder,
        task.files,
        frames,
        {camera.name: camera for camera in task.descriptor.cameras} if task.descriptor else {},
        media=media,
        mode=task.media,
        is_hashed=task.is_hashed,
        looks=_looks(view),
    )
    result.digests |= reading.digests
    result.unreadable |= reading.unreadable
    result.over_limit |= reading.over_limit
    result.stored_code |= reading.stored_code
    result.num_images = reading.num_images
    result.media_mismatches, result.archive_mismatches = reading.mismatches, reading.archives
    return reading.images


def _looks(view: ShardView | None) -> dict[str, Look]:
    """What parts of semantic maps are compared with; nothing where the shard has none."""
    if view is None or "frames" not in view or SEMANTIC_STREAM not in view.descriptor.streams:
        return {}
    frames = SemanticFrames(view)
    actors = SemanticActors(frames)
    return {
        "vehicles": SemanticVehicles(actors),
        "people": SemanticPeople(actors),
        "ground": SemanticGround(frames),
        "signs": SemanticSigns(frames),
    }


def _read_table(task: ShardTask, path: str, name: str, result: ShardResult) -> pa.Table | None:
    max_bytes = spec_limits().max_table_bytes
    try:
        with task.dataset.open(path) as stream:
            content = stream.read(min(size_of(stream), max_bytes) + 1)
    except (DatasetError, OSError) as error:
        result.undecodable[path] = str(error)
        return None
    if task.is_hashed and len(content) <= max_bytes:
        result.digests[path] = hashlib.sha256(content).hexdigest()
    try:
        return decode_table(content, name)
    except LimitError as error:
        result.over_limit[path] = str(error)
    except DecodeError as error:
        result.undecodable[path] = str(error)
    _release_memory()
    return None


def _release_memory() -> None:
    """Give back what a failed decoding holds, so that the next file finds room under the memory limit."""
    import pyarrow as pa

    pa.default_memory_pool().release_unused()


def _view(task: ShardTask, tables: dict[str, pa.Table], result: ShardResult) -> ShardView | None:
    """The shard's rows; ``None`` where they cannot be judged."""
    reason = None
    if task.descriptor is None:
        reason = "the descriptor is unusable"
    elif missing := [name for name in task.descriptor.tables if name not in tables]:
        reason = f"{task.folder} has no readable {', '.join(missing)}"
    elif tables["rollouts"].num_rows > spec_limits().max_shard_rollouts:
        path, limit = f"{task.folder}/{TABLES['rollouts'].file_name}", spec_limits().max_shard_rollouts
        reason = f"{task.folder} has {tables['rollouts'].num_rows} rollouts; the limit is {limit}"
        result.over_limit[path] = reason
    elif any(result.type_mismatches.values()):
        reason = f"{task.folder} has tables with undeclared columns or types"
    if task.descriptor is None or reason is not None:
        result.leave_out(reason, task.selected)
        return None
    claimed = {name: tables[name] for name in task.descriptor.tables}
    return ShardView(claimed, task.descriptor, file_prefix=task.folder)


def _judge(task: ShardTask, view: ShardView, result: ShardResult) -> None:
    result.rollout_ids = Identities(rollout_id for rollout_id in view.rollout_ids if rollout_id)
    result.group_ids = Identities(group_id for group_id in view.group_ids if group_id)
    if task.is_hashed:
        result.groups = group_content(view)
    # What attempts comply with takes every rule, also where only some are asked for.
    tallies, examination = examine(
        view,
        None if task.spool else task.selected,
        repeated_rollouts=task.repeated_rollouts,
        scattered_groups=task.scattered_groups,
    )
    result.tallies = Tallies.of({rule_id: tally for rule_id, tally in tallies.items() if rule_id in task.selected})
    result.is_failed = any(tally.errors for tally in tallies.values())
    result.funnel = Funnel() if view.descriptor.is_of_drives else examination.funnel
    result.judged = {
        rule_id: (tally.num_findings, tally.examined)
        for rule_id, tally in tallies.items()
        if tally.info.scope == "rollout"
    }
    whole = view.complete & ~examination.broken
    result.judged |= broken_relations(view, whole)
    result.in_contact = num_in_contact(view, whole)
    result.num_missing_attempts = num_missing_attempts(view)
    interventions, result.responses = responses(view, examination.selection, examination.broken)
    result.tracks = tracks(view)
    result.sights = sights(view, interventions, result.responses)
    result.outlines = outlines(view, interventions)
    result.calibration = {
        name: values[whole & np.isfinite(values)].astype(np.float32)  # a value of each attempt waits in the parent
        for name, values in view.cached(calibration).items()
    }
    result.extremes = observed_extremes(view)
    result.track_ends = track_ends(view, examination.broken)
    result.widths, result.maps, result.lanes = vehicle_widths(view), map_digests(view), lane_use(view)
    if excess := map_excess(view):
        result.over_limit[f"{task.folder}/{TABLES['map'].file_name}"] = f"{task.folder} has a map that {excess}"
    result.scenario_types = frozenset(view.rollouts.categories("scenario_type")[1])
    if task.spool is None:
        return
    from branchdrive.engine.raw_rows import raw_rows_of  # what derived layers take, a raw dataset does without

    broken = [tally.rule_id for tally in tallies.values() if tally.num_findings and tally.info.decides]
    broken += ["BD-KEY-001"] * bool(task.repeated_rollouts) + ["BD-KEY-003"] * bool(task.scattered_groups)
    if broken:
        result.no_frames = f"the raw layer breaks {broken[0]}"
    elif result.is_failed:
        result.no_frames = "a rule on the raw layer failed"
    else:
        for name, frame in raw_rows_of(view, examination, task.optional).items():
            task.spool.put(f"{spooled_name(task.folder)}.{name}", frame)
            result.frames += (name,)
