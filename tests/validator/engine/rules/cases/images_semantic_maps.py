"""Defects and limits of semantic maps against recorded vehicles, people, roads, routes and signs."""

from __future__ import annotations

import numpy as np
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.semantic_map import (
    LIGHT_TICK,
    MAP_AT,
    Change,
    Pixels,
    add_map_element,
    add_semantic_map,
)  # fmt: skip

from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass

EGO, VEHICLE = np.uint8(SemanticChannel.EGO), np.uint8(SemanticChannel.OTHER_VEHICLE)


DRIVABLE, ROUTE = np.uint8(SemanticChannel.DRIVABLE_AREA), np.uint8(SemanticChannel.REMAINING_ROUTE)


CLASS = np.uint8(15)


def _half_turn(pixels: Pixels) -> Pixels:
    return pixels[::-1, ::-1]


def _moved(rows: int = 0, columns: int = 0) -> Change:
    return lambda pixels: np.roll(pixels, (rows, columns), axis=(0, 1))


def _without(bits: np.uint8) -> Change:
    return lambda pixels: pixels & ~bits


def _of(bits: np.uint8, change: Change) -> Change:
    """The change to some bits alone."""
    return lambda pixels: (pixels & ~bits) | (change(pixels) & bits)


# BD-FRM-009


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_that_is_turned_around(d: Draft) -> None:
    add_semantic_map(d, vehicles=_half_turn)


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_without_vehicles(d: Draft) -> None:
    add_semantic_map(d, vehicles=lambda pixels: np.where(pixels & EGO, pixels, 0).astype(np.uint8))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def vehicles_without_their_channel(d: Draft) -> None:
    add_semantic_map(d, vehicles=_without(VEHICLE))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def vehicles_without_their_class(d: Draft) -> None:
    add_semantic_map(d, vehicles=lambda pixels: np.where(pixels & VEHICLE, VEHICLE, pixels).astype(np.uint8))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_with_a_vehicle_that_is_not_recorded(d: Draft) -> None:
    def invent(pixels: Pixels) -> Pixels:
        pixels[4:8, 4:8] = VEHICLE | SemanticClass.VEHICLE
        return pixels

    add_semantic_map(d, vehicles=invent)


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_moved_by_a_length(d: Draft) -> None:
    add_semantic_map(d, vehicles=_moved(6))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_without_the_ego(d: Draft) -> None:
    add_semantic_map(d, vehicles=_without(EGO))


@mutant("BD-FRM-009", base="media", at={**MAP_AT, "tick": 0})
def map_before_the_window_with_the_ego_elsewhere(d: Draft) -> None:
    add_semantic_map(d, vehicles=_of(EGO | CLASS, _moved(6)), tick=0)


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_with_two_egos(d: Draft) -> None:
    add_semantic_map(d, vehicles=lambda pixels: pixels | np.roll(pixels & EGO, 12, axis=1))


def _with_class_10(pixels: Pixels) -> Pixels:
    pixels[-1, -1] = 10
    return pixels


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_with_a_class_that_there_is_not(d: Draft) -> None:
    add_semantic_map(d, whole=_with_class_10)


@mutant("BD-FRM-009", base="media", at={**MAP_AT, "tick": 0})
def map_before_the_window_with_a_class_that_there_is_not(d: Draft) -> None:
    add_semantic_map(d, whole=_with_class_10, tick=0)


@boundary("BD-FRM-009", base="media")
def map_of_the_recorded_vehicles(d: Draft) -> None:
    add_semantic_map(d)


@boundary("BD-FRM-009", "BD-FRM-012", base="media")
def map_moved_by_a_pixel(d: Draft) -> None:
    add_semantic_map(d, whole=_moved(1))


def _with(value: int, row: int, column: int) -> Change:
    """Four pixels with a value."""

    def put(pixels: Pixels) -> Pixels:
        pixels[row : row + 2, column : column + 2] = value
        return pixels

    return put


CONE = (53, 25)
"""A cone at the branch, beside the lane."""


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def static_object_that_is_shown_as_a_vehicle(d: Draft) -> None:
    add_semantic_map(d, vehicles=_with(VEHICLE | SemanticClass.VEHICLE, *CONE))


# BD-FRM-016

PEOPLE_AT = {**MAP_AT, "tick": BRANCH_TICK + 25}
"""A pedestrian is in view."""


@mutant("BD-FRM-016", base="media", at=PEOPLE_AT)
def map_without_people(d: Draft) -> None:
    add_semantic_map(d, people=_without(CLASS), tick=BRANCH_TICK + 25)


