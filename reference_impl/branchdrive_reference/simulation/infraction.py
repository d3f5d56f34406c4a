"""The line before a junction: which light governs the ego there, and whether it was crossed as it should be."""

from __future__ import annotations

import math

from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.signal import NO_GROUP, Light
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO
from branchdrive_reference.world.priority import AT_LINE_M, STOPPED_MPS

__all__ = ["NO_LIGHT", "LineMonitor", "governing_light"]

NO_LIGHT = -1
"""No signal governs the ego."""

_GOVERNED_M = 80.0


def _to_line_m(world: World) -> float:
    """Way of the ego's front to the line of its route; infinite where there is none."""
    ego = world.feet[EGO_TRACK, EGO]
    return float(world.tables.tracks["stop_m"][EGO_TRACK] - ego["arc_m"] - ego["half_length_m"])


def governing_light(world: World) -> int:
    """`Light` that governs the ego: of the signal at most 80 m ahead, until the ego's front is at its line."""
    group = int(world.tables.tracks["group"][EGO_TRACK])
    if group == NO_GROUP or not 0.0 <= _to_line_m(world) <= _GOVERNED_M:
        return NO_LIGHT
    return int(world.lights[group])


class LineMonitor:
    """Counts crossings of the line before the junction that signal or sign forbid.

    The front's distance to the line is compared between decisions; the light of the moment decides.
    """

    def __init__(self) -> None:
        self.num_red_lights_run = 0
        self.num_stop_signs_run = 0
        self._before_m = math.nan
        self._stopped = False

    def watch(self, world: World) -> None:
        """Note the present tick; call it once a tick, before the world's tracks are updated for the next."""
        gap_m = _to_line_m(world)
        if math.isinf(gap_m):
            return
        track = world.tables.tracks[EGO_TRACK]
        speed = abs(float(world.feet["speed_mps"][EGO_TRACK, EGO]))
        if speed < STOPPED_MPS and 0.0 <= gap_m < AT_LINE_M:
            self._stopped = True
        if self._before_m >= 0.0 > gap_m:
            red = track["group"] != NO_GROUP and world.lights[track["group"]] == Light.RED
            self.num_red_lights_run += bool(red)
            self.num_stop_signs_run += bool(track["stop_sign"] and not self._stopped)
        self._before_m = gap_m
