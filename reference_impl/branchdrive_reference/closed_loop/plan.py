"""Which groups are driven: a pure function of a seed, the world and the routes of training, fixed before any drive."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from branchdrive.contract.document import dump_json
from branchdrive.driving.route_cluster import route_clusters
from branchdrive.errors import UsageError
from branchdrive_reference.closed_loop.site import Field, Place, Route

__all__ = ["Plan", "make_plan"]

_TRIES = 100
"""Places that are looked at for every group, before too few routes are left."""


@dataclass(frozen=True)
class Plan:
    """A population.

    Attributes:
        seed: Seed of the population.
        places: Its groups.
        clusters: Route cluster of each.
        num_known: Places that were passed over because a training route is close to theirs.
    """

    seed: int
    places: tuple[Place, ...]
    clusters: tuple[str, ...]
    num_known: int

    def document(self, simulator: str) -> dict[str, Any]:
        """The plan as a lock has it."""
        return {
            "seed": self.seed,
            "simulator": simulator,
            "num_passed_over": self.num_known,
            "groups": [
                {**asdict(place), "route_cluster": cluster}
                for place, cluster in zip(self.places, self.clusters, strict=True)
            ],
        }

    def digest(self, simulator: str) -> str:
        """SHA-256 of the document."""
        return hashlib.sha256(dump_json(self.document(simulator))).hexdigest()


def make_plan(field: Field, seed: int, num_groups: int, known: Sequence[Route]) -> Plan:
    """The first groups of a population whose routes lie in no cluster of training.

    Args:
        field: The world.
        seed: Seed of the population.
        num_groups: How many groups.
        known: Routes of training.

    Raises:
        UsageError: Too few routes are left.
    """
    is_known: dict[tuple[str, str, bytes], bool] = {}
    places: list[Place] = []
    routes: list[Route] = []
    num_known = 0
    for index in range(_TRIES * num_groups):
        if len(places) == num_groups:
            break
        place, route = field.place(seed, index)
        key = (place.town, place.route_id, route.points.tobytes())
        if key not in is_known:
            is_known[key] = _lies_in(route, known)
        if is_known[key]:
            num_known += 1
        else:
            places.append(place)
            routes.append(route)
    if len(places) < num_groups:
        raise UsageError(
            f"{len(places)} of {_TRIES * num_groups} groups have a route in no cluster of `train`; ask for fewer "
            "groups, or for a world with more routes"
        )
    labels = route_clusters([route.town for route in routes], np.stack([route.points for route in routes]))
    return Plan(seed, tuple(places), tuple(f"c{label:04d}" for label in labels.tolist()), num_known)


def _lies_in(route: Route, known: Sequence[Route]) -> bool:
    """Whether the cluster of a route, among it and the known ones, has a known one."""
    towns = [route.town, *(one.town for one in known)]
    labels = route_clusters(towns, np.stack([route.points, *(one.points for one in known)]))
    return bool((labels[1:] == labels[0]).any())
