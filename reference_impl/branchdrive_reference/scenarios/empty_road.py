"""An empty road: where scenarios and ambient traffic put their bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from branchdrive_reference.geometry.polyline import Array, interpolate, locate
from branchdrive_reference.noise import Purpose, choice, uniform_between
from branchdrive_reference.town.route import START_M
from branchdrive_reference.town.track import EGO_TRACK, Role, RouteTracks
from branchdrive_reference.world.body import Behaviour, Body, Heed, Kind, Size

__all__ = ["EmptyRoad"]

_Option = TypeVar("_Option")


@dataclass(frozen=True)
class EmptyRoad:
    """The empty road of one world.

    Attributes:
        tables: Route and tracks.
        seed: Seed of traffic and scenario.
    """

    tables: RouteTracks
    seed: int

    @property
    def site_m(self) -> float:
        """Arc length on the route where the scenario's hazard is."""
        return uniform_between(*self.tables.route.site_m, self.seed, Purpose.SITE)

    def track(self, role: Role) -> int | None:
        """Row of the track with a role, ``None`` where the route has none."""
        return self.tables.roles.get(role)

    def draw(self, low: float, high: float, purpose: Purpose, index: int = 0) -> float:
        """Number of this world in ``[low, high)``."""
        return uniform_between(low, high, self.seed, purpose, index)

    def advisory_mps(self, arc_m: float, track: int = EGO_TRACK) -> float:
        """Advisory speed of a track at an arc length."""
        path = self.tables.path(track)
        return float(path[locate(path, arc_m)]["advisory_speed_mps"])

    def pick(self, options: Sequence[_Option], purpose: Purpose, index: int = 0) -> _Option:
        """One of the options in this world, each as likely."""
        return options[choice(len(options), self.seed, purpose, index)]

    def count(self, bounds: tuple[int, int], purpose: Purpose, index: int = 0) -> int:
        """Number of this world from the first bound to the second, both included."""
        least, most = bounds
        return least + choice(most - least + 1, self.seed, purpose, index)

    def vehicle(
        self, size: Size, arc_m: float, track: int = EGO_TRACK, *, kind: Kind = Kind.VEHICLE,
        offset_m: float = 0.0, eagerness: float = 1.0, headway_s: float = 1.2, speed_mps: float | None = None,
        lateral_mps: float = 1.2, heeds: Heed = Heed.ALL, siren: bool = False,
    ) -> Body:  # fmt: skip
        """A vehicle that follows a track, by default at the speed it desires there."""
        x, y, yaw = interpolate(self.tables.path(track), arc_m, offset_m)
        speed = eagerness * self.advisory_mps(arc_m, track) if speed_mps is None else speed_mps
        return Body(
            kind, Behaviour.FOLLOWING, size, x, y, yaw, speed, track, arc_m, offset_m, eagerness, headway_s,
            lateral_mps=lateral_mps, heeds=heeds, siren=siren,
        )  # fmt: skip

    def standing(
        self, kind: Kind, size: Size, arc_m: float, offset_m: float, *, turn_rad: float = 0.0, track: int = EGO_TRACK
    ) -> Body:
        """A body that stands beside or on a track, `turn_rad` counter-clockwise from its direction."""
        x, y, yaw = interpolate(self.tables.path(track), arc_m, offset_m)
        return Body(kind, Behaviour.STANDING, size, x, y, yaw + turn_rad)

    def beside(self, arc_m: float, track: int) -> float:
        """Arc length on another track of the point nearest to the route at `arc_m`."""
        x, y, _ = interpolate(self.tables.path(EGO_TRACK), arc_m, 0.0)
        other = self.tables.path(track)
        return float(other["arc_m"][np.hypot(other["x_m"] - x, other["y_m"] - y).argmin()])

    def _clock_s(self, track: int, eagerness: float) -> tuple[Array, Array]:
        """Arc lengths of a track and the time at which a road user at its desired speed is there."""
        path = self.tables.path(track)
        arc, speed = path["arc_m"], eagerness * path["advisory_speed_mps"]
        steps = np.diff(arc) * 2.0 / (speed[1:] + speed[:-1])
        return arc, np.concatenate([np.zeros(1), np.cumsum(steps)])

    def ego_arrival_s(self, arc_m: float) -> float:
        """When the ego is at an arc length of its route, if nothing holds it up."""
        arc, clock = self._clock_s(EGO_TRACK, 1.0)
        return float(np.interp(arc_m, arc, clock) - np.interp(START_M, arc, clock))

    def arc_before(self, track: int, at_m: float, lead_s: float, eagerness: float = 1.0) -> float:
        """Arc length from which a vehicle at its desired speed is at `at_m` after `lead_s`."""
        arc, clock = self._clock_s(track, eagerness)
        wanted = float(np.interp(at_m, arc, clock)) - lead_s
        if wanted < 0.0:  # before the track begins: straight on, at the speed of its beginning
            return float(arc[0] + wanted * eagerness * self.advisory_mps(float(arc[0]), track))
        return float(np.interp(wanted, clock, arc))

    def meeting_m(self, track: int) -> tuple[float, float]:
        """Arc lengths on the route and on another track where their traffic gets in each other's way.

        Raises:
            LookupError: The two never meet.
        """
        for row in self.tables.conflicts:
            if row["track"] == EGO_TRACK and row["other"] == track:
                return float(row["enter_m"]), float(row["other_enter_m"])
        raise LookupError(f"track {track} does not meet route {self.tables.route.route_id!r}")

    def edges_m(self) -> tuple[float, float]:
        """Distances from the route to the left and right edge of the paved road at the site."""
        lane = self.tables.route.site_lane
        return lane.left_edge_m, lane.right_edge_m