@mutant("BD-FRM-016", base="media", at=MAP_AT)
def static_object_that_is_shown_as_a_pedestrian(d: Draft) -> None:
    add_semantic_map(d, people=_with(SemanticClass.PEDESTRIAN, *CONE))


@mutant("BD-FRM-016", base="media", at=PEOPLE_AT)
def people_moved_by_four_pixels(d: Draft) -> None:
    add_semantic_map(d, people=_moved(columns=4), tick=BRANCH_TICK + 25)


@mutant("BD-FRM-016", base="media", at=MAP_AT)
def pedestrian_that_is_not_recorded(d: Draft) -> None:
    add_semantic_map(d, people=_with(SemanticClass.PEDESTRIAN, 10, 50))


@boundary("BD-FRM-016", "BD-FRM-009", base="media")
def map_of_the_recorded_people(d: Draft) -> None:
    add_semantic_map(d, tick=BRANCH_TICK + 25)


@boundary("BD-FRM-016", base="media")
def people_moved_by_two_pixels(d: Draft) -> None:
    add_semantic_map(d, people=_moved(columns=2), tick=BRANCH_TICK + 25)


@boundary("BD-FRM-009", "BD-FRM-016", base="media")
def ego_below_a_pedestrian(d: Draft) -> None:
    """A pedestrian before the bumper, drawn two pixels longer, covers the front of the ego."""
    add_semantic_map(
        d, people=lambda pixels: np.maximum.reduce([np.roll(pixels, shift, axis=0) for shift in range(3)]),
        rollout_id="g1.nominal.a1", tick=BRANCH_TICK + 50,
    )  # fmt: skip


# BD-FRM-017

LIGHT_AT = {**MAP_AT, "tick": LIGHT_TICK}


RED, GREEN = np.uint8(SemanticClass.RED_LIGHT), np.uint8(SemanticClass.GREEN_LIGHT)


def _add_signal(d: Draft, kind: str = "signal", *, ahead_m: float = 15.0) -> None:
    """A signal or sign of the ego's lane, and its stop line."""
    add_map_element(d, kind, ahead_m + 4.0, -8.0)
    add_map_element(d, "stop_line", ahead_m, -2.0)


@mutant("BD-FRM-017", base="map", at=LIGHT_AT)
def light_of_another_colour(d: Draft) -> None:
    _add_signal(d)
    add_semantic_map(d, signs=lambda pixels: np.where(pixels == GREEN, RED, pixels), tick=LIGHT_TICK)


@mutant("BD-FRM-017", base="map", at=LIGHT_AT)
def map_without_lights(d: Draft) -> None:
    _add_signal(d)
    add_semantic_map(d, signs=_without(CLASS), tick=LIGHT_TICK)


@mutant("BD-FRM-017", base="map", at=LIGHT_AT)
def lights_moved_by_eleven_metres(d: Draft) -> None:
    _add_signal(d)
    add_semantic_map(d, signs=_moved(11), tick=LIGHT_TICK)


@mutant("BD-FRM-017", base="map", at=MAP_AT)
def light_where_no_signal_is(d: Draft) -> None:
    add_semantic_map(d, signs=_with(RED, 10, 36))


@mutant("BD-FRM-017", base="map", at=LIGHT_AT)
def map_without_a_stop_sign(d: Draft) -> None:
    _add_signal(d, "stop_sign")
    add_semantic_map(d, signs=_without(CLASS), tick=LIGHT_TICK)


@mutant("BD-FRM-017", base="map", at=LIGHT_AT)
def stop_sign_where_a_signal_is(d: Draft) -> None:
    add_map_element(d, "signal", 15.0, -8.0)
    add_semantic_map(d, signs=_with(SemanticClass.STOP_SIGN, 16, 36), tick=LIGHT_TICK)


@boundary("BD-FRM-017", base="map")
def lights_at_the_recorded_signal(d: Draft) -> None:
    _add_signal(d)
    add_semantic_map(d, tick=LIGHT_TICK)


@boundary("BD-FRM-017", base="map")
def light_at_the_stop_line_alone(d: Draft) -> None:
    def cut(pixels: Pixels) -> Pixels:
        pixels[:, 38:] = 0
        return pixels

    _add_signal(d)
    add_semantic_map(d, signs=cut, tick=LIGHT_TICK)


@boundary("BD-FRM-017", base="map")
def lights_moved_by_five_metres(d: Draft) -> None:
    _add_signal(d)
    add_semantic_map(d, signs=_moved(5), tick=LIGHT_TICK)


