"""How far outcomes move when nominal is repeated: targets of the nominal replays of training groups.

Replays stand in the raw layer alone; which of them comply, the quality layer says. Where no raw layer is available,
or no training group has a replay with a whole window after its branch, the noise is unknown.

Source: this project's choice, see `branchdrive.benchmark.ranking.noise`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.ranking.noise import OutcomeNoise, outcome_noise
from branchdrive.driving.target import Targets
from branchdrive.formats.table_file import read_layer_table
from branchdrive.model.targets import targets_of
from branchdrive.raw.shard import find_shards
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.arrow import from_arrow
from branchdrive.tables.frame import Frame
from branchdrive_reference.benchmark.release import Release

__all__ = ["noise_of"]

_TABLES = ("rollouts", "observations", "evidence")


def noise_of(
    release: Release, data: BenchmarkData, *, tolerance_m: float, further_m: Sequence[float] = ()
) -> OutcomeNoise | None:
    """Noise from nominal replays of training groups; ``None`` where there are none to read.

    A group without a replay of its own takes no part, whatever others have.

    Args:
        release: With its raw layer.
        data: Its model layer.
        tolerance_m: Of a violation of the guard, metres.
        further_m: Further tolerances.

    Raises:
        DatasetError: A file cannot be read.
    """
    if not release.has_raw:
        return None
    part = data.part("train")
    owner = _replays(release, {group: row for row, group in enumerate(part.groups)})
    values, available, group_of = [], [], list[int]()
    for shard in find_shards(release.layer.folder):
        rollout_ids = shard.table("rollouts")["rollout_id"].to_pylist()
        rows = np.array([row for row, rollout in enumerate(rollout_ids) if rollout in owner], np.int64)
        if not len(rows):
            continue
        names = [name for name in _TABLES if name in release.layer.descriptor.tables]
        view = ShardView({name: shard.decode(name) for name in names}, release.layer.descriptor)
        targets = targets_of(view, rows)
        values.append(targets.values)
        available.append(targets.available)
        group_of += [owner[rollout_ids[row]] for row in rows]
    if not group_of:
        return None
    nominal = part.targets
    return outcome_noise(
        Targets(nominal.values[:, data.nominal], nominal.available[:, data.nominal]),
        Targets(np.concatenate(values), np.concatenate(available)),
        np.array(group_of, np.intp),
        tolerance_m=tolerance_m,
        further_m=further_m,
    )


def _replays(release: Release, groups: dict[str, int]) -> dict[str, int]:
    """Compliant nominal replays with whole windows after the branch, with the place of their group."""
    pairs, attempts = (_frame(release, name) for name in ("pairs", "attempt_quality"))
    whole = np.asarray(attempts["compliant"], bool) & np.asarray(attempts["has_branch"], bool)
    for name in ("missing_future_observations", "missing_evidence"):
        whole &= np.ma.filled(np.ma.asarray(attempts[name]), 1) == 0
    usable = set(attempts["rollout_id"][whole].tolist())
    rows = zip(pairs["kind"].tolist(), pairs["rollout_id"].tolist(), pairs["group_id"].tolist(), strict=True)
    return {
        rollout: groups[group]
        for kind, rollout, group in rows
        if kind == "nominal_replay" and group in groups and rollout in usable
    }


def _frame(release: Release, name: str) -> Frame:
    return from_arrow(read_layer_table(release.layer.folder, name), name)
