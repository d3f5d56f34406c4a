"""A plane with tracks on it: the ego drives on track 0, by the expert or by commands, and traffic follows tracks.

The loop is that of the simulator's world, without a scenario: lights, positions, decision, traffic, contacts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from tests.reference_impl.geometry.paths import path_of

from branchdrive_reference.expert.control import PLAN
from branchdrive_reference.expert.decision import decide
from branchdrive_reference.geometry.polyline import Polyline, interpolate
from branchdrive_reference.town.conflict import TrackCourse, conflict_table
from branchdrive_reference.town.lane import LaneSide, Turn
from branchdrive_reference.town.signal import NO_GROUP, Light
from branchdrive_reference.town.track import EGO_TRACK, TRACK
from branchdrive_reference.world.body import EGO, Behaviour, Body, Heed, Kind, Size, body_table
from branchdrive_reference.world.contact import ContactSpace
from branchdrive_reference.world.corridor import FOOT, find_feet, update_feet
from branchdrive_reference.world.motion import finish_motion, plan_motion
from branchdrive_reference.world.traffic import advance_traffic
from branchdrive_reference.world.vehicle import EGO_SIZE, VEHICLE

CAR = Size(4.6, 1.9, 1.5, 1500.0)
CYCLE = Size(1.8, 0.6, 1.7, 90.0)
ADVISORY_MPS = 10.0
HALF_JUNCTION_M, BEFORE_JUNCTION_M = 15.0, 1.0
REACH_M = 300.0
EAST, NORTH, SOUTH = 0.0, math.pi / 2, -math.pi / 2
BOTH_GREEN = (Light.GREEN, Light.GREEN)
Lights = Callable[[int], tuple[Light, Light]]


def track(
    heading_rad: float = EAST, *, left_m: float = 0.0, left: LaneSide = LaneSide.NOTHING,
    right: LaneSide = LaneSide.NOTHING, advisory_mps: float = ADVISORY_MPS,
) -> NDArray[np.void]:  # fmt: skip
    """A straight track that passes the origin `left_m` to its left, at arc length 0."""
    arc = np.arange(-REACH_M, REACH_M + 1.0)
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return shaped(
        Polyline(arc * cos - left_m * sin, arc * sin + left_m * cos), left=left, right=right, advisory_mps=advisory_mps
    )


def shaped(
    line: Polyline, *, arc_zero_m: float = REACH_M, left: LaneSide = LaneSide.NOTHING,
    right: LaneSide = LaneSide.NOTHING, advisory_mps: float = ADVISORY_MPS,
) -> NDArray[np.void]:  # fmt: skip
    """A track along a line."""
    path = path_of(line, arc_zero_m=arc_zero_m)
    path["advisory_speed_mps"], path["left_lane"], path["right_lane"] = advisory_mps, left, right
    return path


def course(
    turn: Turn = Turn.STRAIGHT, *, group: int = NO_GROUP, major: bool = True, stops: bool = False
) -> TrackCourse:
    """A course through a junction around arc length 0."""
    return TrackCourse(-HALF_JUNCTION_M, HALF_JUNCTION_M, group, stops=stops, turn=turn, major=major)


ELSEWHERE = TrackCourse(math.inf, math.inf, NO_GROUP, stops=False, turn=Turn.FOLLOW)
"""A course that crosses no junction."""


class Ground:
    """The running plane.

    Args:
        tracks: `VERTEX` tables; the ego's is the first.
        courses: How the tracks cross the junction; elsewhere if there is none.
        ego_m: Arc length at which the ego starts.
        ego_mps: Its speed; ``None`` takes the ego off the plane.
        merging: Tracks that merge like a zipper.
        lights: Lights of the signal groups at a tick.
    """

    def __init__(
        self, tracks: Sequence[NDArray[np.void]], courses: Sequence[TrackCourse] | None = None, *,
        ego_m: float = 0.0, ego_mps: float | None = None, merging: tuple[int, int] | None = None,
        lights: Lights = lambda _: BOTH_GREEN,
    ) -> None:  # fmt: skip
        courses = courses or [ELSEWHERE] * len(tracks)
        ends = np.cumsum([len(path) for path in tracks])
        self.vertices = np.concatenate(tracks)
        self.tracks = np.zeros(len(tracks), TRACK)
        self.tracks["first"], self.tracks["end"] = [0, *ends[:-1]], ends
        self.tracks["stop_m"] = [found.begin_m - BEFORE_JUNCTION_M for found in courses]
        self.tracks["group"] = [found.group for found in courses]
        self.tracks["stop_sign"] = [found.stops for found in courses]
        self.conflicts = conflict_table(list(tracks), list(courses), merging=merging)
        self.plan, self.vehicle, self.lights = np.zeros(1, PLAN), np.zeros(1, VEHICLE), np.zeros(2, np.int64)
        self.tick = 0
        self._lights = lights
        x, y, yaw = (0.0, 5000.0, 0.0) if ego_mps is None else self.pose(EGO_TRACK, ego_m)
        self._bodies = [Body(Kind.VEHICLE, Behaviour.DRIVEN, EGO_SIZE, x, y, yaw, ego_mps or 0.0)]
        self._history: list[NDArray[np.void]] = []
        self._plans: list[np.void] = []
        self.begin()

    def pose(self, on_track: int, arc_m: float, offset_m: float = 0.0) -> tuple[float, float, float]:
        """World pose on a track."""
        return interpolate(self.path(on_track), arc_m, offset_m)

    def path(self, on_track: int) -> NDArray[np.void]:
        """Vertices of a track."""
        return self.vertices[self.tracks["first"][on_track] : self.tracks["end"][on_track]]

    def vehicle_at(
        self, arc_m: float, on_track: int = EGO_TRACK, *, offset_m: float = 0.0, speed_mps: float = ADVISORY_MPS,
        size: Size = CAR, kind: Kind = Kind.VEHICLE, eagerness: float = 1.0, goal_offset_m: float | None = None,
        heeds: Heed = Heed.ALL, siren: bool = False,
    ) -> int:  # fmt: skip
        """Add a vehicle that follows a track; its row."""
        x, y, yaw = self.pose(on_track, arc_m, offset_m)
        return self.add(
            Body(
                kind, Behaviour.FOLLOWING, size, x, y, yaw, speed_mps, on_track, arc_m, offset_m, eagerness,
                goal_offset_m=goal_offset_m, heeds=heeds, siren=siren,
            )
        )  # fmt: skip

    def standing_at(self, arc_m: float, offset_m: float = 0.0, *, size: Size = CAR, kind: Kind = Kind.VEHICLE) -> int:
        """Add a body that stands on or beside the ego's track; its row."""
        x, y, yaw = self.pose(EGO_TRACK, arc_m, offset_m)
        return self.add(Body(kind, Behaviour.STANDING, size, x, y, yaw))

    def add(self, body: Body) -> int:
        """Add a body before the first tick; its row."""
        self._bodies.append(body)
        self.begin()
        return len(self._bodies) - 1

    def begin(self) -> None:
        """Lay out the bodies."""
        self.bodies = body_table(self._bodies)
        self.vehicle["forward_mps"] = self.bodies["speed_mps"][EGO]
        self.feet = np.zeros((len(self.tracks), len(self.bodies)), FOOT)
        find_feet(self.feet, self.bodies, self.vertices, self.tracks)
        self.contacts = ContactSpace(self.bodies)
        self._goals = np.zeros((len(self.bodies), 3))
        self.think()

    def think(self) -> np.void:
        """The expert's decision on the present state."""
        self.lights[:] = self._lights(self.tick)
        update_feet(self.feet, self.bodies, self.vertices, self.tracks)
        decide(self.plan[0], self.bodies, self.feet, self.vertices, self.tracks, self.conflicts, self.lights)
        row: np.void = self.plan[0]
        return row

    def drive(self, num_ticks: int, command: tuple[float, float, float] | None = None) -> None:
        """Drive by the expert, or by a command ``(steer, throttle, brake)``."""
        for _ in range(num_ticks):
            plan = self.think()
            self._history.append(self.bodies.copy())
            self._plans.append(plan.copy())
            applied = command or (float(plan["steer"]), float(plan["throttle"]), float(plan["brake"]))
            advance_traffic(
                self.bodies, self.feet, self.vertices, self.tracks, self.conflicts, self.lights, self._goals, 7,
                self.tick,
            )  # fmt: skip
            motion = self.contacts.motion
            planned = plan_motion(self.bodies, self.vehicle[0], motion, *applied, 0.9)
            self.contacts.step()
            finish_motion(self.bodies, self.vehicle[0], motion, self._goals, self.contacts.hit, *planned)
            self.tick += 1
        self.think()

    @property
    def history(self) -> NDArray[np.void]:
        """`BODY` rows before every tick driven ``[ticks, bodies]``."""
        return np.array(self._history)

    @property
    def plans(self) -> NDArray[np.void]:
        """`PLAN` rows of every tick driven ``[ticks]``."""
        return np.array(self._plans)

    def fronts_m(self, row: int) -> NDArray[np.float64]:
        """Arc length of a body's front on its straight track through the origin, before every tick driven."""
        history = self.history
        path = self.path(int(self.bodies["track"][row]))
        cos, sin = math.cos(path["tangent_rad"][0]), math.sin(path["tangent_rad"][0])
        along = history["x_m"][:, row] * cos + history["y_m"][:, row] * sin
        front: NDArray[np.float64] = along + 0.5 * self.bodies["length_m"][row]
        return front
