"""The stage: where scenarios and ambient traffic put their bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from branchdrive_reference.geometry.path import interpolate, locate
from branchdrive_reference.noise import Purpose, uniform_between
from branchdrive_reference.town.track import EGO_TRACK, RouteTracks
from branchdrive_reference.world.body import Behaviour, Body, Kind, Size

__all__ = ["Stage"]


@dataclass(frozen=True)
class Stage:
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

    def advisory_mps(self, arc_m: float, track: int = EGO_TRACK) -> float:
        """Advisory speed of a track at an arc length."""
        path = self.tables.path(track)
        return float(path[locate(path, arc_m)]["advisory_speed_mps"])

    def vehicle(
        self, size: Size, arc_m: float, track: int = EGO_TRACK, *, kind: Kind = Kind.VEHICLE,
        offset_m: float = 0.0, eagerness: float = 1.0, headway_s: float = 1.2, speed_mps: float | None = None,
    ) -> Body:  # fmt: skip
        """A vehicle that follows a track, by default at the speed it desires there."""
        x, y, yaw = interpolate(self.tables.path(track), arc_m, offset_m)
        speed = eagerness * self.advisory_mps(arc_m, track) if speed_mps is None else speed_mps
        return Body(kind, Behaviour.FOLLOWING, size, x, y, yaw, speed, track, arc_m, offset_m, eagerness, headway_s)

    def standing(self, kind: Kind, size: Size, arc_m: float, offset_m: float, *, turn_rad: float = 0.0) -> Body:
        """A body that stands beside or on the route, `turn_rad` counter-clockwise from its direction."""
        x, y, yaw = interpolate(self.tables.path(EGO_TRACK), arc_m, offset_m)
        return Body(kind, Behaviour.STANDING, size, x, y, yaw + turn_rad)

    def beside(self, arc_m: float, track: int) -> float:
        """Arc length on another track of the point nearest to the route at `arc_m`."""
        x, y, _ = interpolate(self.tables.path(EGO_TRACK), arc_m, 0.0)
        other = self.tables.path(track)
        return float(other["arc_m"][np.hypot(other["x_m"] - x, other["y_m"] - y).argmin()])

    def edges_m(self) -> tuple[float, float]:
        """Distances from the route to the left and right edge of the carriageway at the site."""
        lane = self.tables.route.site_lane
        return lane.left_edge_m, lane.right_edge_m
