"""Traffic signs: the ego waits at a red light until it is green, and stops once at a stop sign."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.scenarios.playback import PLAYED, Playback, playback

from branchdrive_reference.town.signal import NO_GROUP, Light
from branchdrive_reference.town.track import EGO_TRACK

each_world = pytest.mark.parametrize("number", PLAYED)

_STANDS_MPS = 0.2


def to_line_m(played: Playback) -> np.ndarray:
    """Way of the ego's front to its line ``[frames]``."""
    return played.tables.tracks["stop_m"][EGO_TRACK] - played.ego["arc_m"] - played.ego["half_length_m"]


@each_world
def test_the_ego_waits_at_red_and_goes_at_green(number: int) -> None:
    played = playback("VanillaSignalizedTurnEncounterRedLight", number)
    light = played.lights[:, played.tables.tracks["group"][EGO_TRACK]]
    stands = (played.ego["speed_mps"] < _STANDS_MPS) & (np.abs(to_line_m(played)) < 5.0)
    crosses = int(np.argmax(to_line_m(played) < 0.0))
    assert light[played.hazard] != Light.GREEN
    assert (light[stands & (np.arange(len(light)) < crosses)] == Light.RED).any()
    assert light[crosses] == Light.GREEN


@each_world
def test_others_pass_while_the_ego_has_red(number: int) -> None:
    played = playback("VanillaSignalizedTurnEncounterRedLight", number)
    group = played.tables.tracks["group"]
    crosses = int(np.argmax(to_line_m(played) < 0.0))
    for row in played.cast:
        track = int(played.bodies["track"][0, row])
        assert group[track] != group[EGO_TRACK]
    passed = [
        played.on_own_track(row)["arc_m"][crosses] > played.tables.tracks["stop_m"][played.bodies["track"][0, row]]
        for row in played.cast
    ]
    assert not played.cast or any(passed)


@each_world
def test_the_ego_stands_once_at_the_stop_sign(number: int) -> None:
    played = playback("VanillaNonSignalizedTurnEncounterStopsign", number)
    track = played.tables.tracks[EGO_TRACK]
    before = (to_line_m(played) >= -1.0) & (to_line_m(played) < 5.0)
    assert track["stop_sign"]
    assert track["group"] == NO_GROUP
    assert (played.ego["speed_mps"][before] < _STANDS_MPS).any()
    assert played.ego["speed_mps"][-1] > 2.0
