"""What a raw layer holds: its groups with what each is about and how far it gets, its attempts, and its ticks.

The report on a pilot and `branchdrive study` read it. Groups at each stage and partition of a release are counted in
`quality.population`, from the rows of the quality layer.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.route_cluster import CLUSTER_POINTS, resample_polyline, route_clusters
from branchdrive.quality.partition import cluster_of_groups
from branchdrive.quality.qualification import group_quality
from branchdrive.raw.examination import Examination
from branchdrive.raw.motion.route_state import routes
from branchdrive.raw.shard_view import ShardView

__all__ = ["Collected", "Names"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Names = NDArray[np.object_]
"""Text as objects, which share what is equal: an array of fixed width would make each as wide as the longest."""


@dataclass(frozen=True)
class Collected:
    """Branch groups of a raw layer or of shards of it, and their attempts.

    Attributes:
        group_id: Identities ``[groups]``.
        scenario_type: Of the attempt that describes each ``[groups]``, see `first_attempts`.
        town: Of each, ``[groups]``.
        polyline: Its route ``[groups, 32, 2]``, resampled; NaN where the record holds no polyline.
        has_route: Whether its route is usable ``[groups]``, as `routes` has it.
        has_nominal: Whether a compliant nominal was found ``[groups]``.
        is_complete: Whether the group is integrity-complete ``[groups]``.
        has_complete: Whether every policy has a complete attempt ``[groups]``, compliant or not.
        statuses: Attempts by status.
        attempts_by_town: Attempts by town.
        num_ticks: Control rows.
    """

    group_id: Names
    scenario_type: Names
    town: Names
    polyline: Array
    has_route: Mask
    has_nominal: Mask
    is_complete: Mask
    has_complete: Mask
    statuses: Counter[str]
    attempts_by_town: Counter[str]
    num_ticks: int

    @classmethod
    def of(cls, view: ShardView, examination: Examination, described: Index) -> Collected:
        """What a shard holds.

        Args:
            view: The shard.
            examination: What the rules found on it.
            described: The attempt that describes each group ``[groups]``, see `first_attempts`.
        """
        quality, records, selection = group_quality(view, examination), view.rollouts, examination.selection
        polylines = [_polyline(records["route_x_m"][i], records["route_y_m"][i]) for i in described]
        return cls(
            np.asarray(quality["group_id"]),
            np.asarray(quality["scenario_type"]),
            np.asarray(quality["town"]),
            np.reshape(polylines, (len(described), CLUSTER_POINTS, 2)),
            np.asarray(view.cached(routes).of_rollout[described] >= 0),
            np.asarray((selection.nominal >= 0) & examination.complies[selection.nominal]),
            np.asarray(quality["integrity_complete"]),
            np.asarray((selection.chosen >= 0).all(axis=1)),
            Counter(records["status"]),
            Counter(records["town"]),
            len(view.controls),
        )

    @classmethod
    def merged(cls, parts: Iterable[Collected]) -> Collected:
        """What all `parts` hold, at least one."""
        sides = list(parts)
        joined = {
            field.name: np.concatenate([getattr(side, field.name) for side in sides])
            for field in fields(cls)
            if isinstance(getattr(sides[0], field.name), np.ndarray)
        }
        return cls(
            **joined,
            statuses=sum((side.statuses for side in sides), Counter()),
            attempts_by_town=sum((side.attempts_by_town for side in sides), Counter()),
            num_ticks=sum(side.num_ticks for side in sides),
        )

    @property
    def num_groups(self) -> int:
        """Groups."""
        return len(self.group_id)

    @property
    def num_route_clusters(self) -> int:
        """Clusters of route geometry; a group without a polyline is in one of its own."""
        return len(set(route_clusters(self.town.tolist(), self.polyline).tolist()))

    @property
    def cluster_of_groups(self) -> dict[str, int]:
        """Route cluster of every group with a usable route, by identity."""
        usable = self.has_route
        return cluster_of_groups(self.group_id[usable].tolist(), self.town[usable].tolist(), self.polyline[usable])

    @property
    def scenario_types(self) -> dict[str, int]:
        """Groups by scenario type, in order of its name."""
        return dict(sorted(Counter(self.scenario_type.tolist()).items()))

    @property
    def towns(self) -> dict[str, int]:
        """Groups by town, in order of its name."""
        return dict(sorted(Counter(self.town.tolist()).items()))


def _polyline(x_m: Array, y_m: Array) -> Array:
    if len(x_m) != len(y_m) or not len(x_m) or not np.isfinite([x_m, y_m]).all():
        return np.full((CLUSTER_POINTS, 2), np.nan)
    return resample_polyline(x_m, y_m)
