"""The semantic bird's-eye view: class and channels of what lies around the ego, seen from above.

A pixel has what covers its centre. What is narrower than a pixel covers one all the same: paint, and people.

Source: spec/05-raw-streams.md#semantic-bev.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import TopDownCamera
from branchdrive.contract.semantic_bev import ROUTE_WIDTH_M, SemanticChannel, SemanticClass
from branchdrive_reference.rendering.marking import Pieces
from branchdrive_reference.rendering.opencv import SUBPIXEL_BITS, Image, cv2, fixed_point
from branchdrive_reference.rendering.patch import Patch, governing_signal
from branchdrive_reference.rendering.snapshot import Snapshot

__all__ = ["SemanticView"]

Array = NDArray[np.float64]

_LIGHTS = {
    "red": SemanticClass.RED_LIGHT,
    "yellow": SemanticClass.YELLOW_LIGHT,
    "green": SemanticClass.GREEN_LIGHT,
}

_STOP_RADIUS_M = 1.0
"""Radius of the disc at a signal or stop sign."""

_STOP_LINE_PX = 2

_HALF_PX = 0.5
"""Filled outlines cover the pixels that their edges touch: half a pixel more than lies inside."""

_CLASS_BITS = 0b1111


@dataclass(frozen=True, eq=False)
class SemanticView:
    """A camera of the stream `semantic_bev`, ready to draw."""

    camera: TopDownCamera

    @cached_property
    def _to_pixels(self) -> Array:
        """Points ``(x, y, 1)`` of the ego's frame to pixels ``(column, row, 1)`` ``[3, 3]``."""
        camera = self.camera
        return np.array(
            [
                [0, -camera.px_per_m, camera.origin_column_px],
                [-camera.px_per_m, 0, camera.origin_row_px],
                [0, 0, 1.0],
            ]
        )

    def draw(self, patch: Patch, snapshot: Snapshot) -> Image:
        """The view of an observation ``[height, width]``."""
        cos, sin = math.cos(snapshot.yaw_rad), math.sin(snapshot.yaw_rad)
        to_ego = np.array(
            [
                [cos, sin, -cos * snapshot.x_m - sin * snapshot.y_m],
                [-sin, cos, sin * snapshot.x_m - cos * snapshot.y_m],
                [0, 0, 1.0],
            ]
        )
        to_pixels = self._to_pixels @ to_ego
        shift = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])
        size = (self.camera.width_px, self.camera.height_px)
        ground = cv2.warpAffine(
            patch.semantics, (shift @ to_pixels @ patch.to_world)[:2], size, flags=cv2.INTER_NEAREST
        )
        classes = cv2.bitwise_and(ground, np.full_like(ground, _CLASS_BITS))
        image = cv2.bitwise_xor(ground, classes)
        self._draw_signals(classes, patch, snapshot, to_ego, to_pixels)
        self._draw_route(image, snapshot, to_pixels)
        self._draw_bodies(classes, image, snapshot, to_pixels)
        return np.asarray(cv2.bitwise_or(image, classes))

    def _draw_signals(self, classes: Image, patch: Patch, snapshot: Snapshot, to_ego: Array, to_pixels: Array) -> None:
        """Stop signs, the signal that governs the ego's lane, and the lines at which they have vehicles wait."""
        places = patch.post_places_m
        governing = governing_signal(patch.posts, _placed(places, to_ego), snapshot.lane_id) if snapshot.light else None
        radius = round(_STOP_RADIUS_M * self.camera.px_per_m * (1 << SUBPIXEL_BITS))
        for number, post in enumerate(patch.posts):
            if post.kind == "stop_sign":
                kind = SemanticClass.STOP_SIGN
            elif number == governing and snapshot.light in _LIGHTS:
                kind = _LIGHTS[snapshot.light]
            else:
                continue
            centre = fixed_point(_placed(places[number], to_pixels)).tolist()
            cv2.circle(classes, centre, radius, int(kind), cv2.FILLED, cv2.LINE_8, SUBPIXEL_BITS)
            for line in patch.stop_lines.get(post.lane_id or "", ()):
                outline = fixed_point(_placed(line, to_pixels))
                cv2.polylines(classes, [outline], False, int(kind), _STOP_LINE_PX, cv2.LINE_8, SUBPIXEL_BITS)

    def _draw_route(self, image: Image, snapshot: Snapshot, to_pixels: Array) -> None:
        """A piece for each segment on the view, and a disc at each of its ends that joins it to the next."""
        camera, channel = self.camera, int(SemanticChannel.REMAINING_ROUTE)
        route = snapshot.route_m
        half_m = ROUTE_WIDTH_M / 2 - _HALF_PX / camera.px_per_m
        corners = _placed(Pieces(route[:-1], route[1:], np.full(len(route) - 1, 2 * half_m)).corners(), to_pixels)
        size = camera.width_px, camera.height_px
        shown = ((corners.max(axis=1) >= 0) & (corners.min(axis=1) <= size)).all(axis=1)
        is_end = np.append(shown, False) | np.append(False, shown)
        plane = np.zeros_like(image)
        for outline in fixed_point(corners[shown]):
            cv2.fillConvexPoly(plane, outline, channel, cv2.LINE_8, SUBPIXEL_BITS)
        radius = round(half_m * camera.px_per_m * (1 << SUBPIXEL_BITS))
        for place in fixed_point(_placed(route[is_end], to_pixels)).tolist():
            cv2.circle(plane, place, radius, channel, cv2.FILLED, cv2.LINE_8, SUBPIXEL_BITS)
        cv2.bitwise_or(image, plane, image)

    def _draw_bodies(self, classes: Image, image: Image, snapshot: Snapshot, to_pixels: Array) -> None:
        """Vehicles, cycles and the ego, and people above them; static objects have no class."""
        bodies = snapshot.actors
        extents = np.stack([bodies.length_m, bodies.width_m], axis=1)
        outlines = fixed_point(_placed(self._corners(bodies.x_m, bodies.y_m, bodies.yaw_rad, extents), to_pixels))
        x, y, yaw = (np.array([value]) for value in (snapshot.x_m, snapshot.y_m, snapshot.yaw_rad))
        own = self._corners(x, y, yaw, np.array([[snapshot.length_m, snapshot.width_m]]))
        ego = fixed_point(_placed(own, to_pixels))
        wheeled = outlines[(bodies.actor_class == "vehicle") | (bodies.actor_class == "cycle")]
        people = outlines[bodies.actor_class == "pedestrian"]
        for group, channel in ((wheeled, SemanticChannel.OTHER_VEHICLE), (ego, SemanticChannel.EGO)):
            plane = np.zeros_like(image)
            for outline in group:
                cv2.fillConvexPoly(plane, outline, int(channel), cv2.LINE_8, SUBPIXEL_BITS)
            cv2.bitwise_or(image, plane, image)
            np.copyto(classes, np.uint8(SemanticClass.VEHICLE), where=plane > 0)
        for outline in people:
            cv2.fillConvexPoly(classes, outline, int(SemanticClass.PEDESTRIAN), cv2.LINE_8, SUBPIXEL_BITS)

    def _corners(self, x_m: Array, y_m: Array, yaw_rad: Array, extents_m: Array) -> Array:
        """Corners of boxes ``[boxes, 4, 2]``, half a pixel inside of them and at least in one line."""
        half = np.maximum(extents_m / 2 - _HALF_PX / self.camera.px_per_m, 0.0)
        along, left = half[:, :1] * np.array([1, -1, -1, 1]), half[:, 1:] * np.array([1, 1, -1, -1])
        cos, sin = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
        x, y = x_m[:, None] + cos * along - sin * left, y_m[:, None] + sin * along + cos * left
        return np.stack([x, y], axis=-1)


def _placed(points: Array, matrix: Array) -> Array:
    """Points ``[.., 2]`` by an affine map ``[3, 3]``."""
    return np.asarray(points @ matrix[:2, :2].T + matrix[:2, 2])