@boundary("BD-FRM-017", base="map")
def light_of_another_lane(d: Draft) -> None:
    """What it shows is not recorded; it stands across the junction from the light that is drawn."""
    add_map_element(d, "signal", 10.0, -20.0, lane_id="road2:1")
    add_semantic_map(d, signs=_with(RED, 20, 30), tick=LIGHT_TICK)


@boundary("BD-FRM-017", base="map")
def light_below_a_waiting_vehicle(d: Draft) -> None:
    """The vehicle ahead stands on the line."""
    _add_signal(d, ahead_m=24.0)
    add_semantic_map(d, signs=_without(CLASS), tick=LIGHT_TICK)


@boundary("BD-FRM-017", base="map")
def light_of_a_signal_without_a_stop_line(d: Draft) -> None:
    """Where vehicles wait at it, and so where it may be drawn, is not known."""
    add_map_element(d, "signal", 15.0, -8.0)
    add_semantic_map(d, signs=_without(CLASS), tick=LIGHT_TICK)


# BD-FRM-012


@mutant("BD-FRM-012", base="map", at=MAP_AT)
def road_that_is_turned_by_a_right_angle(d: Draft) -> None:
    add_semantic_map(d, ground=_of(DRIVABLE, np.rot90))


@mutant("BD-FRM-012", base="map", at=MAP_AT)
def road_moved_by_a_lane(d: Draft) -> None:
    add_semantic_map(d, ground=_of(DRIVABLE, _moved(columns=5)))


@mutant("BD-FRM-012", base="map", at=MAP_AT)
def no_drivable_area_on_lanes(d: Draft) -> None:
    add_semantic_map(d, ground=_without(DRIVABLE))


@mutant("BD-FRM-012", base="map", at={**MAP_AT, "tick": 0})
def lanes_of_no_class(d: Draft) -> None:
    add_semantic_map(d, ground=_without(CLASS), tick=0)


@mutant("BD-FRM-012", base="media", at=MAP_AT)
def route_that_turns_off(d: Draft) -> None:
    add_semantic_map(d, ground=_of(ROUTE, np.rot90))


@mutant("BD-FRM-012", base="media", at=MAP_AT)
def route_that_lies_behind(d: Draft) -> None:
    add_semantic_map(d, ground=_of(ROUTE, lambda pixels: pixels | _half_turn(pixels)))


@mutant("BD-FRM-012", base="media", at=MAP_AT)
def route_in_another_lane(d: Draft) -> None:
    add_semantic_map(d, ground=_of(ROUTE, _moved(columns=4)))


@mutant("BD-FRM-012", base="media", at={**MAP_AT, "tick": 0})
def no_route_ahead(d: Draft) -> None:
    add_semantic_map(d, ground=_without(ROUTE), tick=0)


@mutant("BD-FRM-012", base="media", at=MAP_AT)
def route_everywhere(d: Draft) -> None:
    add_semantic_map(d, ground=lambda pixels: pixels | ROUTE)


@boundary("BD-FRM-012", "BD-FRM-009", base="map")
def map_of_the_recorded_road(d: Draft) -> None:
    add_semantic_map(d)


@boundary("BD-FRM-012", base="map")
def road_moved_by_two_pixels(d: Draft) -> None:
    add_semantic_map(d, ground=_of(DRIVABLE, _moved(columns=2)))


@boundary("BD-FRM-012", base="map")
def yards_beside_the_road(d: Draft) -> None:
    add_semantic_map(d, ground=lambda pixels: pixels | DRIVABLE | np.uint8(SemanticClass.ROAD))


@boundary("BD-FRM-012", base="map")
def road_of_which_a_part_is_not_drawn(d: Draft) -> None:
    def cut(pixels: Pixels) -> Pixels:
        pixels[5:10] = 0
        return pixels

    add_semantic_map(d, ground=_of(DRIVABLE | CLASS, cut))


def _widened(each_side_px: int) -> Change:
    shifts = range(-each_side_px, each_side_px + 1)
    return lambda pixels: np.bitwise_or.reduce([np.roll(pixels, shift, axis=1) for shift in shifts])


@mutant("BD-FRM-012", base="media", at=MAP_AT)
def route_as_wide_as_a_road(d: Draft) -> None:
    add_semantic_map(d, ground=_widened(4))


@boundary("BD-FRM-012", base="media")
def route_two_pixels_wider_on_each_side(d: Draft) -> None:
    add_semantic_map(d, ground=_widened(2))


@boundary("BD-FRM-012", base="media")
def route_that_begins_at_the_bumper(d: Draft) -> None:
    def begin(pixels: Pixels) -> Pixels:
        pixels[29:] &= ~ROUTE
        return pixels

    add_semantic_map(d, ground=begin)
