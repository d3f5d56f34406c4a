"""Giving way: an ambulance comes from behind, the ego leaves its lane, and the ambulance passes."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.scenarios.playback import PLAYED, playback

from branchdrive_reference.scenarios.scenario import FIRST_ROW
from branchdrive_reference.town.lane import LANE_WIDTH_M
from branchdrive_reference.world.body import Heed


@pytest.mark.parametrize("number", PLAYED)
def test_the_ego_makes_way_for_an_ambulance(number: int) -> None:
    played = playback("YieldToEmergencyVehicle", number)
    ambulance, ego = played.along_route(FIRST_ROW), played.ego
    beside = played.passing(FIRST_ROW)
    first = played.bodies[0, FIRST_ROW]
    assert first["siren"] == 1
    assert first["heeds"] == Heed.NOTHING
    assert ambulance["arc_m"][0] < ego["arc_m"][0]
    assert (np.abs(ego["offset_m"][beside]) > LANE_WIDTH_M / 2).all()
    assert np.abs(ego["offset_m"]).max() > LANE_WIDTH_M / 2
    assert (np.abs(ambulance["offset_m"]) < 0.5).all()


@pytest.mark.parametrize("number", PLAYED)
def test_the_siren_is_heard_before_the_ego_makes_way(number: int) -> None:
    played = playback("YieldToEmergencyVehicle", number)
    makes_way = (played.plan["shift_m"] != 0.0) & (played.plan["obstacle"] == FIRST_ROW)
    assert makes_way.any()
    assert int(np.argmax(makes_way)) >= played.hazard > 0


def test_the_ambulance_passes() -> None:
    """Unless the ego arrives before."""
    worlds = [playback("YieldToEmergencyVehicle", number) for number in PLAYED]
    passed = [played.along_route(FIRST_ROW)["arc_m"][-1] > played.ego["arc_m"][-1] for played in worlds]
    assert np.mean(passed) >= 0.5
