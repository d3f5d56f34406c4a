"""Defects and limits of semantic maps against recorded vehicles, roads and routes."""

from __future__ import annotations

import numpy as np
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.semantic_map import MAP_AT, Change, Pixels, add_semantic_map

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
    add_semantic_map(d, bodies=_half_turn)


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_without_vehicles(d: Draft) -> None:
    add_semantic_map(d, bodies=lambda pixels: np.where(pixels & EGO, pixels, 0).astype(np.uint8))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def vehicles_without_their_channel(d: Draft) -> None:
    add_semantic_map(d, bodies=_without(VEHICLE))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def vehicles_without_their_class(d: Draft) -> None:
    add_semantic_map(d, bodies=lambda pixels: np.where(pixels & VEHICLE, VEHICLE, pixels).astype(np.uint8))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_with_a_vehicle_that_is_not_recorded(d: Draft) -> None:
    def invent(pixels: Pixels) -> Pixels:
        pixels[4:8, 4:8] = VEHICLE | SemanticClass.VEHICLE
        return pixels

    add_semantic_map(d, bodies=invent)


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_moved_by_a_length(d: Draft) -> None:
    add_semantic_map(d, bodies=_moved(6))


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_without_the_ego(d: Draft) -> None:
    add_semantic_map(d, bodies=_without(EGO))


@mutant("BD-FRM-009", base="media", at={**MAP_AT, "tick": 0})
def map_before_the_window_with_the_ego_elsewhere(d: Draft) -> None:
    add_semantic_map(d, bodies=_of(EGO | CLASS, _moved(6)), tick=0)


@mutant("BD-FRM-009", base="media", at=MAP_AT)
def map_with_two_egos(d: Draft) -> None:
    add_semantic_map(d, bodies=lambda pixels: pixels | np.roll(pixels & EGO, 12, axis=1))


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


@boundary("BD-FRM-009", base="media")
def ego_below_a_pedestrian(d: Draft) -> None:
    add_semantic_map(d, bodies=lambda pixels: np.where(pixels & EGO, pixels | SemanticClass.PEDESTRIAN, pixels))


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


@boundary("BD-FRM-012", base="media")
def route_as_wide_as_a_road(d: Draft) -> None:
    add_semantic_map(
        d, ground=lambda pixels: np.bitwise_or.reduce([np.roll(pixels, shift, axis=1) for shift in range(-4, 5)])
    )


@boundary("BD-FRM-012", base="media")
def route_that_begins_at_the_bumper(d: Draft) -> None:
    def begin(pixels: Pixels) -> Pixels:
        pixels[29:] &= ~ROUTE
        return pixels

    add_semantic_map(d, ground=begin)
