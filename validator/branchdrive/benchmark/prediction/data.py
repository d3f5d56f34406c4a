"""What a benchmark is judged on: groups, clusters and outcomes of every partition of a model layer.

Groups of a partition are in the order of their ids, candidates in that of the bank, whatever the order of rows in
the tables of the layer.

Source: spec/14-benchmark.md#data.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from branchdrive.benchmark.prediction.metric.ending import EVENTS, Endings
from branchdrive.benchmark.prediction.metric.outcome import Outcomes
from branchdrive.contract.bank import ActionBank
from branchdrive.driving.target import Targets
from branchdrive.errors import DatasetError
from branchdrive.model.arrays import pack_column, pack_scalars, pack_trajectories
from branchdrive.tables.frame import Frame, concat

__all__ = ["ENDINGS", "TABLES", "BenchmarkData", "Part", "groups_digest"]

TABLES = ("contexts", "scalars", "trajectories")
"""Tables of the model layer that a benchmark reads."""

ENDINGS = "endings"
"""Table that it reads too where the layer has it."""

BRAKE = "brake"
"""Family of the candidates among which the fixed brake is chosen."""


@dataclass(frozen=True, eq=False)
class Part:
    """One partition.

    Attributes:
        groups: Ids of its groups, sorted, ``[N]``.
        clusters: Route cluster of every group, ``[N]``.
        outcomes: What was recorded.
        endings: What was recorded of whole drives; ``None`` where the layer does without.
    """

    groups: tuple[str, ...]
    clusters: tuple[str, ...]
    outcomes: Outcomes
    endings: Endings | None = None

    @cached_property
    def targets(self) -> Targets:
        """Scalar outcomes ``[N, A, 6]`` with NaN where not available."""
        found = self.outcomes
        return Targets(np.where(found.available, found.scalars, np.nan), found.available)

    def __repr__(self) -> str:
        return f"Part({len(self.groups)} groups, {len(set(self.clusters))} clusters)"


@dataclass(frozen=True, eq=False)
class BenchmarkData:
    """Partitions of a model layer.

    Attributes:
        parts: By partition; a partition without groups is not there.
        candidates: Action keys, the order of the candidate axis, ``[A]``.
        nominal: Place of the nominal candidate.
        brakes: Places of the brake candidates, ascending.
    """

    parts: Mapping[str, Part]
    candidates: tuple[str, ...]
    nominal: int
    brakes: tuple[int, ...]

    @classmethod
    def of(cls, frames: Mapping[str, Iterable[Frame]], bank: ActionBank) -> BenchmarkData:
        """Data of the tables `TABLES` of a model layer, and of `ENDINGS` where it has that, of the frames of each.

        Raises:
            DatasetError: A table lacks a row, repeats or does not know a key, or holds a value that is not a number.
        """
        contexts = concat([*frames["contexts"]])
        rows = zip(
            contexts["group_id"].tolist(),
            contexts["partition"].tolist(),
            contexts["route_cluster"].tolist(),
            strict=True,
        )
        about = {group: (partition, str(cluster)) for group, partition, cluster in sorted(rows, key=_home)}
        if len(about) < len(contexts["group_id"]):
            raise DatasetError("table `contexts` repeats a group; run `branchdrive-validate`")
        groups = tuple(about)  # those of a partition stand together, so that its arrays are slices
        scalars = pack_scalars(frames["scalars"], groups, bank.keys)
        paths = pack_trajectories(frames["trajectories"], groups, bank.keys)
        endings = _endings(concat([*frames[ENDINGS]]), groups, bank.keys) if ENDINGS in frames else None
        parts, first = {}, 0
        for name, homes in groupby(about.values(), key=itemgetter(0)):
            clusters = tuple(cluster for _, cluster in homes)
            own = slice(first, first + len(clusters))
            first = own.stop
            try:
                outcomes = Outcomes.of(scalars.values[own], scalars.available[own], paths.values[own])
            except ValueError as error:
                raise DatasetError(f"outcomes of the partition {name!r}: {error}") from error
            parts[name] = Part(groups[own], clusters, outcomes, None if endings is None else endings.take(own))
        return cls(
            parts,
            bank.keys,
            bank.keys.index(bank.nominal.key),
            tuple(i for i, policy in enumerate(bank.policies) if policy.family == BRAKE),
        )

    @property
    def groups(self) -> list[str]:
        """Ids of the groups of all partitions, sorted."""
        return sorted(group for part in self.parts.values() for group in part.groups)

    def part(self, partition: str) -> Part:
        """A partition.

        Raises:
            DatasetError: It has no group.
        """
        if partition not in self.parts:
            raise DatasetError(f"no group is in the partition {partition!r}; there are {sorted(self.parts)}")
        return self.parts[partition]

    def __repr__(self) -> str:
        return f"BenchmarkData({dict(self.parts)!r}, {len(self.candidates)} candidates)"


def _home(row: tuple[str, str, int]) -> tuple[str, str]:
    """What rows of groups, with partition and cluster, are sorted by."""
    group, partition, _ = row
    return partition, group


def _endings(frame: Frame, groups: Sequence[str], candidates: Sequence[str]) -> Endings:
    def packed(column: str) -> np.ma.MaskedArray[Any, Any]:
        return pack_column(frame, ENDINGS, column, groups, candidates)

    events = np.ma.stack([packed(event) for event in EVENTS], axis=-1)
    monitored = ~np.ma.getmaskarray(events)
    fraction = np.ma.getdata(packed("route_fraction")).astype(np.float64)
    if not np.isfinite(fraction).all():
        raise DatasetError(f"table `{ENDINGS}`: a `route_fraction` is not a finite number")
    happened = np.ma.getdata(events).astype(bool) & monitored
    return Endings(happened, monitored, np.ma.getdata(packed("completed")).astype(bool), fraction)


def groups_digest(groups: Sequence[str]) -> str:
    """SHA-256 of group ids, sorted, one a line, hexadecimal: what a checkpoint says that it was trained on."""
    return hashlib.sha256("".join(f"{group}\n" for group in sorted(groups)).encode()).hexdigest()
