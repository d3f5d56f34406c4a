"""Partitions of branch groups: disjoint in route clusters, stratified by scenario type, drawn by a key.

The assignment is a pure function of group ids, the clustering, scenario types and a seed:

1. The key of a cluster is the SHA-256 of the text ``seed``, newline, and its group ids, sorted, one a
   line. Clusters are taken in ascending order of their keys.
2. A cluster goes, whole, to a partition that still has room for it: its share of all groups less the
   groups it holds. If none has, it goes to the one with the most room.
3. Among several with room it goes where groups of its scenario types are rarest for the size of the
   partition: to the least ``sum over the cluster's groups of (groups of that type there) / share``; ties
   go to the partition that is the emptiest for its share, then to the first.

So no partition of ``P`` exceeds its share by more than ``(P - 1) / P`` of the largest cluster, or falls
short by more than ``(P - 1)^2 / P`` of it. All comparisons are exact. The order of the rows, the labels
of the clusters and the names of the types decide nothing; group ids are the identity of a group, and
renaming them draws again. Clusters are not taken by size: partitions would differ in the size of their
clusters, and a calibration partition must look like the test partition.

A calibration partition is drawn in one of two ways, by the name of the algorithm.

``clustered-2``: the three steps fill train, val and a pool, whose share is that of test and what calibration needs;
then a uniform permutation of the clusters of the pool gives the first of them to calibration and the others to test.
How many are the first is a symmetric function of the sizes in the pool. So whatever the pool is, a calibration cluster
and a test cluster are exchangeable, which is what a guard that is calibrated on the one and judged on the other needs.

``clustered-1``: the partition is drawn first, against everything else, by the same three steps with the share
that its groups and clusters need on average; then further clusters follow in the order of their keys
until both numbers are reached. The shares of the others refer to what is left. Strata and sizes of clusters decide
which clusters calibrate, so that exchangeability is assumed. Without calibration both are the same.

Source: paper, "Evaluation Population" (70/15/15, no shared route geometry, stratified); the algorithms are this
project's choice.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from fractions import Fraction
from types import MappingProxyType
from typing import NamedTuple

from branchdrive.statistics.random_words import orders, words

__all__ = [
    "CALIBRATION",
    "DIVIDED",
    "SHARES",
    "STRATIFIED",
    "TRAINING",
    "Calibration",
    "assign_split",
    "split_digest",
]

STRATIFIED = "clustered-1"
"""Name of the algorithm whose calibration partition is stratified."""

DIVIDED = "clustered-2"
"""Name of the algorithm whose calibration and test partitions are a uniform division of one pool."""

TRAINING = "train"
"""Name of the partition on which everything is fitted."""

SHARES: Mapping[str, int] = MappingProxyType({TRAINING: 70, "val": 15, "test": 15})
"""Partitions and their shares of the groups, per cent."""

CALIBRATION = "calibration"
"""Name of the optional partition on which thresholds of a guard are fitted."""


class Calibration(NamedTuple):
    """The least that a calibration partition must hold."""

    min_groups: int
    min_clusters: int


_DEVIATIONS = 3
_STREAM = "split/calibration"

_Types = Counter[Hashable]


class _Cluster(NamedTuple):
    """Groups of one cluster, sorted, and how many there are of each scenario type."""

    group_ids: tuple[str, ...]
    types: _Types


def assign_split(
    group_ids: Sequence[str],
    clusters: Sequence[Hashable],
    scenario_types: Sequence[Hashable],
    *,
    seed: int,
    calibration: Calibration | None = None,
    algorithm: str = DIVIDED,
) -> dict[str, str]:
    """Partition of every group, by group id in sorted order.

    Args:
        group_ids: Identity of each group ``[groups]``, all different, without white space.
        clusters: Label of the route cluster of each group ``[groups]``, of any kind.
        scenario_types: Stratum of each group ``[groups]``, of any kind.
        seed: Part of the key.
        calibration: The least that the partition `CALIBRATION` must hold; without it there is none.
        algorithm: `STRATIFIED` or `DIVIDED`.

    Raises:
        ValueError: The inputs differ in length, an id is not usable, there are too few groups or
            clusters for the calibration partition and one other cluster, or the division of the pool falls short.
    """
    if len(scenario_types) != len(group_ids):
        raise ValueError(f"{len(scenario_types)} scenario types do not match {len(group_ids)} groups")
    members: dict[Hashable, list[tuple[str, Hashable]]] = {}
    for group_id, cluster, kind in zip(group_ids, _checked(group_ids, clusters), scenario_types, strict=True):
        members.setdefault(cluster, []).append((group_id, kind))
    found = [
        _Cluster(tuple(sorted(group_id for group_id, _ in rows)), Counter(kind for _, kind in rows))
        for rows in members.values()
    ]
    found.sort(key=lambda cluster: _digest([str(seed), *cluster.group_ids]))
    drawn: list[_Cluster] = []
    if calibration is None:
        filled = _fill(found, list(SHARES.values()))
    elif algorithm == STRATIFIED:
        drawn, found = _draw(found, calibration)
        filled = _fill(found, list(SHARES.values()))
    else:
        *filled, pool = _fill(found, _shares_with_pool(found, calibration))
        drawn, rest = _divided(pool, calibration, seed)
        filled.append(rest)
    partitions = [(CALIBRATION, drawn), *zip(SHARES, filled, strict=True)]
    assignment = {
        group_id: name for name, members in partitions for cluster in members for group_id in cluster.group_ids
    }
    return dict(sorted(assignment.items()))


def split_digest(assignment: Mapping[str, str]) -> str:
    """SHA-256, 64 hexadecimal digits, of the lines ``group id, tab, partition``, sorted."""
    return _digest(sorted(f"{group_id}\t{name}" for group_id, name in assignment.items()))


def _digest(lines: Iterable[str]) -> str:
    return hashlib.sha256("".join(f"{line}\n" for line in lines).encode()).hexdigest()


def _checked(group_ids: Sequence[str], clusters: Sequence[Hashable]) -> Sequence[Hashable]:
    if len(clusters) != len(group_ids):
        raise ValueError(f"{len(clusters)} clusters do not match {len(group_ids)} groups")
    seen: set[str] = set()
    for group_id in group_ids:
        if group_id in seen or group_id.split() != [group_id]:
            raise ValueError(f"group id {group_id!r} is given twice, empty or holds white space")
        seen.add(group_id)
    return clusters


def _fill(clusters: Sequence[_Cluster], shares: Sequence[int]) -> list[list[_Cluster]]:
    """Clusters of every partition, taken in order; shares are positive and of any sum."""
    num_groups, whole = sum(len(cluster.group_ids) for cluster in clusters), sum(shares)
    filled: list[list[_Cluster]] = [[] for _ in shares]
    types: list[_Types] = [Counter() for _ in shares]
    for cluster in clusters:
        size = len(cluster.group_ids)
        room = [
            Fraction(share * num_groups, whole) - counts.total() for share, counts in zip(shares, types, strict=True)
        ]
        fits = [place for place, free in enumerate(room) if free >= size] or [room.index(max(room))]
        burden = {
            place: (
                Fraction(sum(count * types[place][kind] for kind, count in cluster.types.items()), shares[place]),
                Fraction(types[place].total(), shares[place]),
                place,
            )
            for place in fits
        }
        best = min(fits, key=burden.__getitem__)
        filled[best].append(cluster)
        types[best].update(cluster.types)
    return filled


def _draw(clusters: list[_Cluster], least: Calibration) -> tuple[list[_Cluster], list[_Cluster]]:
    """Clusters of the calibration partition and the others, both in order."""
    num_groups = sum(len(cluster.group_ids) for cluster in clusters)
    need = max(1, least.min_groups, -(-least.min_clusters * num_groups // max(1, len(clusters))))
    drawn, rest = _fill(clusters, [need, num_groups - need]) if need < num_groups else ([], list(clusters))
    while sum(len(cluster.group_ids) for cluster in drawn) < least.min_groups or len(drawn) < least.min_clusters:
        if not rest:
            break
        drawn.append(rest.pop(0))
    if not rest:
        raise _too_few(num_groups, len(clusters), least)
    return drawn, rest


def _shares_with_pool(clusters: Sequence[_Cluster], least: Calibration) -> list[int]:
    """Shares of the partitions, the last of them a pool of test and calibration."""
    num_groups = sum(len(cluster.group_ids) for cluster in clusters)
    num_drawn = _num_drawn(clusters, least)
    need = -(-num_drawn * num_groups // max(1, len(clusters)))
    if need >= num_groups:
        raise _too_few(num_groups, len(clusters), least)
    *others, last = (share * (num_groups - need) for share in SHARES.values())
    return [*others, last + sum(SHARES.values()) * need]


def _divided(pool: Sequence[_Cluster], least: Calibration, seed: int) -> tuple[list[_Cluster], list[_Cluster]]:
    """Calibration and the rest of a pool, by a uniform permutation of its clusters."""
    by_name = sorted(pool, key=lambda cluster: cluster.group_ids[0])
    num_drawn = _num_drawn(by_name, least)
    num_groups = sum(len(cluster.group_ids) for cluster in by_name)
    if num_drawn >= len(by_name):
        raise _too_few(num_groups, len(by_name), least)
    order = orders(words(seed, _STREAM, 1, len(by_name)))[0].tolist()
    drawn, rest = ([by_name[place] for place in part] for part in (order[:num_drawn], order[num_drawn:]))
    if (held := sum(len(cluster.group_ids) for cluster in drawn)) < least.min_groups:
        raise ValueError(f"the {num_drawn} drawn calibration clusters hold {held} of {least.min_groups} groups")
    return drawn, rest


def _num_drawn(clusters: Sequence[_Cluster], least: Calibration) -> int:
    """How many clusters calibrate: the fewest that hold enough groups, surely or by three standard deviations.

    Of ``n`` clusters that are drawn without replacement from ``K`` with ``G`` groups, ``Q`` the sum of squared sizes,
    groups have the mean ``n G / K`` and the variance ``n (K - n) (K Q - G^2) / (K^2 (K - 1))``.
    """
    sizes = sorted(len(cluster.group_ids) for cluster in clusters)
    count, total = len(sizes), sum(sizes)
    spread = count * sum(size**2 for size in sizes) - total**2
    for num in range(max(1, least.min_clusters), count):
        above = num * total - least.min_groups * count
        is_far = above >= 0 and above**2 * (count - 1) >= _DEVIATIONS**2 * num * (count - num) * spread
        if is_far or sum(sizes[:num]) >= least.min_groups:
            return num
    return count


def _too_few(num_groups: int, num_clusters: int, least: Calibration) -> ValueError:
    return ValueError(
        f"{num_groups} groups in {num_clusters} clusters leave no cluster beside a calibration partition "
        f"of {least.min_groups} groups and {least.min_clusters} clusters"
    )
